"""The nets of all maps against the files' own numbers: errors computed here, not read from the converter."""

from __future__ import annotations

from collections import defaultdict
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import shapely
from lxml import etree
from road.quadrature import FILES, network, raw_roads
from scipy.spatial import cKDTree

from resim.road.sumo import EXACT, VARIED, sumo_net

REFUSED: dict[str, str] = {}
"""Maps that are not converted, and why: none of the collection."""

PLACES = 8
some_maps = pytest.mark.parametrize(
    "name",
    [n if k % 8 == 0 else pytest.param(n, marks=pytest.mark.slow) for k, n in enumerate(sorted(FILES))],
)
"""Each eighth map; `make validate` has them all."""


@pytest.fixture(scope="session")
def net_of(tmp_path_factory):
    nets = tmp_path_factory.mktemp("nets")
    return lambda name: sumo_net(network(FILES[name]), cache=nets)


def polylines(path):
    """(road, section, lane) -> the polylines of its SUMO lanes; the net's own words, `origId`."""
    found = defaultdict(list)
    for lane in etree.parse(str(path)).getroot().iter("lane"):
        points = np.array([p.split(",") for p in lane.get("shape").split()], dtype=float)
        for param in lane.iterfind("param[@key='origId']"):
            for place in param.get("value").split():
                road, section, number = place.rsplit("_", 2)
                found[road, int(section), int(number)].append(points)
    return found


def exact_places(name):
    """Every lane of every section, and some exact places of its centre by quadrature."""
    rng = np.random.default_rng(3)
    for road in raw_roads(name):
        length = road.pieces[-1].s + road.pieces[-1].length
        for k, start in enumerate(road.starts):
            end = min([*road.starts[k + 1 : k + 2], length])
            if end - start < 1e-6:
                continue
            for lane in road.lanes(0.5 * (start + end)):
                if lane:
                    yield (
                        (road.id, k, lane),
                        np.array([place(road, lane, s) for s in rng.uniform(start, end, PLACES)]),
                    )


def place(road, lane, s):
    inner, outer = road.borders(lane, s)
    piece = next(p for p in reversed(road.pieces) if p.s <= s or p is road.pieces[0])
    z, heading = piece.at(s - piece.s)
    z += 0.5 * (inner + outer) * np.exp(1j * (heading + 0.5 * np.pi))
    return z.real, z.imag


@some_maps
def test_every_lane_of_every_map_is_where_the_file_says(net_of, name):
    converted = net_of(name)
    shapes = polylines(converted.path)
    worst = {}
    for key, places in exact_places(name):
        lines = shapely.multilinestrings([shapely.linestrings(points) for points in shapes[key]])
        worst[key] = float(shapely.distance(lines, shapely.points(places)).max())
    limits = {lane.key: lane.limit for lane in converted.conversion.lanes}
    assert {key: error for key, error in worst.items() if error > limits[key]} == {}
    told = max(lane.worst for lane in converted.conversion.lanes if lane.worst is not None)
    assert max(worst.values()) <= told + 1e-4  # what the converter tells is no better than what is


class Exact:
    """The centre line of a lane, evaluated every 5 cm and densely on specks, and how far points are from it.

    On elements of a few millimetres that bend sharply a lane far from the reference line moves by a metre.
    """

    def __init__(self, net, road, section, lane):
        here = net.roads[road].sections[section]
        start, end = here.start, min(here.end, net.roads[road].length) - 1e-9
        parts = [np.linspace(start, end, int(20 * (end - start)) + 2)]
        for g in net.roads[road].geometries:
            parts.append(np.array([g.s - 1e-9, g.s]))
            if g.length < 1.0:
                parts.append(np.linspace(g.s, g.s + g.length - 1e-9, 600))
        s = np.unique(np.concatenate(parts))
        self.xy = np.stack(net.to_xy(road, lane, s[(s >= start) & (s <= end)], 0.0), axis=1)
        self.tree = cKDTree(self.xy)

    def distance(self, points):
        nearest = self.tree.query(points)[1]
        low, high = np.maximum(nearest - 1, 0), np.minimum(nearest + 1, len(self.xy) - 1)
        around = np.stack([self.xy[low], self.xy[nearest], self.xy[high]], axis=1)
        out = shapely.distance(shapely.linestrings(around), shapely.points(points))
        far = out > 1e-3  # where the line folds, the nearest point may be on another branch
        out[far] = shapely.distance(shapely.linestrings(self.xy), shapely.points(points[far]))
        return out


@some_maps
def test_no_point_of_a_net_is_off_its_lane(net_of, name):
    net, converted = network(FILES[name]), net_of(name)
    ways = defaultdict(list)
    for lane in converted.conversion.lanes:
        for each in lane.sumo:
            ways[each].append(lane.key)
    exact = cache(lambda key: Exact(net, *key))
    for lane in etree.parse(str(converted.path)).getroot().iter("lane"):
        if keys := ways.get(lane.get("id")):
            points = np.array([p.split(",") for p in lane.get("shape").split()], dtype=float)
            assert np.min([exact(key).distance(points) for key in keys], axis=0).max() < VARIED


def steps(path):
    """Every pair of (road, lane) that a connection of the net passes one after the other."""
    root = etree.parse(str(path)).getroot()
    lanes = {}
    for lane in root.iter("lane"):
        places = " ".join(param.get("value") for param in lane.iterfind("param[@key='origId']")).split()
        lanes[lane.get("id")] = [(place.rsplit("_", 2)[0], int(place.rsplit("_", 2)[2])) for place in places]
    found = set()
    for c in root.iterfind("connection"):
        if not c.get("from").startswith(":"):
            names = [f"{c.get('from')}_{c.get('fromLane')}", c.get("via"), f"{c.get('to')}_{c.get('toLane')}"]
            found |= set(pairwise([place for name in names for place in lanes[name]]))
    return found


def can_be_driven(net, junction, connection, one, other):
    """Whether both lanes exist and traffic leaves one where it enters the other."""
    road, way = net.roads.get(connection.incoming), net.roads.get(connection.connecting)
    if road is None or way is None or 0 in (one, other):
        return False
    back = way.predecessor if connection.contact == "start" else way.successor
    ends = {"start": road.predecessor, "end": road.successor}
    meets = [at for at, link in ends.items() if link is not None and link.id == junction.id]
    at = back.contact if back is not None and back.id == road.id and back.kind == "road" else meets[0]
    there = one in road.sections[-1 if at == "end" else 0].lanes
    return there and (road.along(one) == (at == "end")) == (
        way.along(other) == (connection.contact == "start")
    )


@some_maps
def test_every_lane_link_of_a_junction_is_a_way_in_the_net(net_of, name):
    """Links between lanes that are driven against each other, or from roads that do not exist, cannot be ways."""
    net, passed = network(FILES[name]), steps(net_of(name).path)
    lost = [
        (junction.id, (c.incoming, one), (c.connecting, other))
        for junction in net.junctions.values() for c in junction.connections for one, other in c.lane_links
        if can_be_driven(net, junction, c, one, other)
        and not {((c.incoming, one), (c.connecting, other)), ((c.connecting, other), (c.incoming, one))} & passed
    ]  # fmt: skip
    assert lost == []


def test_limits_are_those_that_were_promised():
    assert (EXACT, VARIED) == (0.005, 0.01)
