"""How a traffic object may go on: distributions of its acceleration and yaw rate, by kind and state (Eq. 4.2)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib.resources import files

import numpy as np

from resim.core.geometry import Bools, Floats


@dataclass(frozen=True)
class Surfaces:
    """Means and standard deviations of acceleration a [m/s²] and yaw rate w [rad/s] over the next second.

    mu_a = A tanh(a0 / A), A = a_most / (1 + v / v_half); sigma_a = sigma_a0 + sigma_a1 |a0|;
    mu_w = W tanh(w0 / W), W = lateral_most / v; sigma_w = sigma_lateral / v + sigma_w1 |w0|, v at least v_least.
    v_most, a_range [m/s²] and lateral_range [m/s²] bound the states they were fitted to.
    """

    a_most: float
    v_half: float
    sigma_a0: float
    sigma_a1: float
    lateral_most: float
    sigma_lateral: float
    sigma_w1: float
    v_least: float
    v_most: float
    a_range: tuple[float, float]
    lateral_range: tuple[float, float]

    def inputs(self, v: Floats, a0: Floats, w0: Floats) -> Floats:
        """Give mu_a, sigma_a, mu_w, sigma_w (..., 4) of states (...)."""
        speed = np.maximum(np.abs(v), self.v_least)
        most_a, most_w = self.a_most / (1.0 + speed / self.v_half), self.lateral_most / speed
        return np.stack(
            [
                most_a * np.tanh(a0 / most_a), self.sigma_a0 + self.sigma_a1 * np.abs(a0),
                most_w * np.tanh(w0 / most_w), self.sigma_lateral / speed + self.sigma_w1 * np.abs(w0),
            ],
            axis=-1,
        )  # fmt: skip

    def covers(self, v: Floats, a0: Floats, w0: Floats) -> Bools:
        """Say which states (...) lie in the range that the surfaces were fitted to."""
        lateral = v * w0
        return np.asarray(
            (np.abs(v) <= self.v_most) & (a0 >= self.a_range[0]) & (a0 <= self.a_range[1])
            & (lateral >= self.lateral_range[0]) & (lateral <= self.lateral_range[1])
        )  # fmt: skip


def _published() -> Surfaces:
    data = json.loads(files("resim.assess.risk").joinpath("prediction.json").read_text(encoding="utf-8"))
    return Surfaces(**data["kinds"]["car"])


PUBLISHED = _published()
"""Cars, as published; see the provenance in prediction.json."""
