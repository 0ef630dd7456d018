"""The accident risk of a scene as a measure (`resim.metrics.risk` computes it)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from resim.metrics.measures.definition import DriveDangers, MeasureDefinition
from resim.metrics.measures.values import MeasureValues, computed

if TYPE_CHECKING:
    from resim.metrics.measures.inputs import MeasureInputs


def _riskiest(found: DriveDangers, scene: int) -> str:
    """The object of the largest risk, "" where none has any."""
    near = np.nan_to_num(found.risk.r_to[scene], nan=-1.0)
    return found.drive.ids[int(near.argmax())] if near.max(initial=0.0) > 0.0 else ""


RISK = MeasureDefinition(
    name="risk",
    unit="1",
    worst="high",
    kind="quantitative",
    source="Wagner 2021, chapter 4, Eq. 4.10",
    meaning="accident risk, 0 to 1",
    of=lambda inputs: risk(inputs),
    by_scene=True,
    unseen=lambda absent: absent.contact(1.0),
    whom=_riskiest,
)


def risk(inputs: MeasureInputs) -> MeasureValues:
    """Give the accident risk (S,) of the scenes; NOT_COMPUTED where something of an object that is there is unknown."""
    return RISK.values(*computed(inputs.risk.r_ind))
