"""Limits of noisy values: exact ones are taken as they are, noise makes no flicker."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mining.planted import Drive, braking, path_of, smooth, steady, tracks_of, write_motorway

from resim.core.tracks import Tracks
from resim.mining.features import features
from resim.mining.find import find_maneuvers
from resim.mining.smoothing import below
from resim.road.opendrive import load

T = np.arange(0.0, 20.0, 0.04)
ONE = np.zeros(len(T), dtype=int)


@settings(deadline=None)
@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), st.floats(-1e9, 1e9).map(round))
def test_exact_values_are_below_where_they_are(knots: list[float], clock: int) -> None:
    """A parabola, whose fourth differences are rounding; but for samples that rounding could decide."""
    values = np.polyval(np.polyfit([0.0, 10.0, 20.0], knots, 2), T)
    sure = np.abs(values) > 1e-9
    np.testing.assert_array_equal(below(T + clock, values, ONE)[sure], (values < 0.0)[sure])


@pytest.mark.parametrize("seed", range(20))
def test_noise_makes_one_stretch_of_one(seed: int) -> None:
    """Below 0 from 5 to 15 s, by up to 1.25, with noise of 0.1: one stretch, and its ends within 0.2 s."""
    values = 0.05 * (T - 5.0) * (T - 15.0) + np.random.default_rng(seed).normal(0.0, 0.1, len(T))
    found = np.flatnonzero(below(T, values, ONE))
    assert len(found) == found[-1] - found[0] + 1
    assert T[found[[0, -1]]] == pytest.approx([5.0, 15.0], abs=0.3)
    assert not below(T, np.abs(values) + 0.02, ONE).any()


@pytest.mark.parametrize("ends", ["as a peak", "at its last sample", "at its first sample"])
def test_who_is_below_for_a_moment_is_told(ends: str) -> None:
    """By 0.12, for 0.46 s or at an end of the track for 0.06 s, with noise of 0.05: always; who touches 0 in few."""
    falls = (
        np.where(T < 10.0, 0.3 * (10.0 - T), 2.0 * (T - 10.0)) if ends == "as a peak" else 2.0 * (T[-1] - T)
    )
    exact = falls[::-1] if ends == "at its first sample" else falls
    noise = np.random.default_rng(7).normal(0.0, 0.05, (100, len(T)))
    found = [np.mean([below(T, row, ONE).any() for row in exact - past + noise]) for past in (0.12, 0.0)]
    assert found[0] >= 0.95
    assert found[1] <= 0.15


def test_a_limit_may_step_where_values_do_not() -> None:
    """20 until 8 s, 22 until 8.24 s, then 20 again, of values that fall slowly through 21 there, with noise."""
    limit = np.where((T >= 8.0) & (T < 8.24), 22.0, 20.0)
    for row in np.random.default_rng(3).normal(0.0, 0.05, (20, len(T))):
        found = T[below(T, 21.2 - 0.02 * T + row, ONE, limit)]
        assert found[[0, -1]] == pytest.approx([8.0, 8.2])


def test_no_average_reaches_over_a_gap() -> None:
    """Values are 1 above 0 before a gap of 0.4 s and 0.03 below it behind: all behind are below, with noise too."""
    t = T[(T < 10.0) | (T > 10.4)]
    for row in np.random.default_rng(3).normal(0.0, 0.02, (20, len(t))):
        found = below(t, np.where(t < 10.2, 1.0, -0.03) + row, np.zeros(len(t), dtype=int))
        np.testing.assert_array_equal(found, t > 10.2)


def test_pieces_are_told_apart_and_what_is_not_there_is_never_below() -> None:
    values = np.where(T < 10.0, -1.0, np.inf)
    piece = (T >= 10.0).astype(int) + 2 * (T >= 15.0)
    np.testing.assert_array_equal(below(T, values, piece), T < 10.0)
    assert not below(np.zeros(0), np.zeros(0), np.zeros(0, dtype=int)).size


@pytest.mark.parametrize("seed", range(6))
def test_a_noisy_lane_change_leaves_the_follower_one_leader_after_another(tmp_path, seed: int) -> None:
    """Who follows 20 % too near behind somebody who leaves its lane slowly is told of once, whatever the noise."""
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -1, 20.0, 800.0)
    drives = [
        Drive("a", steady(30.0)),
        Drive("b", lambda t: 43.0 + 30.0 * t, lambda t: -smooth(t, 8.0, 9.0, 3.5)),
    ]
    exact = tracks_of(path, drives)
    rng = np.random.default_rng(seed)
    x, y, v = (getattr(exact, name) + rng.normal(0.0, 0.05, exact.x.shape) for name in "xyv")
    noisy = Tracks(t=exact.t, ids=exact.ids, kind=exact.kind, x=x, y=y, heading=exact.heading, v=v,
                   length=exact.length, width=exact.width, valid=exact.valid)  # fmt: skip
    found = [features(one, network) for one in (exact, noisy)]
    told = [sorted(m.label for m in find_maneuvers(one) if m.label != "follow_lane") for one in found]
    assert told[0] == told[1]
    assert [np.count_nonzero(one.passed) for one in found] == [1, 1]  # over the border once
    assert told[0].count("tailgating_minor") == 1


@pytest.mark.parametrize(("falls", "found"), [(3.7, 30), (3.3, 0)])
def test_noise_neither_hides_nor_makes_strong_braking(tmp_path, falls: float, found: int) -> None:
    """0.2 m/s more or less within half a second than it takes, of speeds with noise of 0.05 m/s: as of exact ones."""
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -1, 20.0, 1500.0)
    drives = [
        Drive(str(n), lambda t, n=n: 40.0 * n + braking(20.0, -2.0 * falls, 4.0, 0.5)(t)) for n in range(30)
    ]
    exact = tracks_of(path, drives)
    v = exact.v + np.random.default_rng(1).normal(0.0, 0.05, exact.v.shape)
    noisy = Tracks(t=exact.t, ids=exact.ids, kind=exact.kind, x=exact.x, y=exact.y, heading=exact.heading, v=v,
                   length=exact.length, width=exact.width, valid=exact.valid)  # fmt: skip
    counts = [
        sum(m.label == "strong_braking" for m in find_maneuvers(features(one, network)))
        for one in (exact, noisy)
    ]
    assert counts == [found, found]


@pytest.mark.parametrize(("short", "label"), [(1.15, "lane_change_not_judged"), (0.85, "lane_change_right")])
def test_noise_does_not_bring_a_vehicle_close_to_a_lane(tmp_path, short: float, label: str) -> None:
    """Who goes on for seconds 0.15 m beyond, or within, the metre that is close to the new lane's centre."""
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -1, 20.0, 800.0)
    drive = Drive("a", steady(30.0), lambda t: -smooth(t, 2.0, 5.0, 3.5 - short), end=12.0)
    exact = tracks_of(path, [drive])
    rng = np.random.default_rng(4)
    for _ in range(20):
        x, y, v = (getattr(exact, name) + rng.normal(0.0, 0.05, exact.x.shape) for name in "xyv")
        noisy = Tracks(t=exact.t, ids=exact.ids, kind=exact.kind, x=x, y=y, heading=exact.heading, v=v,
                       length=exact.length, width=exact.width, valid=exact.valid)  # fmt: skip
        for tracks in (exact, noisy):
            found = [m.label for m in find_maneuvers(features(tracks, network)) if m.label.startswith("lane")]
            assert found == [label]


@pytest.mark.parametrize(("least", "at_least", "at_most"), [(0.0, 28, 30), (0.25, 0, 1)])
def test_who_stops_for_a_moment_stands_and_who_creeps_does_not(
    tmp_path, least: float, at_least: int, at_most: int
) -> None:
    """30 who brake by 2 m/s² to 0, or to 0.25 m/s for 0.25 s, and go on at once, of speeds with noise of 0.05 m/s."""
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -1, 20.0, 1500.0)
    fine = np.arange(0.0, 12.0, 0.001)
    ways = np.cumsum(np.maximum(2.0 * np.abs(fine - 6.0), least)) * 0.001
    drives = [Drive(str(n), lambda t, n=n: 40.0 * n + np.interp(t, fine, ways), end=11.0) for n in range(30)]
    exact = tracks_of(path, drives)
    v = exact.v + np.random.default_rng(5).normal(0.0, 0.05, exact.v.shape)
    noisy = Tracks(t=exact.t, ids=exact.ids, kind=exact.kind, x=exact.x, y=exact.y, heading=exact.heading, v=v,
                   length=exact.length, width=exact.width, valid=exact.valid)  # fmt: skip
    counts = [
        sum(m.label == "standing" for m in find_maneuvers(features(one, network))) for one in (exact, noisy)
    ]
    assert counts[0] == (0 if least else 30)
    assert at_least <= counts[1] <= at_most


def test_who_rests_between_two_lane_changes_makes_two_in_noise_as_well(tmp_path) -> None:
    """Each takes 1.5 s, and 1.2 s lie between them."""
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -1, 20.0, 800.0)
    drive = Drive(
        "a",
        lambda t: 200.0 + 25.0 * t,
        lambda t: -smooth(t, 3.0, 1.5, 3.5) - smooth(t, 5.7, 1.5, 3.5),
        end=9.2,
    )
    exact = tracks_of(path, [drive])
    rng = np.random.default_rng(6)
    for _ in range(20):
        x, y, v = (getattr(exact, name) + rng.normal(0.0, 0.05, exact.x.shape) for name in "xyv")
        noisy = Tracks(t=exact.t, ids=exact.ids, kind=exact.kind, x=x, y=y, heading=exact.heading, v=v,
                       length=exact.length, width=exact.width, valid=exact.valid)  # fmt: skip
        for tracks in (exact, noisy):
            found = [m.label for m in find_maneuvers(features(tracks, network)) if m.label.startswith("lane")]
            assert found == ["lane_change_right"] * 2
