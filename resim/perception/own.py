"""What the EGO knows of itself: its localisation."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from resim.perception.model import Localisation, Own
from resim.sim.adfunction import EgoState

_BLOCK = 64
_PARTS = ("longitudinal", "lateral", "heading", "speed")


def is_wrong(localisation: Localisation) -> bool:
    """Say whether it has any error."""
    return any(own.bias or own.drift or own.noise for own in (getattr(localisation, p) for p in _PARTS))


class _OwnError:
    """One error as it goes on in time; draws its normals by twos: for the drift, for the noise."""

    def __init__(self, own: Own, rng: np.random.Generator) -> None:
        self.bias, self.noise, self.spread, self.time = own.bias, own.noise, own.drift, own.correlation_time
        self.steady, self.rng = own.drift == 0.0 and own.noise == 0.0, rng
        self.normals: list[float] = []
        self.drift, self.keep, self.push = 0.0, 0.0, own.drift

    def step(self, dt: float) -> None:
        """Take steps of dt [s] from now on; infinite before the first."""
        self.keep = math.exp(-dt / self.time)
        self.push = self.spread * math.sqrt(1.0 - self.keep * self.keep)

    def next(self) -> float:
        """Give the error a step after the last."""
        if self.steady:
            return self.bias
        if not self.normals:
            self.normals = self.rng.standard_normal(_BLOCK)[::-1].tolist()
        self.drift = drift = self.keep * self.drift + self.push * self.normals.pop()
        return self.bias + drift + self.noise * self.normals.pop()


class OwnState:
    """The EGO's state as the EGO has it."""

    def __init__(self, localisation: Localisation, stream: Callable[[str, str], np.random.Generator]) -> None:
        self.errors = [_OwnError(getattr(localisation, part), stream("ego", part)) for part in _PARTS]
        self.dt = math.inf

    def perceive(self, ego: EgoState, dt: float) -> EgoState:
        """Give the state with the errors dt [s] after the last; infinite for the first."""
        one, two, three, four = self.errors
        if not abs(dt - self.dt) < 1e-9:
            self.dt = dt
            for error in self.errors:
                error.step(dt)
        forward, left, turn, faster = one.next(), two.next(), three.next(), four.next()
        c, s = math.cos(ego.heading), math.sin(ego.heading)
        return EgoState(
            ego.x + c * forward - s * left, ego.y + s * forward + c * left, ego.heading + turn, ego.v + faster,
            ego.a, ego.yaw_rate,
        )  # fmt: skip
