"""Criticality measures of scenes and comfort and compliance measures of tracks: short functions on arrays."""

from resim.assess.criticality.driving import (
    lateral_acceleration,
    lateral_jerk,
    longitudinal_acceleration,
    longitudinal_jerk,
)
from resim.assess.criticality.evasion import drac, ttb, ttk, ttr, tts
from resim.assess.criticality.following import gap_ahead, half_speedometer, overtaking_right, tailgating
from resim.assess.criticality.measure import Measure, State
from resim.assess.criticality.nearness import pet, pmd, tpmd
from resim.assess.criticality.pairs import Pairs
from resim.assess.criticality.road import lane_overhang, off_road, speed_over_limit
from resim.assess.criticality.scenes import driven_pairs
from resim.assess.criticality.times import ettc, thw, ttc
from resim.assess.criticality.worst_case import wttc, wttr

__all__ = [
    "Measure", "Pairs", "State", "drac", "driven_pairs", "ettc", "gap_ahead",
    "half_speedometer", "lane_overhang", "lateral_acceleration", "lateral_jerk",
    "longitudinal_acceleration", "longitudinal_jerk", "off_road", "overtaking_right", "pet",
    "pmd", "speed_over_limit", "tailgating", "thw", "tpmd", "ttb", "ttc", "ttk", "ttr", "tts", "wttc",
    "wttr",
]  # fmt: skip
