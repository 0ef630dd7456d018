"""What the EGO knows of itself: its localisation."""

from __future__ import annotations

import math

import numpy as np

from resim.perception.model import Localisation, Own
from resim.sim.adfunction import EgoState

_BLOCK = 64
_PARTS = ("longitudinal", "lateral", "heading", "speed")


def is_wrong(localisation: Localisation) -> bool:
    """Say whether it has any error."""
    return any(own.bias or own.drift or own.noise for own in (getattr(localisation, p) for p in _PARTS))


class OwnState:
    """The EGO's state as the EGO has it; its errors are made for many steps ahead, again if the steps change."""

    def __init__(self, localisation: Localisation, rng: np.random.Generator) -> None:
        self.parts: list[Own] = [getattr(localisation, part) for part in _PARTS]
        self.rng, self.dt, self.next = rng, math.inf, 0
        self.normals: list[list[float]] = []
        self.errors: list[list[float]] = []
        self.drifts: list[list[float]] = [[0.0] * len(_PARTS)]

    def perceive(self, ego: EgoState, dt: float) -> EgoState:
        """Give the state with the errors dt [s] after the last; infinite for the first."""
        if self.next == len(self.errors) or not abs(dt - self.dt) < 1e-9:
            self._go_on(dt)
        forward, left, turn, faster = self.errors[self.next]
        self.next += 1
        c, s = math.cos(ego.heading), math.sin(ego.heading)
        return EgoState(
            ego.x + c * forward - s * left, ego.y + s * forward + c * left, ego.heading + turn, ego.v + faster,
            ego.a, ego.yaw_rate,
        )  # fmt: skip

    def _go_on(self, dt: float) -> None:
        """Make errors for steps of dt [s], from the last that was used on."""
        drift, self.normals = self.drifts[self.next], self.normals[self.next :]
        if not self.normals:
            self.normals = self.rng.standard_normal((_BLOCK, 2 * len(_PARTS))).tolist()
        self.dt, self.next, self.drifts, self.errors = dt, 0, [drift], []
        keep = [math.exp(-dt / own.correlation_time) for own in self.parts]
        push = [own.drift * math.sqrt(1.0 - k * k) for own, k in zip(self.parts, keep, strict=True)]
        bias, noise = [own.bias for own in self.parts], [own.noise for own in self.parts]
        for normals in self.normals:
            drift = [k * d + p * n for k, d, p, n in zip(keep, drift, push, normals[:4], strict=True)]
            self.drifts.append(drift)
            self.errors.append(
                [b + d + s * n for b, d, s, n in zip(bias, drift, noise, normals[4:], strict=True)]
            )
