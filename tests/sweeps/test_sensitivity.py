"""Sobol indices against known ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import qmc
from swept import design

from resim.core.geometry import Floats
from resim.sweeps.plans.parameter import SweepParameter
from resim.sweeps.statistics.indices import Sensitivity
from resim.sweeps.statistics.sensitivity import full_grid, ranking, sensitivity

NAMES = ("perception.latency.speed", "perception.latency.position", "perception.latency.heading")
GRID = tuple(
    SweepParameter(name=n, low=0.0, high=1.0, steps=k) for n, k in zip(NAMES[:2], (7, 5), strict=True)
)


def ishigami(share: Floats) -> Floats:
    """Ishigami and Homma (1990), with a = 7, b = 0.1."""
    x = (2.0 * share - 1.0) * np.pi
    return np.asarray(np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0]))


FIRST, TOTAL = (0.3139, 0.4424, 0.0), (0.5576, 0.4424, 0.2437)
VARIANCE = 13.8446


def found(share: Floats, y: Floats, *, grid: bool) -> Sensitivity:
    out = sensitivity(share, y, grid=grid)
    assert out is not None
    return out


def within(interval: Floats, known: tuple[float, ...], slack: float) -> bool:
    return bool(((interval[:, 0] - slack <= known) & (interval[:, 1] + slack >= known)).all())


@pytest.mark.parametrize("points", [256, 512, 1024])
@pytest.mark.parametrize("engine", [qmc.Sobol, qmc.Halton, qmc.LatinHypercube])
def test_ishigami(points: int, engine: type[qmc.QMCEngine]) -> None:
    share = engine(3, rng=np.random.default_rng(1)).random(points)
    s = found(share, ishigami(share)[:, None], grid=False)
    slack = 0.03 if points == 256 else 0.004
    assert within(s.first_interval, FIRST, slack)
    assert within(s.total_interval, TOTAL, slack)
    assert ranking(s.total, np.ones(3, dtype=bool)) == [0, 1, 2]
    if points > 256:
        assert s.q2 is not None
        assert s.q2 > 0.99


def test_noise_of_seeds_is_a_share_of_its_own() -> None:
    share = qmc.Sobol(3, rng=np.random.default_rng(1)).random(1024)
    y = ishigami(share)[:, None] + np.random.default_rng(5).normal(0.0, 2.0, (1024, 5))
    s = found(share, y, grid=False)
    rest = VARIANCE / (VARIANCE + 4.0)
    assert s.noise == pytest.approx(4.0 / (VARIANCE + 4.0), abs=0.02)
    assert within(s.total_interval, tuple(rest * t for t in TOTAL), 0.02)


def test_a_grid_is_taken_apart_exactly() -> None:
    x = design(GRID, "grid", 0, 0)
    assert full_grid(x) == (7, 5)
    y = x[:, 0] + 2.0 * x[:, 1] + 3.0 * x[:, 0] * x[:, 1]
    a, b = np.var(np.linspace(0.0, 1.0, 7)), np.var(np.linspace(0.0, 1.0, 5))
    parts = np.array([a * 2.5**2, b * 3.5**2, 9.0 * a * b])
    known = parts / parts.sum()
    s = found(x, y[:, None], grid=True)
    assert s.method == "anova"
    assert s.first == pytest.approx(known[:2])
    assert s.total == pytest.approx(known[:2] + known[2])
    assert np.isnan(s.first_interval).all()
    shuffled = np.random.default_rng(0).permutation(len(x))
    assert found(x[shuffled], y[shuffled, None], grid=True).first == pytest.approx(s.first)


def test_intervals_of_a_noisy_grid_hold_the_truth() -> None:
    x = design(GRID, "grid", 0, 0)
    y, held = x[:, 0] + 2.0 * x[:, 1] + 3.0 * x[:, 0] * x[:, 1], 0
    parts = np.array([2.5**2 * np.var(np.linspace(0, 1, 7)), 3.5**2 * np.var(np.linspace(0, 1, 5))])
    known = parts / (np.var(y) + 0.25)
    for seed in range(100):
        noisy = y[:, None] + np.random.default_rng(seed).normal(0.0, 0.5, (len(y), 5))
        s = found(x, noisy, grid=True)
        held += within(s.first_interval, tuple(known), 0.0)
    assert held >= 80  # two intervals of 95 % each


def test_a_cell_with_one_run_does_not_widen_the_interval() -> None:
    x = design(GRID, "grid", 0, 0)
    y = 100.0 + 10.0 * x[:, :1] + np.random.default_rng(0).normal(0.0, 0.1, (len(x), 5))
    whole = found(x, y, grid=True)
    y[17, 1:] = np.nan
    s = found(x, y, grid=True)
    assert s.method == "anova"
    assert s.first_interval == pytest.approx(whole.first_interval, abs=0.002)
    assert s.total_interval == pytest.approx(whole.total_interval, abs=0.002)


def test_a_parameter_with_one_value_leaves_the_others_theirs() -> None:
    share = qmc.Sobol(3, rng=np.random.default_rng(1)).random(256)
    y = share[:, :1] + 2.0 * share[:, 2:]
    share[:, 1] = 0.5
    s = found(share, y, grid=False)
    assert s.total == pytest.approx([0.2, 0.0, 0.8], abs=0.01)
    assert s.first[1] == 0.0
    assert (s.first_interval[1] == 0.0).all()
    assert (s.total_interval[1] == 0.0).all()
    assert sensitivity(np.full((64, 2), 0.5), y[:64], grid=False) is None


def test_there_is_nothing_where_there_is_nothing() -> None:
    x = design(GRID, "grid", 0, 0)
    assert sensitivity(x, np.ones((len(x), 3)), grid=True) is None
    assert sensitivity(x, np.full((len(x), 3), np.nan), grid=True) is None
    rng = np.random.default_rng(3)
    for grid in (True, False):
        s = found(x, rng.normal(0.0, 1.0, (len(x), 5)), grid=grid)
        assert s.noise == pytest.approx(1.0, abs=0.1)
        assert (s.total_interval[:, 0] <= 0.02).all()
        assert (s.total < 0.1).all()
    share = rng.random((300, 2))
    s = found(share, np.sin(3.0 * share[:, :1]), grid=False)
    assert s.total[1] < 1e-6


def test_a_grid_with_a_hole_is_fitted() -> None:
    x = design(GRID, "grid", 0, 0)
    y = (x[:, 0] + 2.0 * x[:, 1])[:, None].repeat(2, axis=1)
    whole = found(x, y, grid=True)
    y[3] = np.nan
    s = found(x, y, grid=True)
    assert s.method == "chaos"
    assert s.first == pytest.approx(whole.first, abs=0.06)


def test_too_few_points_tell_nothing() -> None:
    share = np.random.default_rng(0).random((5, 4))
    assert sensitivity(share, share[:, :1], grid=False) is None


@pytest.mark.parametrize(
    "parameter",
    [
        SweepParameter(name=NAMES[0], low=-1.0, high=3.0),
        SweepParameter(name=NAMES[0], low=0.0, high=1.0, mean=0.3, std=0.2),
        SweepParameter(name=NAMES[0], values=(3.0, 1.0, 2.0)),
    ],
)
def test_shares_of_a_distribution_are_found_again(parameter: SweepParameter) -> None:
    share = np.array([0.0, 0.2, 0.4, 0.5, 0.7, 0.9])
    again = parameter.at(parameter.share(parameter.at(share)))
    assert again == pytest.approx(parameter.at(share))
    if not parameter.values:
        assert parameter.share(parameter.at(share)) == pytest.approx(share)


SHARP: dict[str, tuple[Callable[[Floats], Floats], tuple[float, ...], tuple[float, ...]]] = {
    "corner": (  # x < 0.6 and y < 0.7: parts of the variance p (1 - p), p = 0.42, by hand
        lambda x: (x[:, 0] < 0.6) & (x[:, 1] < 0.7),
        (0.24 * 0.49 / 0.2436, 0.21 * 0.36 / 0.2436),
        (0.24 * 0.7 / 0.2436, 0.21 * 0.6 / 0.2436),
    ),
    "step": (lambda x: x[:, 0] < 0.37, (1.0, 0.0), (1.0, 0.0)),
    "cross": (lambda x: (x[:, 0] < 0.5) ^ (x[:, 1] < 0.5), (0.0, 0.0), (1.0, 1.0)),
}


@pytest.mark.parametrize("name", SHARP)
@pytest.mark.parametrize("points", [64, 256])
def test_intervals_of_sharp_outcomes_hold_the_truth(name: str, points: int) -> None:
    """Indices of sums over boxes, on paper; noisy by 5 % of the runs that turn."""
    outcome, first, total = SHARP[name]
    held, kept = 0, 0.9**2  # a run that turns with 5 % keeps 0.9 of its difference from a half
    for seed in range(30):
        share = qmc.Sobol(2, rng=np.random.default_rng(seed)).random(points)
        turned = np.random.default_rng(seed).random((points, 3)) < 0.05
        s = found(
            share,
            np.where(turned, ~outcome(share)[:, None], outcome(share)[:, None]).astype(float),
            grid=False,
        )
        p = outcome(qmc.Sobol(2, scramble=False).random(4096)).mean()
        variance = kept * p * (1.0 - p)
        of = variance / (variance + 0.05 * 0.95)
        held += within(s.first_interval, tuple(of * f for f in first), 0.01) and within(
            s.total_interval, tuple(of * f for f in total), 0.01
        )
    assert held >= 26
