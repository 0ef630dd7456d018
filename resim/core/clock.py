"""Times [s] on clocks that may begin anywhere, also at seconds since 1970, where a double holds 2.4e-7 s."""

from __future__ import annotations

import numpy as np

from resim.core.geometry import Floats

TICK = 1e-6
"""s; times closer than this are one."""


def regular(start: float, duration: float, step: float) -> Floats:
    """Give times (T,) [s] from start on, `step` apart, up to start + duration, which is one of them where it fits."""
    since = step * np.arange(int(np.floor((duration + TICK) / step)) + 1)
    return np.asarray(start + np.minimum(since, duration))
