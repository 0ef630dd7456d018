"""Make recordings of US-101 vehicles, each as EGO among the others: what people did, for a suite to be verified on.

    python tools/make_us101.py ../shared/data [--out scenarios/us101]

Of each of the four scenarios: every vehicle that changes lane, and of the others that are followed or following within
30 m those that are there longest, up to EACH. A vehicle counts that is there for at least 5 s. Same data, same bytes.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

import numpy as np
from validate_real import NGSIM, candidates

from resim.core.errors import ResimError
from resim.core.tracks import Tracks
from resim.recordings import read_commonroad, write_recording
from resim.road.opendrive import RoadNetwork, load
from resim.scenario import maneuvers

ROOT = Path(__file__).parents[1]
SCENARIOS = tuple(name for name in NGSIM if "US101" in name)
EACH = 10
"""Recordings of a scenario."""
LEAST, NEAR = 5.0, 30.0
"""s that a vehicle has to be there; m within which another one counts as near."""


def chosen(tracks: Tracks, network: RoadNetwork) -> list[str]:
    """Give the ids of the vehicles to record, those that change lane first, each longest first."""
    first, last = tracks.span()
    there = {i: float(b - a) for i, a, b in zip(tracks.ids.tolist(), first, last, strict=True)}
    long = sorted((i for i in there if there[i] >= LEAST), key=lambda i: (-there[i], i))
    changing = [i for i in long if _changes(tracks, network, i)]
    near = [i for i in long if i not in changing and _near(tracks, i)]
    return [*changing, *near][:EACH]


def _changes(tracks: Tracks, network: RoadNetwork, vehicle: str) -> bool:
    try:
        return bool(maneuvers.lane_changes(tracks, network, ego=vehicle))
    except ResimError:  # it leaves the map
        return False


def _near(tracks: Tracks, vehicle: str) -> bool:
    """Whether somebody is near for at least half of the vehicle's time."""
    row = tracks.index(vehicle)
    apart = np.hypot(tracks.x - tracks.x[row], tracks.y - tracks.y[row])
    apart[row] = np.nan
    some = np.nan_to_num(apart, nan=np.inf).min(axis=0) < NEAR
    return bool(some[tracks.valid[row]].mean() >= 0.5)


def make(data: Path, name: str, out: Path, count: int = EACH) -> list[str]:
    """Write up to `count` recordings of one scenario as folders of `out`; gives their names."""
    xml, road = data / "ngsim" / f"{name}.xml", data / "ngsim" / f"{name}.xodr"
    network, made = load(road), []
    everybody = read_commonroad(xml, map=road, ego=candidates(xml, 1)[0]).gt  # of the longest
    for ego in chosen(everybody, network)[:count]:
        recording = read_commonroad(xml, map=road, ego=ego)
        shutil.rmtree(out / recording.name, ignore_errors=True)
        write_recording(recording, out / recording.name)
        made.append(recording.name)
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--out", type=Path, default=ROOT / "scenarios" / "us101")
    asked = parser.parse_args()
    for name in SCENARIOS:
        print(f"{name}: {', '.join(made.rpartition('_')[2] for made in make(asked.data, name, asked.out))}")


if __name__ == "__main__":
    main()
