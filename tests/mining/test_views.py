"""Scenarios from above: what is drawn is where it is on the map, and no more than fits in."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import ROOT
from mining.planted import Drive, path_of, smooth, steady, tracks_of

from resim.core.tracks import Tracks
from resim.mining.page.views import EGO, HEIGHT, OTHER, WIDTH, LaneBorders, top_view
from resim.road.opendrive import RoadNetwork, load

SPACE = {"s": "http://www.w3.org/2000/svg"}


@pytest.fixture(scope="module")
def road() -> RoadNetwork:
    return load(ROOT / "networks" / "motorway.xodr")


def drawn(tracks: Tracks, road: RoadNetwork) -> dict[str, list[np.ndarray]]:
    """The lines of a view, by colour."""
    text = str(top_view("one", tracks, "a", LaneBorders(road))).replace(
        "<svg", f'<svg xmlns="{SPACE["s"]}"', 1
    )
    out: dict[str, list[np.ndarray]] = {}
    for path in ElementTree.fromstring(text).findall("s:path", SPACE):
        for line in path.get("d", "").split("M")[1:]:
            points = np.array([[float(n) for n in re.split("[, ]", one)] for one in line.split("L")])
            out.setdefault(path.get("stroke", ""), []).append(points)
    return out


def test_ways_begin_and_end_where_they_do_and_lanes_lie_between(road: RoadNetwork) -> None:
    name = next(iter(road.roads))
    path = path_of(road, name, -1, 100.0, 260.0)
    change = Drive("b", lambda t: 30.0 + 20.0 * t, lambda t: -smooth(t, 2.0, 4.0, 3.5), end=8.0)
    tracks = tracks_of(path, [Drive("a", steady(20.0), end=8.0), change])
    lines = drawn(tracks, road)
    (ego,), (other,) = lines.pop(EGO), lines.pop(OTHER)
    (borders,) = lines.values()
    assert (ego[0, 0], other[-1, 0]) == pytest.approx((6.0, WIDTH - 6.0), abs=0.2)
    assert abs(ego[-1, 1] - other[-1, 1]) > 5.0 > abs(ego[0, 1] - other[0, 1]) - 1.0
    everything = np.concatenate([ego, other, *borders])
    assert everything.min() >= 0.0
    assert (everything.max(axis=0) <= (WIDTH, HEIGHT)).all()
    at_end = [
        np.interp(WIDTH - 6.0, *line[np.argsort(line[:, 0])].T)
        for line in borders
        if np.ptp(line[:, 0]) > 200.0
    ]
    low, high = sorted((ego[-1, 1], other[-1, 1]))
    assert sum(low < y < high for y in at_end) == 1  # the border that was crossed


def test_one_sample_is_drawn_too(road: RoadNetwork) -> None:
    path = path_of(road, next(iter(road.roads)), -1, 100.0, 60.0)
    tracks = tracks_of(path, [Drive("a", steady(20.0), end=1.0), Drive("b", steady(20.0), end=0.0)])
    assert len(drawn(tracks, road)[OTHER]) == 1
