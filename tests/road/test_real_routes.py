"""Whoever was measured is on the route that he drove: all vehicles of NGSIM, and the Mcity trials."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import DATA
from lxml import etree

from resim.recordings import read_commonroad, recording_of
from resim.recordings.formats.mcity import import_trial
from resim.recordings.formats.mcity_frames import trials
from resim.road.driven_route import driven_route, first_off_route
from resim.road.opendrive import load

NGSIM = [
    *(f"USA_US101-{n}_1_T-1" for n in (5, 10, 12, 22)),
    "USA_Lanker-1_17_T-1",
]
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="no shared data")


def left(network, tracks):
    """Who is said to have left his own route, by his own samples and by each third and tenth of them."""
    out, looked = [], 0
    for n, name in enumerate(tracks.ids.tolist()):
        own = np.flatnonzero(tracks.valid[n])
        if len(own) < 20:
            continue
        route = driven_route(network, tracks.x[n, own], tracks.y[n, own], tracks.heading[n, own])
        for every in (1, 3, 10):
            k = own[::every]
            if (
                first_off_route(network, route, tracks.x[n, k], tracks.y[n, k], tracks.heading[n, k])
                is not None
            ):
                out.append((name, every))
        looked += bool(route.steps)
    return out, looked


@pytest.mark.parametrize("name", NGSIM)
def test_no_vehicle_of_ngsim_leaves_the_route_that_it_drove(name):
    xml, road = DATA / "ngsim" / f"{name}.xml", DATA / "ngsim" / f"{name}.xodr"
    root = etree.parse(xml).getroot()
    moving = [*root.iterfind("obstacle"), *root.iterfind("dynamicObstacle")]
    longest = max(moving, key=lambda one: len(one.findall(".//state")))
    recording = read_commonroad(xml, map=road, ego=longest.get("id"))
    off, looked = left(load(road), recording.gt)
    assert looked > 20
    assert off == []


def test_no_trial_of_mcity_leaves_the_route_that_it_drove():
    folder = DATA / "mcity"
    network = load(folder / "mcity.xodr")
    for trial in trials(folder):
        recording = recording_of(import_trial(trial, folder, network))
        own = recording.gt.select([recording.ego])
        assert left(network, own)[0] == [], trial
