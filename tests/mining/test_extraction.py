"""Extraction equals a plain loop written from the texts, to the sample."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mining import plain
from mining.planted import bent, random_traffic, write_bend, write_straight

from resim.core.tracks import Tracks
from resim.mining.extraction import extract, tag
from resim.mining.features import features
from resim.mining.find import find_maneuvers
from resim.mining.settings import DEFAULT_SETTINGS
from resim.road.opendrive import RoadNetwork, load

CUTTING = DEFAULT_SETTINGS.extraction


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("rate", [10.0, 25.0])
def test_windows_and_members_are_those_of_the_plain_loop(tmp_path: Path, seed: int, rate: float) -> None:
    tracks = random_traffic(np.random.default_rng(seed), 24, 16.0, rate)
    network = load(write_straight(tmp_path / "straight.xodr"))
    objects = plain.drives(tracks.t.tolist(), tracks.x.tolist(), tracks.y.tolist(), 3)
    compare(tracks, network, objects)


@pytest.mark.parametrize("seed", range(100, 112))
def test_they_are_in_bends_over_roads_and_sections(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    bend = float(rng.choice([-1.0, 1.0]) / rng.uniform(150.0, 600.0))
    tracks = random_traffic(rng, 24, 16.0, 25.0)
    network = load(write_bend(tmp_path / "bend.xodr", bend, rng))
    objects = plain.drives(tracks.t.tolist(), tracks.x.tolist(), tracks.y.tolist(), 3, bend)
    compare(bent(tracks, bend), network, objects)


def compare(tracks: Tracks, network: RoadNetwork, objects: list[list[plain.Sample]]) -> None:
    """Lane changes, windows and members are those that plain loops find of the same samples."""
    found = features(tracks, network)
    maneuvers = find_maneuvers(found)
    made = extract(found, maneuvers, CUTTING)
    step = found.samples.step
    changes = [(m.object, int(step[m.start]), int(step[m.end]), m.label[12:], m.figures["lanes"])
               for m in maneuvers if m.label in CUTTING.trigger]  # fmt: skip
    expected = [(c.who, c.start, c.end, "left" if c.gained > 0 else "right", float(abs(c.gained)))
                for who, own in enumerate(objects) for c in plain.lane_changes(who, own)]  # fmt: skip
    assert sorted(changes) == sorted(expected)
    assert expected
    got = [plain.Window(one.ego, one.start, one.end, one.members) for one in made]
    assert got == plain.windows(objects)
    assert got


def placed(x: list[float], lanes: list[int], t: int = 50) -> Tracks:
    """Objects that drive side by side at 10 m/s, the last of which changes lane to the left."""
    times = np.arange(t) / 10.0
    n = len(x)
    xs = np.array(x)[:, None] + 10.0 * times
    ys = np.repeat(1.75 - 3.5 * np.array(lanes, dtype=float)[:, None], t, axis=1)
    u = np.clip((times - 1.0) / 2.0, 0.0, 1.0)
    ys[-1] += 3.5 * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)
    ids = np.array([str(k) for k in range(n)], dtype=str)
    return Tracks(
        t=times, ids=ids, kind=np.array(["car"] * n), x=xs, y=ys, heading=np.zeros((n, t)), v=np.full((n, t), 10.0),
        length=np.full(n, 4.0), width=np.full(n, 1.8), valid=np.ones((n, t), dtype=bool),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("ahead", "slot"), [(5.0, 6), (-5.0, 6), (5.1, 7), (100.0, 7), (100.1, None), (-50.0, 5), (-50.1, None)]
)
def test_borders_of_slots_are_inside(tmp_path: Path, ahead: float, slot: int | None) -> None:
    network = load(write_straight(tmp_path / "straight.xodr"))
    found = features(placed([200.0, 200.0 + ahead], [1, 2]), network)
    held = found.around.held[0]
    assert [k for k in range(8) if held[k] >= 0] == ([] if slot is None else [slot])
    if slot is not None:
        assert found.around.offset[0, slot] == pytest.approx(ahead)


def test_of_two_in_a_slot_the_nearest_holds_it_then_the_lower_id(tmp_path: Path) -> None:
    network = load(write_straight(tmp_path / "straight.xodr"))
    found = features(placed([200.0, 203.0, 197.0, 198.0, 202.0, 205.0], [2, 3, 3, 1, 1, 2]), network)
    held = found.around.held[0]
    who = {k: int(found.samples.owner[j]) for k, j in enumerate(held) if j >= 0}
    assert who == {6: 1, 1: 3}  # at +3 and -3 m the lower id; in the own lane within 5 m nobody
    renamed = replace(found.samples.tracks, ids=np.array(["9", "20", "3", "100", "11", "5"]))
    found = features(renamed, network)
    who = {k: int(found.samples.owner[j]) for k, j in enumerate(found.around.held[0]) if j >= 0}
    assert who == {6: 2, 1: 4}  # ids are compared as numbers where all are


def test_windows_of_maneuvers_that_share_a_sample_are_one(tmp_path: Path) -> None:
    network = load(write_straight(tmp_path / "straight.xodr"))
    tracks = placed([200.0, 230.0], [2, 3])
    found = features(tracks, network)
    (change,) = [m for m in find_maneuvers(found) if m.label == "lane_change_left"]
    length = change.end - change.start
    for gap, count in ((0, 1), (1, 2)):
        later = replace(change, start=change.end + gap, end=change.end + gap + 3)
        made = extract(found, [change, later], CUTTING)
        assert [one.ego for one in made] == [0] * count
        assert made[0].end - made[0].start == length + (3 if gap == 0 else 0)


def test_rule_b_holds_beyond_the_life_of_the_ego_and_its_own_change_does_not_trigger(tmp_path: Path) -> None:
    network = load(write_straight(tmp_path / "straight.xodr"))
    tracks = placed([200.0, 230.0], [2, 3])
    valid = tracks.valid.copy()
    valid[0, 20:] = False
    short = {name: np.where(valid, getattr(tracks, name), np.nan) for name in ("x", "y", "heading", "v")}
    found = features(replace(tracks, valid=valid, **short), network)
    maneuvers = find_maneuvers(found)
    (change,) = [m for m in maneuvers if m.label == "lane_change_left"]
    (one,) = extract(found, maneuvers, CUTTING)
    step = found.samples.step
    assert (one.start, one.end) == (step[change.start], step[change.end])
    assert (one.ego_start, one.ego_end) == (one.start, 19)
    assert one.end > 19
    assert tag(one.triggers) == "left"
    assert (one.bucket.road, one.bucket.along, one.bucket.lanes, one.bucket.vehicles) == ("1", True, 3, 2)
    own = CUTTING.model_copy(update={"own": True})
    assert {made.ego for made in extract(found, maneuvers, own)} == {0, 1}
