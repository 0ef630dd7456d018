"""Every part of perception: a line each, in the order in which they go over a list."""

# ruff: noqa: F401, I001  # the order is that of the chain, and all are used

from __future__ import annotations

from resim.perception.parts.definition import PerceptionPart
from resim.perception.parts.ego import EGO
from resim.perception.parts.id_switch import ID_SWITCH
from resim.perception.parts.false_objects import FALSE_OBJECTS

PARTS: tuple[PerceptionPart, ...] = tuple(
    value for value in vars().values() if isinstance(value, PerceptionPart)
)
"""All that are imported above."""
