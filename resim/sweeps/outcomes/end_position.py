"""How far from the measured drive the EGO ends."""

from __future__ import annotations

from resim.resimulation.perceived import end_error
from resim.sweeps.outcomes.definition import OutcomeDefinition

END_POSITION_ERROR = OutcomeDefinition(
    column="end_position_error",
    type="number",
    label="distance from the drive at the end",
    of=lambda run: end_error(run.drive, run.pipeline),
    unit="m",
)
