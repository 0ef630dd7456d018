"""Distances between scenarios, against a plain loop written from the text (Wagner 2021, 6.2.3)."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from space.families import drawn

from resim.space.distance import PUBLISHED, DistanceOptions, PairDistances
from resim.space.traces import SLOTS, SlotTraces, joined


def loop(one: list[list[float | None]], two: list[list[float | None]]) -> float:
    """The distance as the text says it: scene by scene, slot by slot."""
    scenes = 0
    total = 0.0
    for first, second in zip(one, two, strict=False):  # the surplus of the longer one is ignored
        scene = 0.0
        for a, b in zip(first, second, strict=True):
            if a is None and b is None:
                scene += 0.0
            elif a is None or b is None:
                scene += 1.5
            else:
                scene += abs(a - b) / 95.0
        total += scene
        scenes += 1
    return total / scenes


def random_traces(count: int, seed: int, most: int = 12) -> SlotTraces:
    rng = np.random.default_rng(seed)
    scenes = rng.integers(1, most, count)
    first = np.concatenate([[0], np.cumsum(scenes)]).astype(np.intp)
    k = int(first[-1])
    offset = np.where(rng.random((k, 8)) < rng.random(), rng.uniform(-50.0, 100.0, (k, 8)), np.nan)
    offset[:, [1, 6]] = np.clip(offset[:, [1, 6]], -5.0, 5.0)
    offset[:, [2, 4, 7]] = 5.0 + np.abs(offset[:, [2, 4, 7]]) * 0.95
    offset[:, [0, 3, 5]] = -5.0 - np.abs(offset[:, [0, 3, 5]]) * 0.45
    speed = np.where(np.isfinite(offset), rng.normal(0.0, 5.0, (k, 8)), np.nan)
    names = np.array([f"s{n}" for n in range(count)])
    return SlotTraces(names, first, offset, speed, rng.integers(0, 3, k), rng.normal(0.0, 0.005, k))


def plain(traces: SlotTraces, row: int) -> list[list[float | None]]:
    part = traces.offset[traces.first[row] : traces.first[row + 1]]
    return [[None if np.isnan(x) else float(x) for x in scene] for scene in part]


def scene(**held: float) -> list[float | None]:
    return [held.get(slot) for slot in SLOTS]


def of_scenes(*scenes: list[list[float | None]]) -> SlotTraces:
    offset = [np.array([[np.nan if x is None else x for x in s] for s in one], dtype=float) for one in scenes]
    whole = np.concatenate(offset)
    first = np.concatenate([[0], np.cumsum([len(one) for one in offset])]).astype(np.intp)
    names = np.array([f"s{n}" for n in range(len(scenes))])
    speed = np.where(np.isfinite(whole), 0.0, np.nan)
    return SlotTraces(names, first, whole, speed, np.zeros(len(whole), np.intp), np.zeros(len(whole)))


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10_000), count=st.integers(2, 9))
def test_equals_the_loop_written_from_the_text(seed: int, count: int) -> None:
    traces = random_traces(count, seed)
    pairs = PairDistances(traces)
    expected = [loop(plain(traces, a), plain(traces, b)) for a, b in itertools.combinations(range(count), 2)]
    np.testing.assert_allclose(pairs.condensed(), expected, rtol=0.0, atol=1e-12)
    square = pairs.between(np.arange(count), np.arange(count))
    assert (square == square.T).all()
    assert (np.diag(square) == 0.0).all()
    assert (square >= 0.0).all()
    assert (square <= 12.0).all()


def test_a_scene_with_every_case_of_figures_6_15_and_6_16() -> None:
    # in both: I and V; in one only: II and VIII; in none: the others
    one = [scene(I=-20.0, II=1.0, V=60.0)]
    two = [scene(I=-39.0, V=41.0, VIII=30.0)]
    assert PairDistances(of_scenes(one, two)).condensed() == pytest.approx(
        [19.0 / 95.0 * 2 + 1.5 * 2], abs=1e-12
    )


def test_the_ends_of_the_range() -> None:
    four = [scene(I=-20.0, III=20.0, V=20.0, VI=-20.0)] * 3
    others = [scene(II=0.0, IV=-20.0, VII=0.0, VIII=20.0)] * 5
    assert PairDistances(of_scenes(four, others)).condensed()[0] == 12.0
    far = of_scenes([scene(V=5.0)], [scene(V=100.0)])
    assert PairDistances(far).condensed()[0] == 1.0


def test_the_surplus_of_the_longer_one_is_ignored_unless_it_is_asked_for() -> None:
    short, long = [scene(V=20.0)] * 5, [scene(V=20.0)] * 5 + [scene(I=-20.0)] * 15
    traces = of_scenes(short, long)
    assert PairDistances(traces).condensed()[0] == 0.0
    assert PairDistances(traces, DistanceOptions(unequal=2.0)).condensed()[0] == pytest.approx(1.5)


def test_warping_aligns_the_same_course_that_begins_later() -> None:
    before, after = [scene(III=20.0)], [scene(V=20.0)]
    early, late = before * 10 + after * 30, before * 20 + after * 20
    traces = of_scenes(early, late)
    assert PairDistances(traces).condensed()[0] == pytest.approx(10 * 3.0 / 40)
    assert PairDistances(traces, DistanceOptions(warp=4.0)).condensed()[0] == pytest.approx(0.0)
    assert PairDistances(traces, DistanceOptions(warp=0.0)).condensed()[0] == pytest.approx(10 * 3.0 / 40)


def test_other_options_add_what_they_say() -> None:
    traces = random_traces(6, 3)
    published = PairDistances(traces, PUBLISHED).condensed()
    for options in (DistanceOptions(speed=0.5), DistanceOptions(lane=0.3), DistanceOptions(bend=0.3)):
        found = PairDistances(traces, options).condensed()
        assert (found >= published - 1e-12).all()
        assert (found > published + 1e-6).any()
        assert (found <= options.longest).all()
        square = PairDistances(traces, options).between(np.arange(6), np.arange(6))
        assert np.allclose(square, square.T)
        assert (np.diag(square) == 0.0).all()


def test_the_number_of_workers_changes_no_bit() -> None:
    traces = joined([drawn("overtakes", f"a{n}", np.random.default_rng(n)) for n in range(150)])
    one, two = (PairDistances(traces, workers=n).condensed() for n in (1, 3))
    assert one.tobytes() == two.tobytes()
