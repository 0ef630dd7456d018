"""What the intervals of a smoothed map are of: the smoothed share, not the share at a place."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from resim.sweeps.statistics.boundary import smooth_map

MESH = np.linspace(0.0, 1.0, 25)
FINE = (np.arange(200) + 0.5) / 200.0


def share(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    """The true share: over 0.5 + 0.2 b it falls, within a width or at once."""
    off = a - 0.5 - 0.2 * b
    return 1.0 / (1.0 + np.exp(off / width)) if width else (off < 0.0).astype(float)


@pytest.mark.parametrize(("points", "seeds"), [(64, 1), (256, 5)])
@pytest.mark.parametrize("width", [0.0, 0.15])
def test_intervals_hold_the_smoothed_share(points: int, seeds: int, width: float) -> None:
    held, beside = list[bool](), list[bool]()
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u = qmc.Sobol(2, rng=rng).random(points)
        y = (rng.random((points, seeds)) < share(u[:, 0], u[:, 1], width)[:, None]).astype(float)
        found = smooth_map(y, u, MESH, MESH, (MESH, MESH))
        assert found.width is not None
        kernel = np.exp(-0.5 * ((MESH[:, None] - FINE) / found.width) ** 2)
        kernel /= kernel.sum(axis=1, keepdims=True)
        smoothed = kernel @ share(FINE[None], FINE[:, None], width) @ kernel.T
        known, place = np.isfinite(found.share), share(MESH[None], MESH[:, None], width)
        for out, truth in ((held, smoothed), (beside, place)):
            out += ((found.low - 1e-9 <= truth) & (truth <= found.high + 1e-9))[known].tolist()
    assert np.mean(held) >= 0.93
    if width == 0.0 and points == 64:
        assert np.mean(beside) < 0.8  # what the page says: beside a sharp boundary a place lies outside
