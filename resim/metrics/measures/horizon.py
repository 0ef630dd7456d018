"""How far ahead a criterion looks: as far as its limit needs, and what is left open beyond.

Measures look 4 s (`Parameters.horizon`) or 150 m ahead. That nothing is met until then shows that a time is not below
4 s, and nothing more. For a limit that needs more, a measure that says what it `needs` is computed again as far ahead,
up to LONGEST or FARTHEST. What cannot be looked for, as a plan ends after 4 s, stays open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resim.core.geometry import Floats

if TYPE_CHECKING:
    from resim.metrics.measures.inputs import MeasureInputs

LONGEST, FARTHEST = 30.0, 500.0
"""Time [s] and way [m] that are looked ahead at most."""
RANGE = 150.0
"""How far ahead [m] is looked for somebody."""


@dataclass(frozen=True)
class LookAhead:
    """How far is looked ahead. horizon: s; reach: m along the EGO's path."""

    horizon: float
    reach: float = RANGE


def for_time(inputs: MeasureInputs, time: float) -> LookAhead:
    """Give how far to look where a time [s] is needed."""
    return LookAhead(min(max(time, inputs.usual.horizon), LONGEST))


def for_way(inputs: MeasureInputs, way: float) -> LookAhead:
    """Give how far to look where a way [m] is needed."""
    return LookAhead(inputs.usual.horizon, min(max(way, RANGE), FARTHEST))


def fastest(inputs: MeasureInputs) -> float:
    """Give the EGO's largest speed [m/s] in any scene, 0 where none is known."""
    v = inputs.pairs.plan[:, 0, 3]
    return float(np.max(np.abs(v), initial=0.0, where=np.isfinite(v)))


def speed(inputs: MeasureInputs) -> Floats:
    """Give the EGO's speed (S, 1) [m/s]."""
    return np.asarray(np.abs(inputs.pairs.plan[:, :1, 3]))


def later(inputs: MeasureInputs) -> Floats:
    """Give the least time (S, 1) [s] after which something may come that was not met within the horizon."""
    return inputs.seen.horizon + 0.0 * speed(inputs)


def later_braked(inputs: MeasureInputs) -> Floats:
    """Give the least time (S, 1) [s] after which the EGO may have to brake for what it meets beyond the horizon.

    Who would touch at more than H s needs v / (2 b) s of full braking before the contact.
    """
    most = np.abs(inputs.pairs.plan[..., 3]).max(axis=1, keepdims=True)
    return np.asarray(np.maximum(inputs.seen.horizon - 0.5 * most / inputs.parameters.braking, 0.0))
