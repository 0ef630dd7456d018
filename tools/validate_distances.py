"""Hold each option of the slot distance against the published one, on the scenarios of US-101.

    python tools/validate_distances.py ../shared/data

Every vehicle of the four recordings is EGO, and what anybody around it does is a scenario: lane changes as published,
and overtaking, passing and strong acceleration as well, since lane changes alone are too few. Scenarios of at least
LEAST scenes are one bucket, as those of one road and number of vehicles are a handful. The sample in highD's format is
one of these drives again, and is left out.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from make_us101 import SCENARIOS
from scipy.cluster.hierarchy import fcluster
from scipy.spatial.distance import squareform
from scipy.stats import spearmanr
from validate_real import candidates

from resim.core.geometry import Floats
from resim.jobs.mine import MineOptions, mine
from resim.recordings import read_commonroad, write_recording
from resim.space.agreement import adjusted_rand
from resim.space.clustering import choose_threshold, cut, dendrogram
from resim.space.distance import DistanceOptions, PairDistances
from resim.space.sources import read_mined
from resim.space.traces import SlotTraces

LEAST = 10
"""Scenes of a scenario: 2 s."""
TRIGGERS = (
    "lane_change_left", "lane_change_right", "overtaking_right", "pass", "strong_acceleration", "strong_braking"
)  # fmt: skip
OPTIONS = {
    "unequal": "share of time that the longer one has alone",
    "warp": "published distance that the alignment takes away",
    "speed": "difference in speed, of 10 m/s, summed over slots",
    "lane": "share of time on another lane",
    "bend": "difference in curvature, of 0.01 1/m",
}
"""What each adds to a distance, at a weight of 1."""
WEIGHTS = {
    "unequal": (0.5, 2.0),
    "warp": (0.0, 2.0),
    "speed": (0.5, 2.0),
    "lane": (0.3, 2.0),
    "bend": (0.3, 2.0),
}
"""As in the guide, and larger; of warp: seconds, 0 for the shift alone that unequal lengths ask for."""
GUIDE = DistanceOptions(unequal=0.5, warp=2.0, speed=0.5, lane=0.3, bend=0.3)
NOISE = 0.01
"""Standard deviation of the published distances' share by which they are shaken, for a measure of what chance does."""


def scenarios(data: Path) -> SlotTraces:
    """The slots of all scenarios of the four recordings."""
    with tempfile.TemporaryDirectory() as name:
        out, folders = Path(name), []
        for scenario in SCENARIOS:
            xml, road = (data / "ngsim" / f"{scenario}.{end}" for end in ("xml", "xodr"))
            recording = read_commonroad(xml, map=road, ego=candidates(xml, 1)[0])
            folders.append(out / scenario)
            write_recording(recording, folders[-1])
        rules = out / "labels.toml"
        rules.write_text(
            f"[extraction]\ntrigger = [{', '.join(f'{one!r}' for one in TRIGGERS)}]\n", encoding="utf-8"
        )
        mine(folders, out / "mined", MineOptions(labels=rules, write=False, fit=False))
        traces = read_mined(out / "mined").traces
    return traces.take(np.flatnonzero(traces.scenes >= LEAST))


def compare(traces: SlotTraces) -> None:
    """Print a row per option and weight."""
    published = PairDistances(traces).condensed()
    count = len(traces)
    threshold = choose_threshold(published, count, "complete", "silhouette").best
    own = cut(dendrogram(published, "complete"), threshold)
    kinds = int(own.max()) + 1
    print(f"{count} scenarios of {int(traces.scenes.sum()) / 5.0:.0f} s, {len(published)} pairs; {kinds} clusters"
          f" (silhouette, {threshold:.2f}); published distance {published.mean():.2f} in the mean\n")  # fmt: skip
    print("| option | rank correlation | adjusted Rand index | other nearest neighbour | what it adds, all pairs |"
          " in clusters: published | with it |\n|---|---|---|---|---|---|---|")  # fmt: skip
    for name, weights in WEIGHTS.items():
        for weight in weights:
            found = PairDistances(traces, DistanceOptions(**{name: weight})).condensed()
            added = published - found if name == "warp" else (found - published) / weight
            row(f"`{name} = {weight:g}`", published, found, (own, kinds), added)
    found = PairDistances(traces, GUIDE).condensed()
    row("all, as in the guide", published, found, (own, kinds), found - published)
    found = published * (1.0 + NOISE * np.random.default_rng(0).standard_normal(len(published)))
    row(f"none, each distance shaken by {NOISE:.0%}", published, found, (own, kinds), found - published)
    print(
        "\nWhat it adds, at a weight of 1: "
        + "; ".join(f"`{name}`: {what}" for name, what in OPTIONS.items())
        + "."
    )


def row(name: str, published: Floats, found: Floats, clusters: tuple[np.ndarray, int], added: Floats) -> None:
    """Print how far distances (P,) differ from the published ones, and what they add among members of one cluster."""
    own, kinds = clusters
    label = fcluster(dendrogram(found, "complete"), kinds, "maxclust").astype(np.intp)
    same, now = (_together(one) for one in (own, label))
    print(f"| {name} | {spearmanr(published, found).statistic:.3f} | {adjusted_rand(own, label):.2f} |"
          f" {float((_nearest(published) != _nearest(found)).mean()):.0%} | {added.mean():.3f} |"
          f" {added[same].mean():.3f} | {added[now].mean():.3f} |")  # fmt: skip


def _together(label: np.ndarray) -> np.ndarray:
    """Whether pairs (P,) are in one cluster."""
    one, two = np.triu_indices(len(label), 1)
    return np.asarray(label[one] == label[two])


def _nearest(distance: Floats) -> np.ndarray:
    """The nearest neighbour (N,) of each."""
    whole = squareform(distance)
    np.fill_diagonal(whole, np.inf)
    return np.asarray(whole.argmin(axis=1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    compare(scenarios(parser.parse_args().data))


if __name__ == "__main__":
    main()
