"""The accident-risk kernel, compiled by numba: Monte-Carlo prediction, contact, time to react (Wagner 2021, 4.1).

One call works through all scenes. What is compiled is kept on disk, by the sources of all modules here: numba itself
looks at that of the called function's module alone, and would run what is outdated, or fail to read it.
"""

# mypy: ignore-errors
from __future__ import annotations

import hashlib
import math
from pathlib import Path

import numpy as np

from resim.core.compiled import entry
from resim.metrics.risk.kernel.borrowed import borrowed
from resim.metrics.risk.kernel.motion import COS, ROWS, SIN, VX, VY, X, Y, ctra
from resim.metrics.risk.kernel.scene import assess
from resim.metrics.risk.kernel.work import RiskArrays, Road, Sampling, SceneArrays

_TEXT = b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py")))
SOURCES = hashlib.sha256(_TEXT).hexdigest()[:16]


def _entry(function):
    """Compile what is called from outside. Its name, by which numba's cache knows it, has the sources in it."""
    function.__qualname__ = f"{function.__name__}_{SOURCES}"
    return entry()(function)


@_entry
def kernel(scenes, road, sampling, out):
    """Fill out, the RiskArrays of SceneArrays, Road and Sampling; see `accident_risk`."""
    assess(borrowed(scenes), borrowed(road), borrowed(sampling), borrowed(out))
    return 0  # the arguments' owners are in Python, and wait


@_entry
def ctra_plans(state, h, steps):
    """Plans (S, steps + 1, 4) x, y, heading, v of states (S, 6) whose acceleration and yaw rate are kept."""
    out = np.empty((state.shape[0], steps + 1, 4))
    path = np.empty((1, ROWS, steps + 1))
    for n in range(state.shape[0]):
        x, y, heading, v, a, rate = state[n]
        start = (x, y, math.cos(heading), math.sin(heading), v)
        ctra(start, (a, rate), h, bool(1), path, np.int64(0))
        for j in range(steps + 1):
            cos, sin = path[0, COS, j], path[0, SIN, j]
            out[n, j, 0], out[n, j, 1], out[n, j, 2] = path[0, X, j], path[0, Y, j], math.atan2(sin, cos)
            out[n, j, 3] = (path[0, VX, j] * cos + path[0, VY, j] * sin) / h
    return out


__all__ = ["RiskArrays", "Road", "Sampling", "SceneArrays", "ctra_plans", "kernel"]
