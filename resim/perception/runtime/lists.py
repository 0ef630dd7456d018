"""Lists of perceived objects: one that stands for a while, and the limits of a model."""

from __future__ import annotations

import cmath
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats, wrap_angle
from resim.perception.model import FEATURES, TrainedRange
from resim.simulation.function.interface import EgoState, Perceived


class HeldList:
    """A list until the next: its objects stay in the map where they were, as far as the EGO knew where it was."""

    def __init__(self, seen: Perceived) -> None:
        self.seen_last = seen

    @cached_property
    def places(self) -> NDArray[np.complex128]:
        """Where the objects are in the map (N,), x + iy [m]; many a list is followed by the next at once."""
        seen, ego = self.seen_last, self.seen_last.ego
        there: NDArray[np.complex128] = (seen.x_ego + 1j * seen.y_ego) * cmath.rect(1.0, ego.heading)
        return complex(ego.x, ego.y) + there

    def seen(self, t: float, ego: EgoState) -> Perceived:
        """Give the list at t [s], in the frame of the EGO where it believes itself to be."""
        last = self.seen_last
        relative = (self.places - complex(ego.x, ego.y)) * cmath.rect(1.0, -ego.heading)
        turned = wrap_angle(last.heading_ego + (last.ego.heading - ego.heading))
        return replace(last, t=t, ego=ego, x_ego=relative.real, y_ego=relative.imag, heading_ego=turned)


def limits(validity: TrainedRange) -> Floats:
    """Give least and largest (5, 2) of the features and of the EGO's speed; infinite where there is no limit."""
    spans = [getattr(validity, name) for name in (*FEATURES, "ego_speed")]
    return np.array([span or (-np.inf, np.inf) for span in spans])
