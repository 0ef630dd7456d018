"""The Monte-Carlo accident risk of Wagner 2021, chapter 4."""

from resim.metrics.risk.metric import DEFAULTS, Mode, Risk, RiskParameters, Scenes, accident_risk
from resim.metrics.risk.prediction import PUBLISHED, Surfaces

__all__ = ["DEFAULTS", "PUBLISHED", "Mode", "Risk", "RiskParameters", "Scenes", "Surfaces", "accident_risk"]
