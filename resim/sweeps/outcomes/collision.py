"""Whether the EGO collides."""

from __future__ import annotations

from resim.sweeps.outcomes.definition import OutcomeDefinition

COLLISION = OutcomeDefinition(
    column="collision",
    type="flag",
    label="no collision of the EGO",
    of=lambda run: run.found.collision,
    good=False,
    keeps="the EGO does not collide",
    asked="no collision",
    final=True,
)
