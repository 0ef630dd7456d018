"""Functional measures, on lists and answers of which all is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from resim.metrics.drive import drive
from resim.metrics.measures import State
from resim.metrics.measures import functional as f
from resim.metrics.measures.functional import FunctionActivity


@pytest.fixture
def overtaking(described, network):
    scenario = described("overtake")
    begin = scenario.ego.spawn_time
    t = np.round(begin + np.arange(0.0, 5.0, 0.1), 9)
    return drive(scenario.tracks(network, t), ego=scenario.ego.id)


def at_work(drive, *, every=0.2, until=5.0, lost=()):
    """Lists every 0.2 s until a time, with all objects but those lost; answers with each list."""
    lists = np.arange(0.0, until, every)
    seen = np.ones((len(drive.ids), len(lists)), dtype=bool)
    for name, start, end in lost:
        seen[drive.ids.index(name), (lists >= start - 1e-9) & (lists < end - 1e-9)] = False
    return FunctionActivity(lists, np.array(drive.ids), seen, every, lists)


def test_all_is_well_where_lists_and_answers_come_in_time(overtaking):
    work = at_work(overtaking)
    for of in (f.function_availability, f.perception_availability, f.detection_rate):
        assert (of(overtaking, work).value == 1.0).all()
    np.testing.assert_allclose(f.cycle_time(overtaking, work).value[2:], 0.2)
    assert (f.cycle_time(overtaking, work).state[:2] == State.NOT_DEFINED).all()
    np.testing.assert_allclose(f.latency(overtaking, work).value, np.tile([0.0, 0.1], 25), atol=1e-9)
    late = f.latency(overtaking, replace(work, delay=0.15))
    np.testing.assert_allclose(late.value, np.tile([0.15, 0.25], 25), atol=1e-9)


def test_what_breaks_off_is_not_available_after_half_a_period_more(overtaking):
    work = at_work(overtaking, until=3.0)
    for of in (f.function_availability, f.perception_availability):
        found = of(overtaking, work).value
        assert (found[:32] == 1.0).all()  # the last list came at 2.8 s
        assert (found[32:] == 0.0).all()
    assert f.latency(overtaking, work).value[-1] == pytest.approx(4.9 - 2.8)


def test_an_object_that_is_lost_is_not_detected(overtaking):
    name = overtaking.ids[0]
    work = at_work(overtaking, lost=[(name, 1.0, 2.0)])
    found = f.detection(overtaking, work)
    near = found.state[:, 0] == State.VALUE
    assert near.all()
    gone = found.value[:, 0] == 0.0
    assert overtaking.t[gone] == pytest.approx(np.arange(1.2, 1.99, 0.1))  # after one and a half periods
    rate = f.detection_rate(overtaking, work).value
    assert rate[gone] == pytest.approx(1.0 - 1.0 / (found.state[gone] == State.VALUE).sum(axis=1))


def test_far_objects_need_not_be_seen_and_parts_of_one_are_that_one(overtaking):
    state = overtaking.scenes.state.copy()
    state[:, 1, 0] += 500.0
    far = replace(overtaking, scenes=replace(overtaking.scenes, state=state))
    assert (f.detection(far, at_work(overtaking)).state[:, 1] == State.NO_CONFLICT).all()
    state[..., 0] += 500.0
    nobody = f.detection_rate(replace(far, scenes=replace(far.scenes, state=state)), at_work(overtaking))
    assert (nobody.state == State.NO_CONFLICT).all()  # and so nobody is missed
    parted = replace(overtaking, ids=(f"{overtaking.ids[0]}~2", *overtaking.ids[1:]))
    assert (f.detection(parted, at_work(overtaking)).value[:, 0] == 1.0).all()


def test_what_perception_saw_is_not_held_against_itself(overtaking):
    seen = replace(at_work(overtaking), of_truth=False)
    assert (f.detection(overtaking, seen).state == State.NOT_DEFINED).all()
    assert (f.detection_rate(overtaking, seen).state == State.NOT_DEFINED).all()


def test_what_was_not_recorded_is_not_computed(overtaking):
    for of in (f.function_availability, f.perception_availability, f.cycle_time, f.latency, f.detection,
               f.detection_rate):  # fmt: skip
        assert (of(overtaking, None).state == State.NOT_COMPUTED).all()
    once = replace(at_work(overtaking), answers=np.array([0.3]), lists=np.array([0.3]), period=np.inf)
    for of in (f.function_availability, f.perception_availability, f.cycle_time):
        assert (of(overtaking, once).state == State.NOT_COMPUTED).all()  # nobody knows when the next is late
    driven = replace(at_work(overtaking), lists=None, period=np.inf)
    assert (f.function_availability(overtaking, driven).value == 1.0).all()
    assert (f.detection(overtaking, driven).state == State.NOT_COMPUTED).all()
    silent = replace(at_work(overtaking), answers=None)
    assert (f.cycle_time(overtaking, silent).state == State.NOT_COMPUTED).all()
    assert (f.perception_availability(overtaking, silent).value == 1.0).all()
