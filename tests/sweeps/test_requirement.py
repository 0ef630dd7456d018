"""Implied requirements and boundaries against known ones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from resim.core.geometry import Floats
from resim.sweeps.statistics.boundary import crossings, grid_map, smooth_map
from resim.sweeps.statistics.requirement import Side, requirement
from resim.sweeps.statistics.response import levels

LEVELS = np.linspace(0.0, 1.0, 11)


def passing(x: Floats, share: Floats, seeds: int = 10, seed: int = 0) -> Floats:
    return (np.random.default_rng(seed).random((len(x), seeds)) < share[:, None]).astype(float)


def test_under_a_value_enough_pass() -> None:
    x = np.repeat(LEVELS, 20)
    found = requirement(passing(x, np.where(x < 0.55, 1.0, 0.0)), levels(x, 20), 0.95, "under", drawn=True)
    assert (found.found, found.bounds, found.beyond) == ("limit", (None, 0.5), (None, LEVELS[6]))
    assert found.estimate == found.possible == found.bounds
    assert (found.share, found.at, found.runs) == (1.0, (None, 1.0), 6 * 200)
    assert found.least is not None
    assert 0.95 <= found.least < 1.0


def test_it_counts_all_runs_below() -> None:
    """Of 11 levels the last two fail half: 10 of them pass 95 %, and 11 do not."""
    x = np.repeat(LEVELS, 20)
    y = np.ones((len(x), 2))
    y[x > 0.85, 0] = 0.0
    found = requirement(y, levels(x, 20), 0.95, "under", drawn=True)
    assert found.estimate == (None, pytest.approx(0.9))
    assert found.bounds == (None, pytest.approx(0.8))
    assert (found.share, found.at) == (1.0, (None, 1.0))


@pytest.mark.parametrize("seeds", [1, 10])
def test_the_truth_is_between_what_is_shown_and_what_is_possible(seeds: int) -> None:
    """Shares that fall from 1 to 0 around 0.5; the level up to which 95 % pass is known."""
    x = np.repeat(np.linspace(0.0, 1.0, 51), 30)
    share = 1.0 / (1.0 + np.exp((x - 0.5) / 0.05))
    values = np.unique(x)
    cumulated = np.cumsum(share.reshape(51, 30)[:, 0]) / np.arange(1, 52)
    truth = float(values[np.flatnonzero(cumulated >= 0.95)[-1]])
    held = 0
    for seed in range(40):
        found = requirement(passing(x, share, seeds, seed), levels(x, 20), 0.95, "under", drawn=True)
        assert found.bounds is not None
        assert found.possible is not None
        low, high = found.bounds[1], found.possible[1]
        assert low is not None
        assert high is not None
        assert truth - 0.1 < low <= truth
        held += low <= truth <= high
    assert held >= 38


@pytest.mark.parametrize("side", ["under", "over", "between"])
def test_all_and_none(side: Side) -> None:
    x = np.repeat(LEVELS, 20)
    whole = requirement(np.ones((len(x), 2)), levels(x, 20), 0.95, side, drawn=True)
    assert (whole.found, whole.bounds, whole.share) == ("whole", (None, None), 1.0)
    none = requirement(np.zeros((len(x), 2)), levels(x, 20), 0.95, side, drawn=True)
    assert (none.found, none.bounds, none.estimate, none.possible) == ("none", None, None, None)


@pytest.mark.parametrize("side", ["under", "over", "between"])
@pytest.mark.parametrize(("points", "seeds"), [(20, 5), (1, 100), (40, 1)])
def test_what_is_not_so_is_rarely_told(side: Side, points: int, seeds: int) -> None:
    """Every value passes 94.5 % of runs, and 95 % are demanded."""
    x = np.repeat(LEVELS, points)
    steps, told = levels(x, 50), 0
    for seed in range(200):
        found = requirement(passing(x, np.full(len(x), 0.945), seeds, seed), steps, 0.95, side, drawn=True)
        told += found.bounds is not None
    assert told <= 10


def test_what_points_have_in_common_is_no_evidence() -> None:
    """Of 5.5 % of points all 50 seeds fail: 220 points say no more than 220 runs."""
    x, told = np.repeat(LEVELS, 20), 0
    for seed in range(200):
        good = np.random.default_rng(seed).random(len(x)) < 0.945
        found = requirement(
            np.repeat(good[:, None], 50, axis=1).astype(float), levels(x, 50), 0.95, "under", drawn=True
        )
        told += found.bounds is not None
    assert told <= 10


def test_of_a_grid_every_run_is_evidence() -> None:
    """What is asked is what share of the runs over these very points passes."""
    x = np.repeat(LEVELS, 7)
    y = passing(x, np.where(x < 0.55, 1.0, 0.0), 5)
    assert requirement(y, levels(x, 20), 0.95, "under", drawn=True).bounds is None
    assert requirement(y, levels(x, 20), 0.95, "under", drawn=False).bounds == (None, 0.5)
    told = 0
    for seed in range(200):
        y = passing(x, np.full(len(x), 0.945), 5, seed)
        told += requirement(y, levels(x, 50), 0.95, "under", drawn=False).bounds is not None
    assert told <= 10


def test_few_runs_show_nothing() -> None:
    y = np.ones((11, 5))
    found = requirement(y, levels(LEVELS, 50), 0.95, "under", drawn=True)
    assert (found.found, found.bounds, found.estimate, found.share) == ("unclear", None, (None, None), 1.0)
    assert found.least is not None
    assert found.least < 0.95


def test_from_both_sides() -> None:
    x = np.repeat(np.linspace(-1.0, 1.0, 11), 60)
    y = passing(x, np.where(np.abs(x - 0.2) < 0.5, 1.0, 0.1))
    between = requirement(y, levels(x, 20), 0.95, "between", drawn=True)
    assert between.bounds == between.estimate == (pytest.approx(-0.2), pytest.approx(0.6))
    assert between.beyond == (pytest.approx(-0.4), pytest.approx(0.8))
    assert requirement(y, levels(x, 20), 0.95, "under", drawn=True).found == "none"
    over = requirement(passing(x, np.where(x > 0.1, 1.0, 0.0)), levels(x, 20), 0.95, "over", drawn=True)
    assert over.bounds == (pytest.approx(0.2), None)


def test_a_parameter_that_does_nothing_has_no_limit() -> None:
    x = np.repeat(LEVELS, 20)
    found = requirement(passing(x, np.full(len(x), 0.94)), levels(x, 20), 0.95, "between", drawn=True)
    assert found.found == "unclear"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The balance properties")
@pytest.mark.parametrize("engine", [qmc.Sobol, qmc.Halton, qmc.LatinHypercube])
def test_what_is_drawn_tells_of_the_parameter_that_matters(engine: type[qmc.QMCEngine]) -> None:
    claimed, missed = 0, 0
    for seed in range(100):
        x = engine(2, rng=np.random.default_rng(seed)).random((512, 640, 800)[seed % 3])
        y = passing(x, 1.0 / (1.0 + np.exp((x[:, 0] - 0.6) / 0.05)), 5, seed)
        steps = [levels(x[:, i], 50, None, np.delete(x, i, axis=1)) for i in (0, 1)]
        one, two = (
            [requirement(y, step, 0.95, side, drawn=True).found for side in ("under", "over")]
            for step in steps
        )
        missed += "limit" not in one
        claimed += "limit" in two
    assert claimed < 10
    assert missed < 10


def test_a_level_of_what_is_drawn_holds_several_points() -> None:
    for count in (16, 33, 50, 200):
        x = np.random.default_rng(count).random((count, 2))
        found = levels(x[:, 0], 50, None, x[:, 1:])
        assert np.bincount(found.of).min() >= 8
        assert len(found) == count // 8
    drawn = levels(np.repeat(LEVELS, 8), 50, None, np.random.default_rng(0).random((88, 1)))
    assert (len(drawn), drawn.binned) == (11, False)
    few = np.random.default_rng(0).random((12, 2))
    y = passing(few, np.where(few[:, 0] < 0.5, 1.0, 0.0), 5)
    assert (
        requirement(y, levels(few[:, 0], 50, None, few[:, 1:]), 0.95, "under", drawn=True).found == "unclear"
    )


def test_a_grid_keeps_its_levels() -> None:
    x, b = grid(11, 3)
    found = levels(x, 50, None, b[:, None])
    assert (len(found), found.binned) == (11, False)
    alone = levels(LEVELS, 50, None, np.zeros((11, 2)))
    assert (len(alone), alone.binned) == (11, False)
    drawn = levels(LEVELS, 50, None, np.zeros((11, 0)))
    assert (len(drawn), drawn.binned) == (11, False)
    used = np.arange(33) < 11
    assert len(levels(x, 50, used, b[:, None])) == 11


@pytest.mark.parametrize("width", [0.03, 0.08, 0.15])
@pytest.mark.parametrize("seeds", [1, 5, 40])
@pytest.mark.parametrize("count", [11, 21])
def test_a_parameter_alone_is_judged_by_its_runs_where_all_that_is_asked_about_was_run(
    count: int, seeds: int, width: float
) -> None:
    x = np.linspace(0.0, 1.0, count)
    share = 1.0 / (1.0 + np.exp((x - 0.55) / width))
    truth = float(x[np.flatnonzero(np.cumsum(share) / np.arange(1, count + 1) >= 0.95)[-1]])
    wrong, told = 0, 0
    for seed in range(60):
        found = requirement(passing(x, share, seeds, seed), levels(x, 50), 0.95, "under", drawn=False)
        if found.bounds is not None:
            told += 1
            wrong += found.bounds[1] is None or found.bounds[1] > truth + 1e-9
        if found.possible is not None:
            wrong += found.possible[1] is not None and found.possible[1] < truth - 1e-9
    assert wrong <= 3
    assert told > 40 if (seeds, width) == (40, 0.03) else told == 0 or seeds == 40


@pytest.mark.parametrize(("points", "seeds"), [(12, 20), (24, 10), (40, 5), (64, 1), (128, 3)])
def test_points_of_a_parameter_alone_say_nothing_of_what_lies_between_them_by_their_seeds(
    points: int, seeds: int
) -> None:
    """Bands in which all fails, anywhere: copies of a point are no evidence against them."""
    wrong = told = 0
    fine = np.linspace(0.0, 1.0, 4001)
    for seed in range(200):
        rng = np.random.default_rng(seed)
        x = (rng.permutation(points) + rng.random(points)) / points
        begins = rng.uniform(0.0, 1.0, 3)
        width = rng.uniform(0.01, 0.12)

        def fails(at: Floats) -> np.ndarray:
            return ((at[:, None] > begins) & (at[:, None] < begins + width)).any(axis=1)  # noqa: B023

        y = np.repeat(~fails(x)[:, None], seeds, axis=1).astype(float)
        found = requirement(y, levels(x, 50), 0.95, "under", drawn=True)
        if found.bounds is not None:
            told += 1
            top = 1.0 if found.bounds[1] is None else found.bounds[1]
            wrong += 1.0 - fails(fine[fine <= top]).mean() < 0.95
    assert wrong <= 0.05 * 200
    assert told == 0 or points >= 64


def grid(a: int, b: int) -> tuple[Floats, Floats]:
    x, y = np.meshgrid(np.linspace(0.0, 1.0, a), np.linspace(0.0, 1.0, b))
    return x.ravel(), y.ravel()


def test_the_boundary_of_a_grid() -> None:
    x, b = grid(21, 5)
    share = np.clip(0.5 - (x - 0.3 - 0.4 * b) / 0.2, 0.0, 1.0)
    y = np.tile(np.arange(100) < 100.0 * share[:, None] - 1e-9, 1).astype(float)
    found = crossings(grid_map(y, levels(x, 50), levels(b, 50)), 0.5)
    assert [c.b for c in found] == np.unique(b).tolist()
    for c in found:
        assert c.at == pytest.approx(0.3 + 0.4 * c.b, abs=0.01)
        assert c.below <= c.at <= c.above
        assert not c.rises
        assert c.low is not None
        assert c.high is not None
        assert c.low < c.at < c.high


def test_few_seeds_cannot_show_a_high_share() -> None:
    x, b = grid(5, 3)
    y = np.repeat((x < 0.6).astype(float)[:, None], 5, axis=1)
    found = crossings(grid_map(y, levels(x, 50), levels(b, 50)), 0.95)
    assert len(found) == 3
    assert all(c.low is None for c in found)  # 5 of 5 is 57 % or more


@pytest.mark.parametrize("seeds", [1, 5])
def test_the_boundary_of_drawn_points(seeds: int) -> None:
    u = np.random.default_rng(0).random((2000, 2))
    y = passing(u, np.where(u[:, 0] < 0.3 + 0.4 * u[:, 1], 1.0, 0.0), seeds)
    mesh = np.linspace(0.0, 1.0, 25)
    found = smooth_map(y, u, mesh, mesh, (mesh, mesh))
    assert found.width is not None
    inner = [c for c in crossings(found, 0.5) if 0.1 < c.b < 0.9]
    assert len(inner) >= 18
    for c in inner:
        assert c.at == pytest.approx(0.3 + 0.4 * c.b, abs=0.05)
        assert not c.rises


def test_a_map_is_open_where_nothing_was_drawn() -> None:
    u = np.random.default_rng(0).random((400, 2)) * [0.5, 1.0]
    mesh = np.linspace(0.0, 1.0, 25)
    found = smooth_map(passing(u, u[:, 0] + 0.2), u, mesh, mesh, (mesh, mesh))
    assert np.isnan(found.share[:, -1]).all()
    assert np.isfinite(found.share[12, 5])
