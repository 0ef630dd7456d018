"""A model's parameters as the arrays that one cycle multiplies with."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.perception.chain import detected_share, probabilities
from resim.perception.model import FEATURES, MANEUVERS, QUANTITIES, Detection, Errors, PerceptionModel, Spread
from resim.perception.world import BRAKING, LANE_CHANGE

Q = len(QUANTITIES)
CONSTANT, SIGNED, ABSOLUTE = 0, slice(1, 5), slice(5, 8)
"""Rows of the conditions (8, N): 1; range, bearing, relative speed, acceleration; absolute values of the last three."""
CONDITIONS = 8
CHANCES = slice(CONDITIONS, CONDITIONS + 2 * Q)
"""Rows of the standard normal numbers after the conditions: what drives the drifts, later the drifts; noises."""
BIAS, SPREADS, DRIVE, KEEP = slice(0, Q), slice(Q, 3 * Q), slice(3 * Q, 4 * Q), slice(4 * Q, 5 * Q)
"""Rows of what `ErrorTables` gives: bias; logarithms of the drift's and the noise's spread; what drives the
standardised drift; what is kept of it."""
OUTCOMES = 5 * Q
_HEADING = QUANTITIES.index("heading")
_KEPT = 1000  # time steps and sets whose tables are kept
_NONE = -1e4  # exp of it is 0

LOST, DETECTED, FRESH = 0, 1, 2
"""States of the chain of detection."""


class ErrorTables:
    """The errors of all sets of parameters: one matrix per time step, (S * OUTCOMES, CONDITIONS + Q).

    It takes the conditions and Q standard normals to the outcomes of every set. Errors of heading have the other sign:
    what they are added to is pi less the heading.
    """

    def __init__(self, sets: list[Errors]) -> None:
        self.sets = sets
        self.made: dict[tuple[float, tuple[int, ...]], Floats] = {}
        self.root = _root(
            _coupling(sets[0])[0]
        )  # makes standardised drifts, as they are at first, of normals
        each = [getattr(errors, name) for errors in sets for name in QUANTITIES]
        self.any = any(
            any(e.bias.model_dump().values()) or e.drift.constant or e.noise.constant for e in each
        )
        sizes = [getattr(errors, name) for errors in sets for name in ("length", "width")]
        self.sizes = any(
            any(e.bias.model_dump().values()) or e.drift.constant or e.noise.constant for e in sizes
        )

    def matrix(self, dt: float, used: tuple[int, ...]) -> Floats:
        """Give the matrix of the sets `used` for a step of dt [s]."""
        key = round(dt, 9), used
        found = self.made.get(key)
        if found is None:
            if len(self.made) > _KEPT:
                self.made.clear()
            found = self.made[key] = np.concatenate([_matrix(self.sets[one], dt) for one in used])
        return found


def _matrix(errors: Errors, dt: float) -> Floats:
    out = np.zeros((OUTCOMES, CONDITIONS + Q))
    for k, name in enumerate(QUANTITIES):
        error = getattr(errors, name)
        out[k, CONSTANT] = error.bias.constant
        out[k, SIGNED] = [getattr(error.bias, feature) for feature in FEATURES]
        out[Q + k] = _log_spread(error.drift)
        out[2 * Q + k] = _log_spread(error.noise)
    stationary, rates = _coupling(errors)
    out[DRIVE, CONDITIONS:] = _root(stationary * -np.expm1(-dt * (rates[:, None] + rates)))
    out[KEEP, CONSTANT] = np.exp(-dt * rates)
    out[BIAS.start + _HEADING] *= -1.0
    out[DRIVE.start + _HEADING] *= -1.0
    return out


def _log_spread(spread: Spread) -> Floats:
    row = np.zeros(CONDITIONS + Q)
    row[CONSTANT] = _NONE
    if spread.constant > 0.0:
        row[CONSTANT], row[SIGNED.start] = math.log(spread.constant), spread.range
        row[ABSOLUTE] = spread.bearing, spread.relative_speed, spread.acceleration
    return row


def _coupling(errors: Errors) -> tuple[Floats, Floats]:
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


class Maneuvers:
    """Which set of parameters objects have: 0 the pooled ones, then those of the model's maneuvers."""

    def __init__(self, model: PerceptionModel) -> None:
        set_of = np.array(
            [list(model.maneuvers).index(m) + 1 if m in model.maneuvers else 0 for m in MANEUVERS]
        )
        follow, left, right, brakes = set_of
        self._sets = np.array([right, follow, left, brakes, brakes, brakes])
        self._across = np.array([np.nextafter(-LANE_CHANGE, -1.0), LANE_CHANGE])

    def sets(self, turned: Floats, v: Floats, gained: Floats, dt: Floats) -> NDArray[np.intp]:
        """Give `maneuver` as set of parameters: turned [rad] is pi less the relative heading, v [m/s], and
        gained [m/s] the speed since dt [s] ago.
        """
        across = np.sin(turned)
        across *= v
        found = self._across.searchsorted(across)
        found += 3 * (gained < BRAKING * dt)
        return self._sets.take(found)


class DetectionTables:
    """The chain of detection, by bin: the probability to be detected next, for each state."""

    def __init__(self, detection: Detection) -> None:
        self.any = len(detection.loss) > 0
        self.inner = [
            np.array(e[1:-1])
            for e in (detection.range_edges, detection.bearing_edges, detection.occlusion_edges)
        ]
        self.hides = len(self.inner[2]) > 0
        loss, gain = np.array(detection.loss), np.array(detection.gain)
        self.shape, self.bins = loss.shape, loss.size
        self.loss, self.gain = loss.ravel(), gain.ravel()
        self.made: dict[float, Floats] = {}

    def probabilities(self, dt: float) -> Floats:
        """Give (3 * bins,): by state (LOST, DETECTED, FRESH) and bin, after a step of dt [s]."""
        key = round(dt, 9)
        found = self.made.get(key)
        if found is None:
            if len(self.made) > _KEPT:
                self.made.clear()
            lost, gained = probabilities(self.loss, self.gain, dt)
            found = np.concatenate([gained, 1.0 - lost, detected_share(self.loss, self.gain)])
            self.made[key] = found
        return found

    def cells(self, distance: Floats, bearing: Floats, occlusion: Floats | None) -> NDArray[np.intp]:
        """Give the bin of each object, by range [m], |bearing| [rad] and occlusion."""
        out = self.inner[0].searchsorted(distance, "right")
        if self.shape[1] > 1:
            out *= self.shape[1]
            out += self.inner[1].searchsorted(bearing, "right")
        if occlusion is not None:
            out *= self.shape[2]
            out += self.inner[2].searchsorted(occlusion, "right")
        return out
