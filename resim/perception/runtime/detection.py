"""Which objects are seen: the chain of detection, and the field of view."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from resim.perception.model import Detection, FieldOfView
from resim.perception.runtime.kernel import FRESH
from resim.perception.runtime.tables import DetectionTables

Columns = NDArray[np.intp]


class DetectionState:
    """What is seen of N objects in B runs: `reach` [m] and `opening` [rad] (B,); `state` (B, N) remembers who was
    detected last. edges (B, 3, E), bins of occlusion (B,): of the tables. detected (B, 3, R, B, O): the probabilities
    to be detected next, by state and bins.
    """

    def __init__(self, detections: Sequence[Detection], views: Sequence[FieldOfView]) -> None:
        self.tables = [DetectionTables(detection) for detection in detections]
        most = max(tables.edges.shape[1] for tables in self.tables)
        self.edges = np.array([
            np.pad(tables.edges, ((0, 0), (0, most - tables.edges.shape[1])), constant_values=np.inf)
            for tables in self.tables
        ])  # fmt: skip
        self.bins = np.array([tables.loss.shape[2] for tables in self.tables])
        shapes = np.array([tables.loss.shape for tables in self.tables]).max(axis=0)
        self.detected = np.zeros((len(self.tables), 3, *shapes))
        view = [[math.inf if c is None else c for c in (view.range, view.bearing)] for view in views]
        self.reach, self.opening = np.array(view).T.copy()
        self.clear()

    def clear(self) -> None:
        """Forget all objects."""
        self.state = np.zeros((len(self.tables), 0), dtype=np.intp)

    def step(self, b: int, dt: float) -> None:
        """Take the probabilities of a run for steps of dt [s]."""
        table = self.tables[b].table(dt)
        self.detected[b, :, : table.shape[1], : table.shape[2], : table.shape[3]] = table

    def regroup(self, kept: Columns, before: Columns, n: int) -> None:
        """Change to n columns: those `before` go to `kept`, and the others are new."""
        old, self.state = self.state, np.full((len(self.tables), n), FRESH)
        self.state[:, kept] = old[:, before]
