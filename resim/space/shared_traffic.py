"""Recordings of the same traffic, whoever recorded it: noisy copies of a drive, and vehicles that drove in one place.

Maneuvers have a place and a time, whichever vehicle sees them and by whichever clock. Two recordings saw the same
traffic where many vehicles of the one were each at the place of one of the other with its speed, all of them the same
time later: clocks differ by one number. By chance vehicles do so at any time; how many then agree on one is Poisson.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree
from scipy.special import gammainc

from resim.core.geometry import Floats
from resim.space.traces import Ints

LABELS = (
    "lane_change_left", "lane_change_right", "pass", "overtaking_right", "enter_highway", "exit_highway", "road_widens",
    "lane_ends", "turn_left", "turn_right",
)  # fmt: skip
"""Maneuvers that have a moment of their own: others begin where a vehicle comes into sight."""
COLUMNS = ("recording", "object", "map", "label", "t", "x", "y", "v", "course")
"""Of moments.parquet: recording: source and name; t [s] by its clock; x, y [m] in the map's frame, v [m/s] and course
[rad] of the object then."""
TEXTS = COLUMNS[:4]
PLACE, SPEED, TURN = 10.0, 1.0, 0.5
"""m, m/s, rad by which moments of a vehicle differ at most in two recordings (our choice: noise lets maneuvers begin
earlier or later; times between clocks are told at the same place)."""
CLOCK = 0.5
"""s within which times between clocks are one."""
SLOWEST = 2.0
"""m/s: at less, noise tells when somebody is where."""
CHANCE = 1e-5
"""Probability, at most, that so many vehicles of two recordings agree by chance on any time (our choice)."""
LEAST = 4
"""Vehicles that have to agree, at least."""


def no_moments() -> pd.DataFrame:
    """Give a table with COLUMNS of no moment."""
    types = {name: "string" if name in TEXTS else "float64" for name in COLUMNS}
    return pd.DataFrame(columns=list(COLUMNS)).astype(types)


def moments(maneuvers: pd.DataFrame, place: pd.Series[str]) -> pd.DataFrame:
    """Give a row per moment with COLUMNS. maneuvers: as `resim mine` writes them; place: map of each recording."""
    own = maneuvers[maneuvers["label"].isin(LABELS) & (maneuvers["v_mps"] >= SLOWEST)]
    own = own[own[["x_from", "y_from", "x_to", "y_to"]].notna().all(axis=1)]
    last, way = own["end"] - own["start"], (own["x_to"] - own["x_from"], own["y_to"] - own["y_from"])
    share = ((own["t"] - own["start"]) / last.where(last > 0.0, np.inf)).clip(0.0, 1.0)
    moves = np.hypot(*way) > 0.0
    found = pd.DataFrame(
        {
            "recording": own["recording"], "object": own["object"], "map": own["recording"].map(place),
            "label": own["label"], "t": own["t"], "x": own["x_from"] + share * way[0],
            "y": own["y_from"] + share * way[1], "v": own["v_mps"], "course": np.arctan2(way[1], way[0]),
        }
    )[moves]  # fmt: skip
    return found.astype(dict.fromkeys(TEXTS, "string")).reset_index(drop=True)


def recordings_of_one_traffic(found: pd.DataFrame, new: set[str]) -> list[tuple[str, str]]:
    """Give pairs of recordings that saw the same traffic, of each at least one of `new`. found: of `moments`."""
    if not len(found):
        return []
    found = found.assign(new=found["recording"].isin(new)).sort_values(
        ["new", "recording"], ignore_index=True
    )
    names, first = np.unique(found["recording"].to_numpy(str), return_index=True)
    names, first = names[np.argsort(first)], np.sort(first)
    row = np.repeat(np.arange(len(names)), np.diff(first, append=len(found)))
    t = found["t"].to_numpy(float)
    lasts = [float(np.ptp(part)) for part in np.split(t, first[1:])]
    who = np.asarray(found.groupby(["recording", "object"], sort=False).ngroup(), dtype=np.intp)
    out = []
    for one, two, apart in _alike(found, row, int((~found["new"]).sum())):
        order = np.argsort(row[one], kind="stable")
        for k in np.split(order, np.flatnonzero(np.diff(row[one[order]])) + 1):
            if not len(k):
                continue
            a, b = int(row[one[k[0]]]), int(row[two[k[0]]])
            if _agree(who[one[k]], who[two[k]], apart[k], max(lasts[a], lasts[b])):
                out.append((str(names[a]), str(names[b])))
    return out


def _alike(found: pd.DataFrame, row: Ints, since: int) -> Iterator[tuple[Ints, Ints, Floats]]:
    """Moments (H,) that are alike, of a later recording with all earlier ones at once, and times between clocks [s]."""
    code = found.groupby(["map", "label"]).ngroup().to_numpy(float)
    t, x, y, v, course = (found[name].to_numpy(float) for name in ("t", "x", "y", "v", "course"))
    points = np.column_stack([3.0 * code, x / PLACE, y / PLACE, v / SPEED])
    tree = cKDTree(points)
    starts = since + np.flatnonzero(np.diff(row[since:], prepend=-1))
    for low, high in pairwise([*starts.tolist(), len(row)]):
        hits = cKDTree(points[low:high]).sparse_distance_matrix(tree, 1.0, p=np.inf, output_type="ndarray")
        one, two = hits["j"], low + hits["i"]
        same_way = np.cos(course[one] - course[two]) >= np.cos(TURN)
        keep = (row[one] < row[two]) & same_way
        one, two = one[keep], two[keep]
        along = (x[two] - x[one]) * np.cos(course[one]) + (y[two] - y[one]) * np.sin(course[one])
        yield one, two, t[two] - t[one] - along / (0.5 * (v[one] + v[two]))


def _agree(one: Ints, two: Ints, apart: Floats, lasts: float) -> bool:
    """Say whether more vehicles agree on a time between clocks than by chance.

    one, two, apart (H,): numbers of vehicles of both recordings that are alike, and times [s]; lasts [s]: of the longer
    recording, over which times spread by chance.
    """
    times = max(lasts / CLOCK, 1.0)
    for shift in (0.0, 0.5):
        when = np.floor(apart / CLOCK + shift).astype(np.intp)
        pairs = np.unique(np.column_stack([when, one, two]), axis=0)
        counts = [np.unique(np.unique(pairs[:, [0, k]], axis=0)[:, 0], return_counts=True)[1] for k in (1, 2)]
        most = int(np.minimum(*counts).max())
        by_chance = max(len(pairs) - most, 1) / times
        if (
            most >= LEAST and 2.0 * times * gammainc(most, by_chance) <= CHANCE
        ):  # P(at least so many), any time
            return True
    return False
