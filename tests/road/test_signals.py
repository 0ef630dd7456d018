"""Speed-limit signs: what they show, where they hold, and what comes before what."""

from __future__ import annotations

import math

import numpy as np
import pytest
from lxml import etree

from resim.core.errors import InputError
from resim.road.opendrive import load
from resim.road.opendrive.signs import shown

LINE = '<geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry>'
WIDTH = '<width sOffset="0" a="3" b="0" c="0" d="0"/>'
LANES = (
    '<laneSection s="0"><left><lane id="1" type="driving">{width}</lane></left><right>'
    '<lane id="-1" type="driving">{width}{own}</lane><lane id="-2" type="driving">{width}</lane></right>'
    "</laneSection>"
)


@pytest.fixture
def limits(one_road):
    """Gives the limits [km/h] of a lane at s, on a road with these signals, lane speeds and road types."""

    def ask(signals, lane, s, *, own="", types="", attributes=""):
        extra = f"{types}<signals>{signals}</signals>"
        lanes = LANES.format(width=WIDTH, own=own)
        net = load(one_road(LINE, lanes=lanes, extra=extra, attributes=attributes))
        return net.speed_limit("7", lane, np.array(s)) * 3.6

    return ask


def sign(s, value, *, inside="", orientation="+", more='type="274" unit="km/h"', name="x"):
    place = f'id="{name}" s="{s}" t="-5" orientation="{orientation}"'
    return f'<signal {place} dynamic="no" country="DE" value="{value}" {more}>{inside}</signal>'


@pytest.mark.parametrize(
    ("signal", "speed"),
    [
        ('country="DE" type="274" subtype="-1" value="80" unit="km/h"', 80 / 3.6),
        ('country="OpenDRIVE" type="274" subtype="-1" value="3.0e+1" unit="mph"', 30 * 0.44704),
        ('type="274" value="50"', 50 / 3.6),
        ('country="DEU" type="274" subtype="100"', 100 / 3.6),
        ('country="DEU" type="274" subtype="55" value="-1"', 50 / 3.6),
        ('country="DEU" type="274" subtype="60"', 60 / 3.6),
        ('country="DEU" type="274" subtype="60" countryRevision="2013"', 100 / 3.6),
        ('country="DE" type="274.1"', 30 / 3.6),
        ('country="DE" type="274.1" subtype="20"', 20 / 3.6),
        ('country="DE" type="274" value="13.89" unit="m/s"', 13.89),
        ('country="USA" type="R2-1" value="55" unit="mph"', 55 * 0.44704),
        ('country="US" type="R2-1" value="55"', 55 * 0.44704),
        ('country="SE" type="C31" value="70" unit="km/h"', 70 / 3.6),
        ('type="maximum speed" value="70" unit="km/h"', 70 / 3.6),
        ('country="DE" type="278" value="80"', math.inf),
        ('country="DE" type="282"', math.inf),
        ('country="USA" type="R2-1" value="13.4112" unit="km/h"', math.nan),  # m/s called km/h: 30 mph
        ('country="DE" type="274" value="0"', math.nan),
        ('country="DE" type="274" value="80" unit="furlong"', math.nan),
        ('country="DE" type="274"', math.nan),
        ('country="USA" type="274" value="80"', None),
        ('country="OpenDRIVE" type="1000001" value="-1"', None),
    ],
)
def test_what_a_sign_shows(signal, speed):
    found = shown(etree.fromstring(f"<signal {signal}/>"))
    assert found is None if speed is None else found == pytest.approx(speed, nan_ok=True)


def test_a_sign_holds_from_its_place_on_in_the_direction_it_faces(limits):
    two = sign(30, 50) + sign(60, 30) + sign(80, 70, orientation="-")
    np.testing.assert_allclose(limits(two, -1, [10, 30, 59, 60, 100]), [np.nan, 50, 50, 30, 30])
    np.testing.assert_allclose(limits(two, 1, [100, 81, 79, 0]), [np.nan, np.nan, 70, 70])
    both = sign(40, 50, orientation="none")
    np.testing.assert_allclose(limits(both, [-1, -1, 1, 1], [39, 41, 39, 41]), [np.nan, 50, 50, np.nan])


def test_left_hand_traffic_reads_them_from_the_other_side(limits):
    np.testing.assert_allclose(limits(sign(30, 50), [-1, 1], 50.0, attributes='rule="LHT"'), [np.nan, 50])


def test_the_end_of_a_limit_gives_the_road_its_own_back(limits):
    types = '<type s="0" type="rural"><speed max="100" unit="km/h"/></type>'
    signs = sign(30, 50) + sign(60, "", more='type="278"')
    np.testing.assert_allclose(limits(signs, -1, [10, 40, 70], types=types), [100, 50, 100])


def test_validity_names_lanes(limits):
    only = sign(30, 50, inside='<validity fromLane="-1" toLane="-2"/>') + sign(
        60, 30, inside='<validity fromLane="-2" toLane="-2"/><validity fromLane="1" toLane="1"/>'
    )
    np.testing.assert_allclose(limits(only, [-1, -2], [[40], [70]]), [[50, 50], [50, 30]])


def test_a_lane_record_wins_over_a_sign_and_a_sign_over_the_road(limits):
    own = '<speed sOffset="40" max="20" unit="km/h"/><speed sOffset="60" max="no limit"/>'
    own += '<speed sOffset="80" max="undefined"/>'
    types = '<type s="0" type="rural"><speed max="100" unit="km/h"/></type>'
    found = limits(sign(20, 50), [-1, -2], [[10], [30], [50], [70], [90]], own=own, types=types)
    np.testing.assert_allclose(found, [[100, 100], [50, 50], [20, 50], [np.nan, 50], [50, 50]])


def test_signs_that_change_or_say_nothing_are_passed_over(limits):
    signs = sign(10, 50) + sign(20, 30).replace('dynamic="no"', 'dynamic="yes"') + sign(30, 13.4112)
    np.testing.assert_allclose(limits(signs, -1, [50]), [50])


def test_a_reference_puts_a_sign_on_another_place(limits):
    signs = sign(10, 50, orientation="-") + '<signalReference id="x" s="60" t="0" orientation="+"/>'
    np.testing.assert_allclose(limits(signs, -1, [50, 70]), [np.nan, 50])


def test_an_orientation_that_is_none_is_named(limits):
    with pytest.raises(InputError, match="road 7, signal x: orientation='up'"):
        limits(sign(10, 50, orientation="up"), -1, [5])


def test_signs_of_real_maps(shared_map):
    """The file calls metres per second km/h, and no sign shows 13.4112 km/h: no limit rather than a wrong one."""
    signs = [s for road in shared_map("ngsim/USA_Lanker-1_17_T-1.xodr").roads.values() for s in road.signs]
    assert len(signs) == 33
    assert all(math.isnan(sign.speed) for sign in signs)
    assert "value=13.4112, unit=km/h" in signs[0].text
    assert not any(road.signs for road in shared_map("xodr/carla/Town04.xodr").roads.values())
