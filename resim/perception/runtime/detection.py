"""Which objects are seen: the chain of detection, and the field of view."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from resim.perception.model import Detection, FieldOfView
from resim.perception.runtime.kernel import FRESH
from resim.perception.runtime.tables import DetectionTables

Columns = NDArray[np.intp]


class DetectionState:
    """What is seen of N objects: `reach` [m] and `opening` [rad]; `state` (N,) remembers who was detected last."""

    def __init__(self, detection: Detection, view: FieldOfView) -> None:
        self.tables = DetectionTables(detection)
        self.edges = self.tables.edges
        self.reach, self.opening = (math.inf if c is None else c for c in (view.range, view.bearing))
        self.clear()

    def clear(self) -> None:
        """Forget all objects."""
        self.state = np.zeros(0, dtype=np.intp)

    def regroup(self, kept: Columns, before: Columns, n: int) -> None:
        """Change to n columns: those `before` go to `kept`, and the others are new."""
        old, self.state = self.state, np.full(n, FRESH)
        self.state[kept] = old[before]
