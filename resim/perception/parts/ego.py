"""What the EGO knows of itself: its localisation."""

from __future__ import annotations

import math

import numpy as np

from resim.perception.fields import NotNegative, Number, Parameters, Positive
from resim.perception.parts.definition import PerceptionPart, RunningPart
from resim.simulation.function.interface import EgoState

_BLOCK = 64
_PARTS = ("longitudinal", "lateral", "heading", "speed")


class EgoStateError(Parameters):
    """One error of the EGO's own state: bias, drift with its correlation_time [s], white noise; standard deviations."""

    bias: Number = 0.0
    drift: NotNegative = 0.0
    correlation_time: Positive = 1.0
    noise: NotNegative = 0.0


class Localisation(Parameters):
    """Errors of the EGO's own state: longitudinal and lateral [m] in its frame, heading [rad], speed [m/s]."""

    longitudinal: EgoStateError = EgoStateError()
    lateral: EgoStateError = EgoStateError()
    heading: EgoStateError = EgoStateError()
    speed: EgoStateError = EgoStateError()


def is_wrong(localisation: Localisation) -> bool:
    """Say whether it has any error."""
    return any(own.bias or own.drift or own.noise for own in (getattr(localisation, p) for p in _PARTS))


class PerceivedEgoState(RunningPart):
    """The EGO's state as the EGO has it; its errors are made for many steps ahead, again if the steps change."""

    def __init__(self, localisation: Localisation, rng: np.random.Generator) -> None:
        parts = [getattr(localisation, part) for part in _PARTS]
        self.bias, self.drift, self.noise = (
            np.array([getattr(own, name) for own in parts]) for name in ("bias", "drift", "noise")
        )
        self.correlation_time = np.array([own.correlation_time for own in parts])
        self.rng, self.dt, self.next = rng, math.inf, 0
        self.normals = np.empty((0, 2 * len(_PARTS)))
        self.errors: list[list[float]] = []
        self.drifts = np.zeros((1, len(_PARTS)))

    def localise(self, ego: EgoState, step: float) -> EgoState:
        """Give the state with the errors a step [s] after the last; infinite for the first."""
        if self.next == len(self.errors) or not abs(step - self.dt) < 1e-9:
            self._go_on(step)
        forward, left, turn, faster = self.errors[self.next]
        self.next += 1
        c, s = math.cos(ego.heading), math.sin(ego.heading)
        return EgoState(
            ego.x + c * forward - s * left, ego.y + s * forward + c * left, ego.heading + turn, ego.v + faster,
            ego.a, ego.yaw_rate,
        )  # fmt: skip

    def _go_on(self, dt: float) -> None:
        """Make errors for steps of dt [s], from the last that was used on."""
        # compiled: numba is imported where it is used only
        from resim.perception.runtime.kernel import drifts

        before, self.normals = self.drifts[self.next], self.normals[self.next :]
        if not len(self.normals):
            self.normals = self.rng.standard_normal((_BLOCK, 2 * len(_PARTS)))
        self.dt, self.next = dt, 0
        keep = np.exp(-dt / self.correlation_time)
        self.drifts = np.empty((len(self.normals) + 1, len(_PARTS)))
        self.drifts[0] = before
        drifts(self.drifts, keep, self.drift * np.sqrt(1.0 - keep * keep), self.normals)
        errors = self.bias + self.drifts[1:] + self.noise * self.normals[:, len(_PARTS) :]
        self.errors = errors.tolist()


EGO = PerceptionPart(
    name="ego",
    parameters=Localisation,
    make=lambda own, streams: PerceivedEgoState(own, streams.of()) if is_wrong(own) else None,
)
