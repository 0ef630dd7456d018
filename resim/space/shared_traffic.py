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
    lasts = np.maximum.reduceat(t, first) - np.minimum.reduceat(t, first)
    who = np.asarray(found.groupby(["recording", "object"], sort=False).ngroup(), dtype=np.intp)
    out = []
    for one, two, apart in _alike(found, row, int((~found["new"]).sum())):
        later = int(row[two[0]])
        longest = np.maximum(lasts, lasts[later])
        earlier = {
            k
            for shift in (0.0, 0.5)
            for k in _agree(row[one], np.floor(apart / CLOCK + shift), (who[one], who[two]), longest)
        }
        out += [(str(names[k]), str(names[later])) for k in sorted(earlier)]
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
        if not len(one):
            continue
        along = (x[two] - x[one]) * np.cos(course[one]) + (y[two] - y[one]) * np.sin(course[one])
        yield one, two, t[two] - t[one] - along / (0.5 * (v[one] + v[two]))


def _agree(of: Ints, when: Floats, who: tuple[Ints, Ints], lasts: Floats) -> list[int]:
    """Give the recordings of which more vehicles agree on a time between clocks than by chance.

    of, when, who (H,): number of the recording, of the time, and of both vehicles of what is alike; lasts (R,) [s]: of
    each recording, or of the one that it is held against if that is longer: over which times spread by chance.
    """
    column = [when.astype(np.intp) - int(when.min()), *who]
    place = np.unique(of * (1 + column[0].max()) + column[0], return_inverse=True)[1]
    one, two = (np.unique(place * (1 + part.max()) + part, return_index=True)[1] for part in column[1:])
    most = np.minimum(*(np.bincount(place[rows]) for rows in (one, two)))
    recording = of[np.unique(place, return_index=True)[1]]
    every = np.unique(np.stack([place, *who]), axis=1)[0]
    first = np.flatnonzero(np.diff(recording, prepend=-1))
    recording, most = recording[first], np.maximum.reduceat(most, first)
    times = np.maximum(lasts[recording] / CLOCK, 1.0)
    by_chance = np.maximum(np.add.reduceat(np.bincount(every), first) - most, 1) / times
    chance = 2.0 * times * gammainc(most, by_chance)  # that at least so many do at any time
    return [int(one) for one in recording[(most >= LEAST) & (chance <= CHANCE)]]
