"""Criticality measures of scenes and comfort and compliance measures of tracks: short functions on arrays."""

from resim.metrics.criticality.driving import (
    lateral_acceleration,
    lateral_jerk,
    longitudinal_acceleration,
    longitudinal_jerk,
)
from resim.metrics.criticality.evasion import drac, ttb, ttk, ttr, tts
from resim.metrics.criticality.following import (
    gap_ahead,
    half_speedometer,
    overtaking_right,
    tailgating,
)
from resim.metrics.criticality.measure import Measure, State
from resim.metrics.criticality.nearness import pet, pmd, tpmd
from resim.metrics.criticality.pairs import Pairs
from resim.metrics.criticality.road import lane_overhang, off_road, speed_over_limit
from resim.metrics.criticality.scenes import driven_pairs
from resim.metrics.criticality.times import ettc, thw, ttc
from resim.metrics.criticality.worst_case import wttc, wttr

__all__ = [
    "Measure", "Pairs", "State", "drac", "driven_pairs", "ettc", "gap_ahead",
    "half_speedometer", "lane_overhang", "lateral_acceleration", "lateral_jerk",
    "longitudinal_acceleration", "longitudinal_jerk", "off_road", "overtaking_right", "pet",
    "pmd", "speed_over_limit", "tailgating", "thw", "tpmd", "ttb", "ttc", "ttk", "ttr", "tts", "wttc",
    "wttr",
]  # fmt: skip
