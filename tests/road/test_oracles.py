"""Every map that ships or is in the shared data, against quadrature of its own numbers, pyxodr, the way back.

The quadrature reads the XML itself and shares no code with the evaluator: it integrates the heading of each
<geometry>, inverts arc lengths by bisection and adds up the widths of lanes.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from road.quadrature import FILES, OWN, network, number, profile, raw_roads

from resim.road.opendrive.index import foot

REFUSED: dict[str, str] = {}
"""Maps that cannot be loaded, and why: none of the collection."""

SEVERAL_S = {
    *(f"ngsim/USA_{name}_T-1.xodr" for name in ("Lanker-1_17", "US101-5_1", "US101-10_1", "US101-12_1", "US101-22_1")),
    *(f"xodr/edge_cases/{name}.xodr" for name in
      ("od_newmarket", "sumo_elevation_roundtrip", "sumo_imprecise_geometry", "sumo_pRange", "sumo_ticket9448")),
    "mcity/mcity.xodr",
}  # fmt: skip
"""Maps on which one place has several s of its lane: it bends too sharply, or its pieces overlap."""

PLACES = 1000
MAPS = OWN | FILES
every_map = pytest.mark.parametrize("name", MAPS)
some_maps = pytest.mark.parametrize(
    "name",
    [n if n in OWN or k % 2 else pytest.param(n, marks=pytest.mark.slow) for k, n in enumerate(MAPS)],
)
"""Our own and each second of the others; `make validate` has them all."""


def samples(name):
    """Random places: every piece of every road some times, on a random lane there. Road, piece, lane, s."""
    rng = np.random.default_rng(7)
    pieces = [(road, piece) for road in raw_roads(name) for piece in road.pieces]
    for road, piece in pieces:
        low, high = road.span(piece)
        for _ in range(max(PLACES // len(pieces), 1)):
            s = rng.uniform(low, high)
            yield road, piece, int(rng.choice([0, *road.lanes(s)])), s


@every_map
def test_every_map_loads(name):
    assert name not in REFUSED
    assert network(MAPS[name]).roads


@some_maps
def test_lanes_agree_with_quadrature(name):
    net = network(MAPS[name])
    rows, truth = [], []
    for road, piece, lane, s in samples(name):
        position, heading = piece.at(s - piece.s)
        inner, outer = road.borders(lane, s)
        for share in (0.0, 0.5, 1.0):
            t = inner + share * (outer - inner)
            rows.append((road.id, lane, s, t - 0.5 * (inner + outer)))
            truth.append(position + t * 1j * np.exp(1j * heading))
    road, lane, s, t = (np.array(column) for column in zip(*rows, strict=True))
    x, y = net.to_xy(road, lane, s, t)
    worst = np.abs(x + 1j * y - np.array(truth)).max()
    assert worst < 1e-6, worst  # 1e-4 is asked for


@some_maps
def test_heights_agree_with_the_files_polynomials(name):
    net = network(MAPS[name])
    rng = np.random.default_rng(9)
    for road, _, lane, s in list(samples(name))[:400]:
        t, height = rng.uniform(-8, 8), profile(road.elevations, "s", s)
        roll = profile(road.rolls, "s", s)
        assert net.z(road.id, s, t) == pytest.approx(height + t * math.sin(roll), abs=1e-9)
        if not lane or road.lanes(s)[lane][1].find("{*}height") is None:
            across = sum(road.borders(lane, s)) / 2
            assert net.z(road.id, s, lane=lane) == pytest.approx(height + across * math.sin(roll), abs=1e-9)


def pyxodr_pieces(road, monkeypatch, folder):
    """pyxodr's own samples of each piece of the road, finer where it would take a bend for an error.

    Elements of no length, with curvatures that are no numbers in some maps, are taken out before.
    """
    from pyxodr.road_objects.road import Road

    monkeypatch.chdir(folder)  # where it puts a picture of what it takes for an error
    for geometry in road.element.findall("{*}planView/{*}geometry"):
        if number(geometry, "length") <= 1e-9:
            geometry.getparent().remove(geometry)
    for resolution in (0.5, 0.01, 0.001):
        reader = Road(road.element, resolution=resolution)
        try:
            reader.reference_line  # noqa: B018
        except ValueError as error:
            if "wrong direction" not in str(error):
                raise
            continue
        return [np.asarray(piece, dtype=float) for piece in reader.coordinates_sorted_by_distance]
    return pytest.fail(f"pyxodr cannot read road {road.id}")


@some_maps
def test_reference_lines_agree_with_pyxodr(name, monkeypatch, tmp_path):
    """With the samples it computes, not its `reference_line`: that one cuts corners between them."""
    pytest.importorskip("pyxodr")
    if "}" in raw_roads(name)[0].element.tag:
        pytest.skip("pyxodr does not read maps with an XML namespace")
    net, worst = network(MAPS[name]), 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for i, road in enumerate(raw_roads(name)):
            for piece, points in zip(road.pieces, pyxodr_pieces(road, monkeypatch, tmp_path), strict=True):
                start, end = road.span(piece)
                s = piece.s + np.linspace(0.0, piece.length, len(points))
                index = np.full(len(points), i)
                if piece.kind == "paramPoly3" and piece.curve.get("pRange") != "arcLength":
                    # its samples are even in the parameter: the place on our line is looked for
                    s[1:-1] = foot(net._lines, index, points[:, 0], points[:, 1], s)[0][1:-1]
                inside = (s > start - 1e-3) & (s < end)
                own = net._lines.evaluate(index[inside], np.clip(s[inside], start, end - 1e-9))
                miss = np.hypot(own.x - points[inside, 0], own.y - points[inside, 1])
                worst = max(worst, *miss, 0.0)
    assert worst < 1e-6, worst  # 1e-4 is asked for


@every_map
def test_there_and_back(name):
    """From driving lanes to the map and back: the same place, or the lane whose centre is nearer."""
    net = network(MAPS[name])
    rng = np.random.default_rng(11)
    places = [
        (road.id, lane, s) for road, _, lane, s in samples(name)
        if lane and net.roads[road.id].sections[net.roads[road.id].section_index(s)].lanes[lane].drivable
    ]  # fmt: skip
    road, lane, s = (np.array(column) for column in zip(*places, strict=True))
    width = net.lane_width(road, lane, s)
    road, lane, s, width = road[width > 0.1], lane[width > 0.1], s[width > 0.1], width[width > 0.1]
    t = rng.uniform(-0.49, 0.49, len(s)) * width
    x, y = net.to_xy(road, lane, s, t)
    found = net.to_road(x, y)
    assert found.on_road.all()
    x2, y2 = net.to_xy(found.road, found.lane, found.s, found.t)
    assert np.hypot(x2 - x, y2 - y).max() < 1e-6
    again = (found.road == road) & (found.lane == lane)
    same = again & (np.abs(found.s - s) < 1e-6)
    assert np.abs(found.t - t)[same].max() < 1e-6
    assert (np.abs(found.t) <= np.abs(t) + 1e-6)[~again].all()
    assert same[again].all() or name in SEVERAL_S
