"""What is one draw of what traffic does: members of it are no evidence of each other.

Variations of a measured scenario, its seeds, the drive itself and windows of it that overlap all follow from what
traffic did there once. They tell what happens near it, and nothing of how much scenarios of a cluster differ: an
interval over them as if each were a scenario of its own is too narrow (a cluster sample; Kish, Survey Sampling, 1965).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from resim.space.model import Space


def scenario_draws(rows: pd.DataFrame) -> np.ndarray:
    """Give the draw (N,) of each scenario of a space, by the name of its first one.

    Scenarios that see the same maneuvers are one, and so are windows of one EGO that overlap. rows: of the space.
    """
    n = len(rows)
    if not n:
        return np.zeros(0, dtype=object)
    edges = [(np.arange(n), n + np.unique(rows["occasion"], return_inverse=True)[1])]
    ego = rows.groupby(["source", "recording", "ego"], sort=False).ngroup().to_numpy()
    start, end = rows["start"].to_numpy(float), rows["end"].to_numpy(float)
    order = np.lexsort((end, start, ego))
    until = pd.Series(end[order]).groupby(ego[order]).cummax().to_numpy()
    meets = np.flatnonzero((ego[order][1:] == ego[order][:-1]) & (start[order][1:] < until[:-1]))
    edges.append((order[meets], order[meets + 1]))
    one, two = (np.concatenate([pair[k] for pair in edges]) for k in (0, 1))
    graph = coo_array((np.ones(len(one)), (one, two)), shape=(2 * n, 2 * n))
    label = connected_components(graph, directed=False)[1][:n]
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return rows["scenario"].astype(str).to_numpy()[first[inverse]]


def recording_draws(
    space: Space, scenario: Mapping[str, str], cluster: Mapping[str, str], drive: Mapping[str, str],
    beside: Mapping[str, str],
) -> dict[str, str]:  # fmt: skip
    """Give the draw of each recording that is simulated, by key.

    scenario: of the space that each is, "" for none, by key; cluster: of each, by key; drive: that it was cut out of;
    beside: what recordings are one draw of (`DrivenTraces.draw`). One that is no scenario, of a drive that the space
    was mined of, is one draw with what was cut out of that drive and is of the same cluster.
    """
    rows = space.rows
    names, draws = rows["scenario"].astype(str).tolist(), scenario_draws(rows).tolist()
    of_scenario = dict(zip(names, draws, strict=True))
    tracks = {(one.name, name): told for one in space.sources for name, told in one.recordings.items()}
    cut = zip(rows["source"].astype(str), rows["recording"].astype(str), rows["cluster"], draws, strict=True)
    mined = dict[tuple[str, str], str]()
    for source, recording, kind, draw in cut:
        mined.setdefault((tracks.get((source, recording), ""), str(kind)), draw)
    out = {key: of_scenario[name] for key, name in scenario.items() if name in of_scenario}
    mates = dict[str, str]()
    for key, draw in out.items():
        mates.setdefault(beside.get(key, key), draw)
    for key in scenario:
        if key not in out:
            found = mined.get((drive.get(key, key), cluster.get(key, "")))
            own = beside.get(key, key)
            out[key] = found or mates.get(own, own)
    return out
