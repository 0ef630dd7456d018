"""How dangerous a run was."""

from __future__ import annotations

from resim.sweeps.outcomes.definition import OutcomeDefinition

RISK = OutcomeDefinition(
    column="risk",
    type="number",
    label="largest accident risk",
    of=lambda run: run.found.risk,
)
