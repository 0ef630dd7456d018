"""Roads drawn at random against the files' own numbers: no record is lost, wherever it begins."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from lxml import etree
from road.generated import opendrive, roads
from road.quadrature import RawRoad, last_before, number, profile
from road.test_conversion import place, polylines

from resim.road.opendrive import RoadNetwork, load
from resim.road.sumo import sumo_net

BESIDE = 1e-6
"""Near where a record begins, but not so near that rounding decides which one holds."""


def quietly(most):
    return settings(
        max_examples=most, deadline=None, derandomize=True, database=None,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large],
    )  # fmt: skip


def one_lane(start, offset, tag="width", *, aside=None):
    """A lane that widens, at once, by a metre at `offset` in the section that begins at `start`.

    aside: where all lanes are moved by a metre.
    """
    moved = "" if aside is None else f'<laneOffset s="{aside!r}" a="1" b="0" c="0" d="0"/>'
    side = -1.0 if tag == "border" else 1.0
    shapes = "".join(
        f'<{tag} sOffset="{s!r}" a="{side * a}" b="0" c="0" d="0"/>' for s, a in ((0.0, 3.0), (offset, 4.0))
    )
    lane = f'<right><lane id="-1" type="driving">{shapes}</lane></right>'
    other = lane.replace(shapes, '<width sOffset="0" a="3" b="0" c="0" d="0"/>')
    center = '<center><lane id="0" type="none"/></center>'
    sections = "".join(
        f'<laneSection s="{s!r}">{center}{own}</laneSection>' for s, own in ((0.0, other), (start, lane))
    )
    return (
        f'<road id="1" length="1000" junction="-1"><planView><geometry s="0" x="0" y="0" hdg="0" length="1000"><line/>'
        f"</geometry></planView><lanes>{moved}{sections}</lanes></road>"
    )


def written(folder, road):
    path = folder / "drawn.xodr"
    path.write_text(opendrive(road))
    return path, RawRoad(etree.fromstring(road))


def places(raw, seed):
    """Lanes and s: random ones, and both sides of every s at which a record of the road or of a section begins."""
    begins = {number(e, "s") for e in (*raw.offsets, *raw.elevations, *raw.rolls, *raw.sections)}
    for section, start in zip(raw.sections, raw.starts, strict=True):
        begins |= {start + number(e, "sOffset") for e in section.iter("width", "border", "speed")}
    length = raw.pieces[-1].length
    near = [s + side * BESIDE for s in sorted(begins) for side in (-1, 1)]
    for s in (*np.random.default_rng(seed).uniform(0.0, length, 20), *near):
        if 0.0 < s < length:
            yield from ((lane, float(s)) for lane in raw.lanes(s))


@given(road=roads(), seed=st.integers(0, 9))
@example(road=one_lane(100.1, 50.3), seed=0)
@example(road=one_lane(300.7, 17.1, "border"), seed=0)
@example(road=one_lane(100.1, 50.3, aside=150.4), seed=0)  # at one place but for the last bit
@example(road=one_lane(100.1, 50.3, aside=math.nextafter(150.4, 0)), seed=0)
@example(road=one_lane(100.1, 50.3, aside=math.nextafter(150.4, 200)), seed=0)
@quietly(25)
def test_no_record_is_lost(tmp_path, road, seed):
    path, raw = written(tmp_path, road)
    net = load(path)
    lane, s = (np.array(column) for column in zip(*places(raw, seed), strict=True))
    x, y = net.to_xy("1", lane, s, 0.0)
    truth = np.array([place(raw, *each) for each in zip(lane.tolist(), s.tolist(), strict=True)])
    assert np.hypot(x - truth[:, 0], y - truth[:, 1]).max() < 1e-6
    borders = np.array([raw.borders(*each) for each in zip(lane.tolist(), s.tolist(), strict=True)])
    side = np.where(lane > 0, 1.0, -1.0)
    np.testing.assert_allclose(
        net.lane_width("1", lane, s), side * (borders[:, 1] - borders[:, 0]), atol=1e-9
    )
    height = [
        profile(raw.elevations, "s", each) + 3.0 * math.sin(profile(raw.rolls, "s", each))
        for each in s.tolist()
    ]
    np.testing.assert_allclose(net.z("1", s, 3.0), height, atol=1e-9)


@given(road=roads(), seed=st.integers(0, 9))
@quietly(10)
def test_no_speed_limit_is_lost(tmp_path, road, seed):
    path, raw = written(tmp_path, road)
    net = load(path)
    for lane, s in places(raw, seed):
        section, element = raw.lanes(s)[lane]
        limits = [e for e in element.iterfind("speed") if number(section, "s") + number(e, "sOffset") <= s]
        known = last_before(limits, "sOffset", s - number(section, "s")) if limits else None
        expected = math.nan if known is None else number(known, "max")
        assert net.speed_limit("1", lane, s) == pytest.approx(expected, nan_ok=True)


@given(road=roads())
@example(road=one_lane(100.1, 50.3))
@quietly(3)
def test_nets_are_where_the_file_says_and_tell_it(tmp_path, road):
    """Steps of a lane cannot be one line in SUMO that is exact: they are told, and the rest is."""
    path, raw = written(tmp_path, road)
    converted = sumo_net(load(path), cache=tmp_path / "nets")
    shapes = polylines(converted.path)
    for lane in converted.conversion.lanes:
        start = raw.starts[lane.section]
        end = min([*raw.starts[lane.section + 1 : lane.section + 2], raw.pieces[-1].length])
        line = shapely.multilinestrings(
            [shapely.linestrings(each) for each in shapes["1", lane.section, lane.lane]]
        )
        s = np.random.default_rng(1).uniform(start, end, 30).tolist()
        worst = max(line.distance(shapely.Point(place(raw, lane.lane, each))) for each in s)
        assert worst <= lane.worst + 1e-4
        assert worst < 0.005


def test_the_error_that_is_told_does_not_come_from_the_evaluator_that_made_the_net(tmp_path, monkeypatch):
    """An evaluator that puts every lane 30 cm aside is found out, and by how much."""
    path, _ = written(tmp_path, one_lane(100.1, 50.3))
    exact = RoadNetwork.to_xy
    monkeypatch.setattr(
        RoadNetwork, "to_xy", lambda self, road, lane, s, t: exact(self, road, lane, s, t + 0.3)
    )
    conversion = sumo_net(load(path), cache=tmp_path / "nets").conversion
    assert {round(lane.worst, 3) for lane in conversion.lanes} == {0.3}
    assert len(conversion.bad) == len(conversion.lanes)
