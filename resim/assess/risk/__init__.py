"""The Monte-Carlo accident risk of Wagner 2021, chapter 4."""

from resim.assess.risk.metric import Mode, Parameters, Risk, Scenes, accident_risk
from resim.assess.risk.prediction import PUBLISHED, Surfaces

__all__ = ["PUBLISHED", "Mode", "Parameters", "Risk", "Scenes", "Surfaces", "accident_risk"]
