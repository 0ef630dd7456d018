"""What the EGO knows of itself: its localisation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.perception.fields import Lasting, NotNegative, Number, ParameterGroup
from resim.perception.parts.definition import PerceptionPart, RunningPart

if TYPE_CHECKING:
    from resim.simulation.function.interface import EgoState

_BLOCK = 64
_PARTS = ("longitudinal", "lateral", "heading", "speed")


class EgoStateError(ParameterGroup):
    """One error of the EGO's own state: bias, drift with its correlation_time [s], white noise; standard deviations."""

    bias: Number = 0.0
    drift: NotNegative = 0.0
    correlation_time: Lasting = 1.0
    noise: NotNegative = 0.0


class Localisation(ParameterGroup):
    """Errors of the EGO's own state: longitudinal and lateral [m] in its frame, heading [rad], speed [m/s]."""

    longitudinal: EgoStateError = EgoStateError()
    lateral: EgoStateError = EgoStateError()
    heading: EgoStateError = EgoStateError()
    speed: EgoStateError = EgoStateError()


def is_wrong(localisation: Localisation) -> bool:
    """Say whether it has any error."""
    return any(own.bias or own.drift or own.noise for own in (getattr(localisation, p) for p in _PARTS))


class PerceivedEgoState(RunningPart):
    """The EGO's state as the EGO has it in one run."""

    def __init__(self, localisation: Localisation, rng: np.random.Generator) -> None:
        self.localisation, self.rng = localisation, rng

    @cached_property
    def _alone(self) -> EgoErrors:
        return EgoErrors([self])

    def localise(self, ego: EgoState, step: float) -> EgoState:
        """Give the state with the errors a step [s] after the last; infinite for the first."""
        own = np.array([ego])
        self._alone.localise(own, _FIRST, step)
        return type(ego)(*own[0].tolist())


_FIRST = np.zeros(1, dtype=np.intp)


class EgoErrors:
    """The errors of the EGO's own state in R runs; they are made for many steps ahead, again if the steps change."""

    def __init__(self, parts: Sequence[PerceivedEgoState]) -> None:
        own = [[getattr(part.localisation, name) for name in _PARTS] for part in parts]
        self.bias, self.drift, self.noise, self.correlation_time = (
            np.array([[getattr(one, name) for one in of] for of in own])
            for name in ("bias", "drift", "noise", "correlation_time")
        )
        self.rngs, self.dt, self.next = [part.rng for part in parts], math.inf, 0
        self.normals = np.empty((0, len(parts), 2 * len(_PARTS)))
        self.errors = np.empty((0, len(parts), len(_PARTS)))
        self.drifts = np.zeros((1, *self.bias.shape))

    def localise(self, ego: Floats, rows: NDArray[np.intp], step: float) -> None:
        """Add errors to these rows (R,) of ego (B, 6), a step [s] after the last; infinite for the first."""
        # compiled: numba is imported where it is used only
        from resim.perception.runtime.kernel import localise

        if self.next == len(self.errors) or not abs(step - self.dt) < 1e-9:
            self._go_on(step)
        localise(ego, rows, self.errors[self.next])
        self.next += 1

    def _go_on(self, dt: float) -> None:
        """Make errors for steps of dt [s], from the last that was used on."""
        # compiled: numba is imported where it is used only
        from resim.perception.runtime.kernel import drifts

        before, self.normals = self.drifts[self.next], self.normals[self.next :]
        if not len(self.normals):
            drawn = [rng.standard_normal((_BLOCK, 2 * len(_PARTS))) for rng in self.rngs]
            self.normals = np.stack(drawn, axis=1)
        self.dt, self.next, count = dt, 0, len(self.normals)
        keep = np.exp(-dt / self.correlation_time)
        pushing, noises = np.split(self.normals, 2, axis=2)
        self.drifts = np.empty((count + 1, *self.bias.shape))
        self.drifts[0] = before
        drifts(
            self.drifts.reshape(count + 1, -1), keep.ravel(), (self.drift * np.sqrt(1.0 - keep * keep)).ravel(),
            pushing.reshape(count, -1),
        )  # fmt: skip
        self.errors = self.bias + self.drifts[1:] + self.noise * noises


EGO = PerceptionPart(
    name="ego",
    parameters=Localisation,
    make=lambda own, streams: PerceivedEgoState(own, streams.of()) if is_wrong(own) else None,
)
