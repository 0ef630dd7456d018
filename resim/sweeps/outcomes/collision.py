"""Whether the EGO collides; not known where the run ended early, or somebody who is not seen may have been hit."""

from __future__ import annotations

from resim.sweeps.outcomes.definition import OutcomeDefinition

COLLISION = OutcomeDefinition(
    column="collision",
    type="flag",
    label="no collision of the EGO",
    of=lambda run: run.found.collision or (False if run.found.clear else None),
    good=False,
    keeps="the EGO does not collide",
    asked="no collision",
    final=True,
)
