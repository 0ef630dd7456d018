"""Intervals of shares and means over points, and the levels of a parameter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import betaincinv
from scipy.stats import binomtest, qmc, t

from resim.core.intervals import exact, means, shares, wilson
from resim.sweeps.statistics.response import levels

ONE = np.zeros(1, dtype=int)


@pytest.mark.parametrize(("count", "of"), [(0, 5), (3, 5), (5, 5), (18, 20), (428, 455)])
def test_wilson_is_that_of_scipy(count: int, of: int) -> None:
    known = binomtest(count, of).proportion_ci(0.95, method="wilson")
    low, high = wilson(count, of)
    assert (float(low), float(high)) == (known.low, known.high)


def test_seeds_of_one_point_are_what_is_known_of_it() -> None:
    found = shares(np.array([[1.0, 1.0, 0.0, 1.0]]), ONE, 1, drawn=False)
    assert found.mean.tolist() == [0.75]
    assert [float(found.low[0]), float(found.high[0])] == [float(x) for x in wilson(3, 4)]
    of_others = shares(
        np.array([[1.0, 1.0, 0.0, 1.0]]), ONE, 1
    )  # one of the points that could have been drawn
    assert [float(of_others.low[0]), float(of_others.high[0])] == [float(x) for x in exact(0.75, 1)]


def test_seeds_that_only_repeat_their_point_are_not_counted_twice() -> None:
    points = np.repeat(np.array([1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0, 1.0])[:, None], 10, axis=1)
    found = shares(points, np.zeros(8, dtype=int), 1)
    low, high = exact(5 / 8, 8)
    assert found.runs.tolist() == [80]
    assert [*found.low, *found.high] == [pytest.approx(float(low)), pytest.approx(float(high))]
    low, high = wilson(5, 8)
    held = shares(points, np.zeros(8, dtype=int), 1, drawn=False)
    assert held.high - held.low == pytest.approx(high - low, rel=0.1)
    independent = np.random.default_rng(0).random((400, 10)) < 0.6
    found = shares(independent.astype(float), np.zeros(400, dtype=int), 1, drawn=False)
    assert found.high - found.low == pytest.approx(np.subtract(*wilson(2400, 4000)[::-1]), rel=0.15)


def test_where_all_agree_points_are_counted() -> None:
    found = shares(np.ones((20, 5)), np.zeros(20, dtype=int), 1)
    assert float(found.low[0]) == float(exact(1.0, 20)[0])


def test_a_group_without_runs_has_no_share() -> None:
    found = shares(np.array([[np.nan], [1.0]]), np.array([0, 1]), 2)
    assert np.isnan(found.mean[0])
    assert np.isnan(found.low[0])
    assert found.points.tolist() == [0, 1]


def test_means_are_over_points() -> None:
    y = np.array([[1.0, 3.0], [5.0, 7.0], [9.0, np.nan]])
    found = means(y, np.zeros(3, dtype=int), 1)
    of_points = np.array([2.0, 6.0, 9.0])
    half = t.ppf(0.975, 2) * of_points.std(ddof=1) / np.sqrt(3.0)
    assert found.mean.tolist() == [of_points.mean()]
    assert found.high - found.mean == pytest.approx([half])
    single = means(y[:1], ONE, 1, drawn=False)
    assert single.high - single.mean == pytest.approx([t.ppf(0.975, 1) * 1.0])
    assert np.isnan(means(y[:1], ONE, 1).high).all()


@pytest.mark.parametrize(("count", "of"), [(0, 5), (3, 5), (5, 5), (428, 455)])
def test_exact_is_that_of_scipy(count: int, of: int) -> None:
    known = binomtest(count, of).proportion_ci(0.95, method="exact")
    assert [float(x) for x in exact(count / of, of)] == [pytest.approx(known.low), pytest.approx(known.high)]


PLANS = {
    "iid": lambda n, rng: rng.random((n, 2)),
    "sobol": lambda n, rng: qmc.Sobol(2, rng=rng).random(n),
    "latin_hypercube": lambda n, rng: qmc.LatinHypercube(2, rng=rng).random(n),
}


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize(("points", "seeds"), [(16, 20), (64, 1), (64, 50), (256, 50)])
@pytest.mark.parametrize("truth", [0.5, 0.8, 0.95])
def test_intervals_of_drawn_points_hold_what_they_promise(
    plan: str, points: int, seeds: int, truth: float
) -> None:
    """Where another parameter decides, sharply or smoothly: 95 % of intervals, less 2 points, hold the true share."""
    held = {"sharp": list[bool](), "smooth": list[bool]()}
    for seed in range(40):
        rng = np.random.default_rng(seed)
        u = PLANS[plan](points, rng)
        step = levels(u[:, 0], 20)
        sharp, smooth = (u[:, 1] < truth).astype(float), betaincinv(2.0 * truth, 2.0 * (1.0 - truth), u[:, 1])
        for kind, share in (("sharp", sharp), ("smooth", smooth)):
            y = (rng.random((points, seeds)) < share[:, None]).astype(float)
            found = shares(y, step.of, len(step))
            held[kind] += ((found.low <= truth) & (truth <= found.high)).tolist()
    assert min(np.mean(each) for each in held.values()) >= 0.93


def test_few_values_are_levels_and_many_are_bins() -> None:
    x = np.repeat([0.0, 0.5, 2.0], 4)
    found = levels(x, 20)
    assert (found.centre.tolist(), found.binned) == ([0.0, 0.5, 2.0], False)
    assert np.array_equal(found.centre[found.of], x)
    drawn = np.random.default_rng(2).random(1000)
    found = levels(drawn, 20)
    assert found.binned
    assert np.bincount(found.of).tolist() == [50] * 20
    assert ((drawn >= found.low[found.of]) & (drawn <= found.high[found.of])).all()
    some = drawn > 0.5
    assert (levels(drawn, 5, some).of[~some] == -1).all()
