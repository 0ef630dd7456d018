"""Every measure of resim: a line each, in the order of tables. Each is defined beside its function."""

# ruff: noqa: F401, I001  # the order is that of tables, and all are used

from __future__ import annotations

from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.times import TTC
from resim.metrics.measures.times import ETTC
from resim.metrics.measures.worst_case import WTTC
from resim.metrics.measures.times import THW
from resim.metrics.measures.evasion import TTB
from resim.metrics.measures.evasion import TTK
from resim.metrics.measures.evasion import TTS
from resim.metrics.measures.evasion import TTR
from resim.metrics.measures.worst_case import WTTR
from resim.metrics.measures.nearness import PMD
from resim.metrics.measures.nearness import TPMD
from resim.metrics.measures.nearness import PET
from resim.metrics.measures.evasion import DRAC
from resim.metrics.measures.following import GAP_AHEAD
from resim.metrics.measures.driving import LONGITUDINAL_ACCELERATION
from resim.metrics.measures.driving import LATERAL_ACCELERATION
from resim.metrics.measures.driving import LONGITUDINAL_JERK
from resim.metrics.measures.driving import LATERAL_JERK
from resim.metrics.measures.collision import COLLISION
from resim.metrics.measures.accident_risk import RISK
from resim.metrics.measures.road import SPEED_OVER_LIMIT
from resim.metrics.measures.following import HALF_SPEEDOMETER
from resim.metrics.measures.following import TAILGATING
from resim.metrics.measures.following import OVERTAKING_RIGHT
from resim.metrics.measures.road import LANE_OVERHANG
from resim.metrics.measures.road import OFF_ROAD
from resim.metrics.measures.functional import FUNCTION_AVAILABILITY
from resim.metrics.measures.functional import PERCEPTION_AVAILABILITY
from resim.metrics.measures.functional import DETECTION
from resim.metrics.measures.functional import DETECTION_RATE
from resim.metrics.measures.functional import CYCLE_TIME
from resim.metrics.measures.functional import LATENCY

MEASURES: tuple[MeasureDefinition, ...] = tuple(
    value for value in vars().values() if isinstance(value, MeasureDefinition)
)
"""All that are imported above."""
