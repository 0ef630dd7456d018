"""Whether the EGO decides as in the measured drive; not known where the run ended before it had shown that."""

from __future__ import annotations

from resim.resimulation.perceived import decides_as
from resim.sweeps.outcomes.definition import OutcomeDefinition

SAME_DECISION = OutcomeDefinition(
    column="same_decision",
    type="flag",
    label="makes the measured decision",
    of=lambda run: decides_as(run.found.decision, run.measured_decision, run.found.end),
    good=True,
    keeps="the EGO makes the measured decision",
)
