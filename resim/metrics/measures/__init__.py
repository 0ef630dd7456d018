"""Measures: what can be said of a drive in values, without any rating (Groh 2018, III.B: objectifications).

Short functions on arrays, each with its definition beside it; `registry` lists all.
"""

from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.driving import (
    lateral_acceleration,
    lateral_jerk,
    longitudinal_acceleration,
    longitudinal_jerk,
)
from resim.metrics.measures.evasion import drac, ttb, ttk, ttr, tts
from resim.metrics.measures.following import (
    gap_ahead,
    half_speedometer,
    overtaking_right,
    tailgating,
)
from resim.metrics.measures.nearness import pet, pmd, tpmd
from resim.metrics.measures.pairs import Pairs
from resim.metrics.measures.road import lane_overhang, off_road, speed_over_limit
from resim.metrics.measures.scenes import driven_pairs
from resim.metrics.measures.times import ettc, thw, ttc
from resim.metrics.measures.values import MeasureValues, State
from resim.metrics.measures.worst_case import wttc, wttr

__all__ = [
    "MeasureDefinition", "MeasureValues", "Pairs", "State", "drac", "driven_pairs", "ettc", "gap_ahead",
    "half_speedometer", "lane_overhang", "lateral_acceleration", "lateral_jerk",
    "longitudinal_acceleration", "longitudinal_jerk", "off_road", "overtaking_right", "pet",
    "pmd", "speed_over_limit", "tailgating", "thw", "tpmd", "ttb", "ttc", "ttk", "ttr", "tts", "wttc",
    "wttr",
]  # fmt: skip
