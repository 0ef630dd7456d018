"""How much later the EGO brakes than in the measured drive."""

from __future__ import annotations

from resim.resimulation.perceived import difference
from resim.sweeps.outcomes.definition import OutcomeDefinition

REACTION_DIFFERENCE = OutcomeDefinition(
    column="reaction_difference",
    type="number",
    label="braking delay against measured",
    of=lambda run: difference(run.found.reaction, run.measured_reaction),
    unit="s",
)
