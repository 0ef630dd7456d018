"""Where a scenario does not describe what was measured: traces that are off the positions they were fitted to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from resim.road.opendrive import RoadNetwork
from resim.scenario.course import beyond_noise, position_noise
from resim.scenario.scenario import Scenario


@dataclass(frozen=True)
class Misfit:
    """An object whose trace is farther from its positions than their noise explains.

    off: m, at its largest, at t [s]. noise: m, of each coordinate.
    """

    object: str
    off: float
    t: float
    noise: float


def find_misfits(scenario: Scenario, positions: pd.DataFrame, network: RoadNetwork) -> Iterator[Misfit]:
    """Give the objects whose traces are off, in the order of the table.

    positions: what was described: a table of t [s], id, x, y [m]; an object's parts may be one in it.
    """
    times = np.unique(positions["t"].to_numpy(float))
    traces = scenario.tracks(network, times)
    if not set(traces.parts()) & set(positions["id"]):
        traces = traces.joined()
    row = {name: n for n, name in enumerate(traces.ids.tolist())}
    for name, own in positions.groupby("id", sort=False):
        if (n := row.get(str(name))) is None:
            continue
        t, place = own["t"].to_numpy(float), own["x"].to_numpy(float) + 1j * own["y"].to_numpy(float)
        at = np.searchsorted(times, t)
        off = np.nan_to_num(np.abs(traces.x[n, at] + 1j * traces.y[n, at] - place))
        worst, noise = int(np.argmax(off)), position_noise(t, place)
        if off[worst] > beyond_noise(noise):
            yield Misfit(str(name), float(off[worst]), float(t[worst]), noise)
