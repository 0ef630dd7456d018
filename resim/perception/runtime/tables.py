"""A model's parameters as the arrays that one cycle multiplies with."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np

from resim.core.geometry import Floats
from resim.perception.model import FEATURES, QUANTITIES, Detection, ErrorModels, Spread
from resim.perception.runtime.chain import detected_share, probabilities
from resim.perception.runtime.kernel import (
    BIAS,
    DRIFT_SPREAD,
    DRIVE,
    ERROR_ROWS,
    KEEP,
    NOISE_SPREAD,
    Q,
)

_HEADING = QUANTITIES.index("heading")
_KEPT = 1000  # time steps whose tables are kept
_NONE = -1e4  # exp of it is 0


class _ByStep(ABC):
    """Tables that depend on the time step; they are kept."""

    def __init__(self) -> None:
        self._made: dict[float, Floats] = {}

    def table(self, dt: float) -> Floats:
        """Give the table for a step of dt [s]."""
        key = round(dt, 9)
        if key not in self._made:
            if len(self._made) > _KEPT:
                self._made.clear()
            self._made[key] = self._make(key)
        return self._made[key]

    @abstractmethod
    def _make(self, dt: float) -> Floats:
        """Make the table for a step of dt [s]."""


class ErrorTables(_ByStep):
    """The errors of all sets of parameters: a table (S, ERROR_ROWS, Q) per time step, as the kernel takes it.

    Errors of heading have the other sign: what they are added to is pi less the heading.
    """

    def __init__(self, sets: list[ErrorModels]) -> None:
        super().__init__()
        self.sets = sets
        self.root = _root(_coupling(sets[0])[0])  # makes drifts, as they are at first, of normals
        self.root[_HEADING] *= -1.0
        sizes = [getattr(errors, name) for errors in sets for name in ("length", "width")]
        self.sizes = any(
            any(e.bias.model_dump().values()) or e.drift.constant or e.noise.constant for e in sizes
        )

    def _make(self, dt: float) -> Floats:
        return np.array([_table(one, dt) for one in self.sets])


def _table(errors: ErrorModels, dt: float) -> Floats:
    out = np.zeros((ERROR_ROWS, Q))
    for k, name in enumerate(QUANTITIES):
        error = getattr(errors, name)
        slopes = [getattr(error.bias, feature) for feature in FEATURES]
        out[BIAS + k, : 1 + len(FEATURES)] = error.bias.constant, *slopes
        out[DRIFT_SPREAD + k] = _log_spread(error.drift)
        out[NOISE_SPREAD + k] = _log_spread(error.noise)
    stationary, rates = _coupling(errors)
    out[DRIVE : DRIVE + Q] = _root(stationary * -np.expm1(-dt * (rates[:, None] + rates)))
    out[KEEP] = np.exp(-dt * rates)
    out[BIAS + _HEADING] *= -1.0
    out[DRIVE + _HEADING] *= -1.0
    return out


def _log_spread(spread: Spread) -> Floats:
    row = np.zeros(Q)
    row[0] = _NONE
    if spread.constant > 0.0:
        slopes = [getattr(spread, feature) for feature in FEATURES]
        row[: 1 + len(FEATURES)] = math.log(spread.constant), *slopes
    return row


def _coupling(errors: ErrorModels) -> tuple[Floats, Floats]:
    """Give the correlation (Q, Q) of the drifts, and the rates [1/s] (Q,) at which they are forgotten."""
    times = np.array([getattr(errors, name).correlation_time for name in QUANTITIES])
    driving = np.eye(Q) if errors.coupling is None else np.array(errors.coupling)
    return driving * 2.0 * np.sqrt(np.outer(times, times)) / (times[:, None] + times), 1.0 / times


def _root(covariance: Floats) -> Floats:
    """Give a lower triangle L with L L' the covariance, which may be singular."""
    out = np.zeros_like(covariance)
    for k in range(len(out)):
        rest = covariance[k:, k] - out[k:, :k] @ out[k, :k]
        if rest[0] > 1e-12 * max(covariance[k, k], 1e-300):
            out[k:, k] = rest / math.sqrt(rest[0])
    return out


class DetectionTables(_ByStep):
    """The chain of detection: a table (3, R, B, O) per time step of the probability to be detected next, by state
    (LOST, DETECTED, FRESH) and bins. Without bins always 1.
    """

    def __init__(self, detection: Detection) -> None:
        super().__init__()
        inner = [e[1:-1] for e in (detection.range_edges, detection.bearing_edges, detection.occlusion_edges)]
        self.edges = np.full((3, max(map(len, inner))), np.inf)
        """Inner edges of range [m], |bearing| [rad] and occlusion, filled up with infinity."""
        for row, edges in zip(self.edges, inner, strict=True):
            row[: len(edges)] = edges
        always = np.zeros((1, 1, 1))
        self.loss, self.gain = (np.array(c) if c else always for c in (detection.loss, detection.gain))
        self.first = np.array(detection.first) if detection.first else detected_share(self.loss, self.gain)

    def _make(self, dt: float) -> Floats:
        lost, gained = probabilities(self.loss, self.gain, dt)
        return np.array([gained, 1.0 - lost, self.first])
