"""A running simulation as it runs: its latest state, and the roads around its EGO."""

from __future__ import annotations

import json
import os
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.road.opendrive import VEHICLE_LANES, LaneShape, load
from resim.supervisor.processes import opened
from resim.supervisor.runner import LIVE

AROUND, STEP = 400.0, 3.0
"""m around the EGO in which roads are drawn, and m between the points of their borders."""
MOST_STATE = 300_000
"""Bytes of a state."""


def read_state(folder: Path, seen: int = 0) -> tuple[dict[str, Any] | None, int]:
    """Give the latest state of a task's simulation, None where there is none or it is the one seen, and its stamp."""
    try:
        with opened(folder / LIVE) as file:
            stamp = os.fstat(file.fileno()).st_mtime_ns
            if stamp == seen:
                return None, seen
            found = json.loads(file.read(MOST_STATE))
    except (OSError, ValueError, RecursionError):
        return None, seen
    return (found, stamp) if isinstance(found, dict) else (None, seen)


def roads_around(folder: Path) -> dict[str, Any]:
    """Give what is drawn of the map that a state names: `lanes`, rings of vehicle lanes, and `lines`, their borders.

    Each is a flat list x, y, x, y ... [cm] from `origin` [m]; `reach` [m]: how far around it. Without lanes where no
    state is there, or its map cannot be read.
    """
    state, _ = read_state(folder)
    nothing = {"origin": [0.0, 0.0], "reach": 0.0, "lanes": [], "lines": []}
    try:
        ego = state["boxes"][0]  # type: ignore[index]
        origin = np.array([float(ego[2]), float(ego[3])])
        if not np.isfinite(origin).all():
            return nothing
        file = Path(state["map"])  # type: ignore[index]
        shapes = _shapes(file, file.stat().st_mtime_ns)
    except (OSError, ResimError, ValueError, TypeError, LookupError, OverflowError):
        return nothing
    lanes, lines = [], []
    for shape in shapes:
        near = np.flatnonzero(np.hypot(*(shape.centre - origin).T) < AROUND)
        if not len(near):
            continue
        part = slice(max(int(near[0]) - 1, 0), int(near[-1]) + 2)
        left, right = shape.left[part], shape.right[part]
        if shape.type in VEHICLE_LANES:
            lanes.append(_flat(np.concatenate([left, right[::-1]]), origin))
        if shape.mark != "none":
            lines.append(_flat(left if shape.lane > 0 else right, origin))
    return {"origin": origin.tolist(), "reach": AROUND, "lanes": lanes, "lines": lines}


def _flat(points: Floats, origin: Floats) -> list[int]:
    """Whole centimetres (2 K,) from the origin."""
    return np.rint(100.0 * (points - origin)).astype(int).ravel().tolist()


@lru_cache(maxsize=4)
def _shapes(file: Path, stamp: int) -> list[LaneShape]:
    """The lanes of a map as it is at a time."""
    return load(file).lane_shapes(STEP)
