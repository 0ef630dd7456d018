"""Whether the EGO decides as in the measured drive."""

from __future__ import annotations

from resim.sweeps.outcomes.definition import OutcomeDefinition

SAME_DECISION = OutcomeDefinition(
    column="same_decision",
    type="flag",
    label="makes the measured decision",
    of=lambda run: run.found.decision == run.measured_decision,
    good=True,
    keeps="the EGO makes the measured decision",
)
