"""Accident risk over all lane changes of the four US-101 scenarios, beside Wagner 2021, Fig. 4.14.

    python tools/validate_lane_changes.py ../shared/data [--picture FILE]

The EGO of a scenario is the vehicle that changes lane; the scenario lasts from 3 s before its centre crosses the
border to 3 s after, as far as it was recorded. Its risk is the largest of its scenes.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from validate_real import NGSIM, candidates

from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.core.tracks import Tracks
from resim.metrics.drive import PathSource, drive
from resim.metrics.risk import DEFAULTS, RiskParameters
from resim.metrics.risk.prediction import prediction
from resim.recordings import read_commonroad
from resim.resimulation.run import describe_recording
from resim.road.opendrive import load
from resim.scenario import maneuvers

AROUND, EDGE, LEAST = 3.0, 0.3, 2.0
"""s before and after the change; s left out at the ends of a recorded track; least s of a scenario."""
PUBLISHED_MEAN, PUBLISHED_ZERO = 0.00063, 0.379
"""Of Fig. 4.14, 1000 scenarios of highD."""
ZERO = 1e-6
"""Risk below which a scenario counts as without."""


@dataclass(frozen=True)
class Way:
    """A way to compute the risk; smooth: s over which speed, heading and their rates are averaged, yawing: with
    the objects' yaw rates, else they keep their heading."""

    name: str
    prediction: str = "published"
    path: PathSource = "driven"
    parameters: RiskParameters = DEFAULTS
    smooth: float = 0.0
    yawing: bool = True


WAYS = (
    Way("as recorded, EGO's state kept", path="state"),
    Way(
        "as recorded, EGO's state kept, published algorithm",
        path="state",
        parameters=RiskParameters(mode="published"),
    ),
    Way("as recorded, EGO's driven path"),
    Way("as recorded, EGO's driven path, prediction refitted to NGSIM", prediction="ngsim"),
    Way("averaged over 1 s", smooth=1.0),
    Way("averaged over 2 s", smooth=2.0),
    Way("averaged over 2 s, objects without yaw rate", smooth=2.0, yawing=False),
)
SHOWN = (2, 5, 6)
"""Of WAYS, in the picture."""


def changes(data: Path, name: str) -> list[tuple[str, str, Tracks]]:
    """Give the lane changes of a recording: vehicle, side, and everybody's tracks around it, ten times a second."""
    road = data / "ngsim" / f"{name}.xodr"
    network = load(road)
    xml = data / "ngsim" / f"{name}.xml"
    recording = read_commonroad(xml, map=road, ego=candidates(xml, 1)[0])
    scenario = describe_recording(recording, network)["GT"]
    begin = scenario.ego.spawn_time
    tracks = scenario.tracks(network, np.round(begin + np.arange(0.0, scenario.duration + 1e-9, 0.1), 9))
    out = []
    for vehicle, first, last in zip(tracks.ids.tolist(), *tracks.span(), strict=True):
        try:
            found = maneuvers.lane_changes(tracks, network, ego=vehicle)
        except ResimError:
            continue
        for t, side in found:
            start, end = max(t - AROUND, first + EDGE), min(t + AROUND, last - EDGE)
            if end - start >= LEAST:
                out.append((vehicle, side, tracks.window(start - 1e-9, end + 1e-9)))
    return out


def changed(tracks: Tracks, way: Way) -> Tracks:
    """Give the tracks as this way takes them."""
    window = 2 * round(5.0 * way.smooth) + 1  # samples, 10 Hz

    def mean(values: Floats) -> Floats:
        return pd.DataFrame(values.T).rolling(window, center=True, min_periods=1).mean().to_numpy().T

    heading = np.where(tracks.valid, np.unwrap(np.nan_to_num(tracks.heading)), np.nan)
    rate = tracks.yaw_rate if way.yawing else np.where(tracks.valid, 0.0, np.nan)
    motion = {"v": tracks.v, "a": tracks.a, "heading": heading, "yaw_rate": rate}
    return replace(
        tracks, **{name: np.where(tracks.valid, mean(values), np.nan) for name, values in motion.items()}
    )


def risks(found: list[tuple[str, str, Tracks]], way: Way) -> Floats:
    """Give the largest risk of each lane change."""
    made = (
        drive(changed(tracks, way), ego=vehicle, path=way.path, parameters=way.parameters,
              predicted=prediction(way.prediction))
        for vehicle, _, tracks in found
    )  # fmt: skip
    return np.array([one.risk(way.parameters).r_ind.max() for one in made])


def draw(by_way: dict[str, Floats], file: Path) -> None:
    figure, axes = plt.subplots(
        len(by_way), 1, sharex=True, figsize=(9.0, 2.2 * len(by_way)), layout="constrained"
    )
    bins = np.logspace(-6, 0, 37)
    for axis, (name, values) in zip(np.atleast_1d(axes), by_way.items(), strict=True):
        some = values[values >= ZERO]
        axis.hist(some, bins=bins, color="#0072B2")
        axis.axvline(
            PUBLISHED_MEAN, color="#D55E00", linestyle="--", label="0.063 %, mean in Fig. 4.14 (highD)"
        )
        axis.axvline(np.median(values), color="black", label=f"median {100 * np.median(values):.2g} %")
        axis.set(
            xscale="log",
            ylabel="lane changes",
            title=f"{name}: {len(values)}, {len(values) - len(some)} at zero",
        )
        axis.legend(loc="upper left", frameon=False, fontsize=9)
    np.atleast_1d(axes)[-1].set_xlabel("largest accident risk of the scenario [1]")
    figure.savefig(file, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--picture", type=Path)
    asked = parser.parse_args()
    found = [change for name in NGSIM if "US101" in name for change in changes(asked.data, name)]
    sides = [side.rpartition("_")[2] for _, side, _ in found]
    print(f"{len(found)} lane changes, {sides.count('left')} to the left\n")
    print("| way | at zero | median | mean | 90 % | largest |\n|---|---|---|---|---|---|")
    print(f"| Fig. 4.14: 1000 lane changes of highD | {100 * PUBLISHED_ZERO:.0f} % | – | 0.063 % | – | – |")
    by_way: dict[str, Floats] = {}
    for n, way in enumerate(WAYS):
        values = risks(found, way)
        if n in SHOWN:
            by_way[way.name] = values
        cells = [np.median(values), values.mean(), np.quantile(values, 0.9), values.max()]
        told = " | ".join(f"{100 * cell:.2g} %" for cell in cells)
        print(f"| {way.name} | {100 * (values < ZERO).mean():.0f} % | {told} |")
    lateral = np.concatenate([np.abs(t.v * t.yaw_rate)[t.valid] for _, _, t in found])
    along = np.concatenate([np.abs(t.a)[t.valid] for _, _, t in found])
    for name, values in (("along", along), ("lateral", lateral)):
        told = ", ".join(f"{x:.2g}" for x in np.quantile(values, [0.5, 0.9, 0.99]))
        print(f"\nacceleration {name} as recorded, 50, 90, 99 % of |a|: {told} m/s²")
    if asked.picture:
        draw(by_way, asked.picture)


if __name__ == "__main__":
    main()
