"""Mined folders and spaces of slot traces of known kinds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from space.families import FAMILIES, drawn

from resim.space.build import build_space
from resim.space.model import Space
from resim.space.settings import DEFAULT_SETTINGS, SpaceSettings
from resim.space.sources import ROWS, DrivenRecording, MinedSource
from resim.space.traces import joined

KINDS = tuple(FAMILIES)


def source(
    name: str,
    kinds: list[str],
    seed: int,
    hours: float = 1.0,
    build: str = "",
    together: int = 1,
    each: int = 1,
) -> MinedSource:
    """A source with a scenario of each kind named, evenly over hours of driving at 100 km/h.

    together: how many scenarios, one after the other, see the same maneuvers; each: how many a recording has at least.
    """
    rng = np.random.default_rng(seed)
    names = [f"{name}_{k}" for k in range(len(kinds))]
    traces = joined([drawn(kind, one, rng, 0.7) for kind, one in zip(kinds, names, strict=True)])
    n = len(kinds)
    drives = [f"{name}/{k // max(together, each)}" for k in range(n)]
    told = {
        "scenario": names, "recording": drives, "ego": ["a"] * n, "start": np.arange(n) * 10.0,
        "end": np.arange(n) * 10.0 + 8.0, "map": ["m-1"] * n, "road": ["1"] * n, "along_s": [True] * n,
        "lanes": [3] * n,
        "vehicles": [4] * n, "tag": ["left"] * n, "folder": [""] * n, "build": [build] * n, "collided": [False] * n,
        "occasion": np.arange(n) // together, "hours": hours * (np.arange(n) + 1.0) / n,
        "kilometres": 100.0 * hours * (np.arange(n) + 1.0) / n,
    }  # fmt: skip
    count = len(set(drives))
    driven = tuple(
        DrivenRecording(one, hours / count, 100.0 * hours / count, "m-1", "a", build)
        for one in dict.fromkeys(drives)
    )
    return MinedSource(
        name,
        Path(f"/{name}"),
        f"hash of {name} {seed}",
        "every",
        driven,
        pd.DataFrame(told)[list(ROWS)],
        traces,
        (),
    )


def space_of(
    kinds: list[str],
    seed: int = 0,
    hours: float = 1.0,
    settings: SpaceSettings = DEFAULT_SETTINGS,
    build: str = "",
) -> Space:
    return build_space([source("one", kinds, seed, hours, build)], settings)
