from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from resim.sweeps.plans.adaptive import Lattice, boundary, wanted
from resim.sweeps.plans.parameter import SweepParameter


def grown(lattice: Lattice, passes: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """All points that the plan asks for, and what came of them."""
    places, passed = np.empty((0, len(lattice.first)), dtype=np.intp), np.empty(0, dtype=bool)
    while len(more := wanted(lattice, places, passed)):
        places = np.concatenate([places, more])
        passed = passes(lattice.values(places))
    return places, passed


def parameters(*width: float, steps: int = 5) -> list[SweepParameter]:
    names = ("perception.latency.speed", "perception.latency.position", "function.time_gap")
    return [
        SweepParameter(name=name, low=0.0, high=1.0, steps=steps, width=w)
        for name, w in zip(names, width, strict=False)
    ]


def test_a_threshold_is_found_by_bisection() -> None:
    lattice = Lattice.over(parameters(0.001))
    places, passed = grown(lattice, lambda x: x[:, 0] < 0.3217)
    low, high = (float(lattice.values(end)[0, 0]) for end in boundary(lattice, places, passed))
    assert low < 0.3217 <= high
    assert high - low <= 0.001
    assert len(places) == 5 + 8


def test_two_thresholds_are_both_found() -> None:
    lattice = Lattice.over(parameters(0.01))
    places, passed = grown(lattice, lambda x: np.abs(x[:, 0] - 0.5) < 0.21)
    found = lattice.values(boundary(lattice, places, passed)[0])[:, 0]
    assert found == pytest.approx([0.285, 0.71], abs=0.01)


def test_a_curve_is_followed_over_its_whole_length() -> None:
    lattice = Lattice.over(parameters(0.02, 0.02))

    def passes(x: np.ndarray) -> np.ndarray:
        return np.asarray(x[:, 1] < 0.5 + 0.3 * np.sin(5.0 * x[:, 0]))

    places, passed = grown(lattice, passes)
    fine = np.stack(
        [m.ravel() for m in np.meshgrid(*(np.arange(n + 1) for n in lattice.counts), indexing="ij")], axis=1
    )
    truth = passes(lattice.values(fine))
    expected = boundary(lattice, fine, truth)  # of all points
    np.testing.assert_array_equal(boundary(lattice, places, passed), expected)
    assert len(places) < 0.25 * len(fine)


def test_a_width_that_the_first_grid_has_asks_for_no_more() -> None:
    lattice = Lattice.over(parameters(0.25, 0.25))
    places, _ = grown(lattice, lambda x: x.sum(axis=1) < 0.9)
    assert len(places) == 25


def test_widths_of_their_own() -> None:
    lattice = Lattice.over(parameters(0.01, 0.25, 0.1))
    assert lattice.counts.tolist() == [128, 4, 16]
    places, passed = grown(lattice, lambda x: x[:, 0] + 0.1 * x[:, 2] < 0.5)
    cells = lattice.values(boundary(lattice, places, passed)[0])
    assert np.all(np.abs(cells[:, 0] + 0.1 * cells[:, 2] - 0.5) < 0.02)


def test_where_nothing_changes_the_first_grid_is_all() -> None:
    lattice = Lattice.over(parameters(0.001, 0.001))
    places, passed = grown(lattice, lambda x: np.ones(len(x), dtype=bool))
    assert len(places) == 25
    assert not len(boundary(lattice, places, passed)[0])


def test_what_was_not_halved_is_told_as_large_as_it_is() -> None:
    lattice = Lattice.over(parameters(0.05, 0.05))
    places = wanted(lattice, np.empty((0, 2), dtype=np.intp), np.empty(0, dtype=bool))
    low, high = boundary(lattice, places, lattice.values(places)[:, 0] < 0.3)
    np.testing.assert_allclose(lattice.values(low), [[0.25, y] for y in (0.0, 0.25, 0.5, 0.75)])
    np.testing.assert_allclose(lattice.values(high - low), 0.25)
    more = wanted(lattice, places, lattice.values(places)[:, 0] < 0.3)
    places = np.concatenate([places, more[lattice.values(more)[:, 1] <= 0.25]])
    low, high = boundary(lattice, places, lattice.values(places)[:, 0] < 0.3)
    assert lattice.values(high - low)[:, 0].tolist() == [0.125, 0.125, 0.25, 0.25, 0.25]


@pytest.mark.parametrize(("first", "size"), [((4,), 0.1), ((10, 4), 0.05), ((3, 5), 0.25), ((1,), 0.5)])
def test_an_island_is_missed_as_often_as_told(first: tuple[int, ...], size: float) -> None:
    """Boxes dropped anywhere, and the points of the first grid counted in them."""
    n = len(first)
    lattice = Lattice((0.0,) * n, (1.0,) * n, first, (3,) * n)
    low = np.random.default_rng(0).random((20_000, n)) * (1.0 - size)
    inside = [
        ((grid >= low[:, i, None]) & (grid <= low[:, i, None] + size)).any(axis=1)
        for i, grid in enumerate(np.linspace(0.0, 1.0, cells + 1) for cells in first)
    ]
    assert lattice.missed(size) == pytest.approx(1.0 - np.all(inside, axis=0).mean(), abs=0.012)
