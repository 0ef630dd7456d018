"""Leaders and lanes on recordings of NGSIM, whose roads bend sharply: held against straight distances."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import DATA

from resim.mining.features import features
from resim.recordings import read_commonroad
from resim.road.opendrive import load

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="no shared data")


@pytest.mark.parametrize(("name", "ego"), [("USA_US101-22_1_T-1", "659"), ("USA_Lanker-1_17_T-1", "1548")])
def test_the_way_to_the_leader_is_as_long_as_the_straight_one(name, ego):
    """Both roads are nearly straight, and a lane is 1.5 m aside at most; a wrong place on the road is off by metres."""
    road = DATA / "ngsim" / f"{name}.xodr"
    recording = read_commonroad(DATA / "ngsim" / f"{name}.xml", map=road, ego=ego)
    found = features(recording.gt, load(road))
    samples, flow = found.samples, found.flow
    k = np.flatnonzero(flow.leader >= 0)
    ahead = flow.leader[k]
    straight = np.hypot(samples.x[ahead] - samples.x[k], samples.y[ahead] - samples.y[k])
    assert len(k) > 1000
    assert np.all(flow.distance[k] > straight - 1.5)
    assert np.all(flow.distance[k] < 1.05 * straight + 2.0)


def test_every_lane_at_a_position_is_there(subtests):
    """But for wedges at kinks of a line, in which nothing has a foot."""
    for name in ("USA_US101-22_1_T-1", "USA_Lanker-1_17_T-1"):
        network = load(DATA / "ngsim" / f"{name}.xodr")
        rng = np.random.default_rng(7)
        names = np.array(list(network.roads))
        road, s = names[rng.integers(0, len(names), 4000)], rng.random(4000)
        length = np.array([network.roads[one].length for one in road])
        x0, y0, heading = network.reference_line(road, s * length)
        t = rng.uniform(-25.0, 25.0, 4000)
        x, y = x0 - t * np.sin(heading), y0 + t * np.cos(heading)
        places = network.lanes_at(x, y)
        table = network.lane_table
        back = network.to_xy(names[table.road[places.row]], table.lane[places.row], places.s, places.t)
        off = np.hypot(back[0] - x[places.point], back[1] - y[places.point])
        with subtests.test(name):
            assert len(places.point) > 1000
            assert off.max() < 1.0
            assert np.mean(off > 1e-6) < 0.02
            assert len(np.unique(np.stack([places.point, places.row]), axis=1).T) == len(places.point)
