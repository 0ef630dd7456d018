"""Plans of experiments."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import qmc, truncnorm
from swept import design

from resim.sweeps.file import _seeds
from resim.sweeps.plans.parameter import SweepParameter
from resim.sweeps.plans.registry import PLANS

LATENCY = SweepParameter(name="perception.latency.speed", low=0.0, high=1.0, steps=5)
BIAS = SweepParameter(name="perception.errors.longitudinal.bias.constant", low=-2.0, high=2.0, steps=3)
DRAWN = ("sobol", "halton", "latin_hypercube")


def test_a_grid_has_all_combinations() -> None:
    points = design((LATENCY, BIAS), "grid", 0, 0)
    assert points.shape == (15, 2)
    assert len(np.unique(points, axis=0)) == 15
    assert np.unique(points[:, 0]).tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert np.unique(points[:, 1]).tolist() == [-2.0, 0.0, 2.0]


def test_one_at_a_time_leaves_the_others_at_their_base() -> None:
    latency = LATENCY.model_copy(update={"base": 0.1})
    points = design((latency, BIAS), "one_at_a_time", 0, 0)
    moved = points != [0.1, 0.0]
    assert (moved.sum(axis=1) <= 1).all()
    assert len(points) == 1 + 5 + 2


@pytest.mark.parametrize("plan", DRAWN)
def test_drawn_plans_fill_the_ranges_evenly(plan: str) -> None:
    points = design((LATENCY, BIAS), plan, 256, 3)
    assert points.shape == (256, 2)
    unit = qmc.scale(points, [0.0, -2.0], [1.0, 2.0], reverse=True)
    assert qmc.discrepancy(unit) < (0.01 if plan == "latin_hypercube" else 1e-3)


@pytest.mark.parametrize("plan", [plan.name for plan in PLANS if not plan.grows])
def test_a_plan_is_the_same_for_the_same_seed(plan: str) -> None:
    one, two, other = (design((LATENCY, BIAS), plan, 16, seed) for seed in (1, 1, 2))
    assert np.array_equal(one, two)
    assert np.array_equal(one, other) != (plan in DRAWN)


@pytest.mark.parametrize("plan", [plan.name for plan in PLANS if not plan.grows])
def test_a_plan_knows_how_many_points_it_has_at_most(plan: str) -> None:
    latency = LATENCY.model_copy(update={"base": 0.1})  # none of its levels, so that no point is there twice
    bias = BIAS.model_copy(update={"base": 0.1})
    assert len(design((latency, bias), plan, 17, 0)) == PLANS[plan].count((latency, bias), 17)


def test_a_normal_distribution_is_cut_off_at_its_ends() -> None:
    parameter = SweepParameter(name="function.threat_time", low=2.0, high=5.0, mean=4.0, std=1.0)
    values = design((parameter,), "sobol", 4096, 0)[:, 0]
    assert values.min() >= 2.0
    assert values.max() <= 5.0
    assert np.median(values) == pytest.approx(4.0 - 0.1713, abs=0.005)  # half of what lies between 2 and 5
    assert (values < 3.0).mean() == pytest.approx(0.1660, abs=0.005)


def test_single_values_are_taken_as_they_are() -> None:
    parameter = SweepParameter(name="build.cycle_time", values=(0.04, 0.08, 0.2))
    assert design((parameter,), "grid", 0, 0)[:, 0].tolist() == [0.04, 0.08, 0.2]
    counts = np.unique(design((parameter,), "latin_hypercube", 300, 0), return_counts=True)[1]
    assert counts.tolist() == [100, 100, 100]


@pytest.mark.parametrize(
    ("fields", "fault"),
    [
        ({"low": 0.0}, "low and high"),
        ({"low": 1.0, "high": 0.0}, "is not below"),
        ({"low": 0.0, "high": 1.0, "values": (1.0,)}, "low and high, or values"),
        ({"low": 0.0, "high": 1.0, "mean": 0.5}, "mean and std"),
        ({"values": (1.0, 1.0)}, "is a duplicate"),
        ({"low": 0.0, "high": float("nan")}, "finite"),
    ],
)
def test_a_parameter_that_is_none_is_refused(fields: dict[str, object], fault: str) -> None:
    with pytest.raises(ValidationError, match=fault):
        SweepParameter.model_validate({"name": "function.threat_time", **fields})
    with pytest.raises(ValidationError, match="a name that begins with"):
        SweepParameter(name="threat_time", low=0.0, high=1.0)


@pytest.mark.parametrize(
    ("low", "high", "mean", "std"),
    [(0.4, 1.2, 0.1, 0.03), (0.5, 1.2, 2.0, 0.1), (0.0, 1.0, 0.5, 0.2), (0.4, 1.2, 0.1, 0.011)],
)
def test_a_mean_far_outside_of_the_range_draws_at_its_near_end(
    low: float, high: float, mean: float, std: float
) -> None:
    """As SciPy's truncated normal has it."""
    parameter = SweepParameter(name="function.x", low=low, high=high, mean=mean, std=std)
    share = np.linspace(0.0, 1.0, 101)
    true = truncnorm((low - mean) / std, (high - mean) / std, loc=mean, scale=std).ppf(share)
    np.testing.assert_allclose(parameter.at(share), true, atol=1e-12)
    np.testing.assert_allclose(parameter.share(parameter.at(share)), share, atol=1e-9)


def test_a_mean_beyond_all_reason_is_refused() -> None:
    with pytest.raises(ValidationError, match="more than 30 std outside"):
        SweepParameter(name="function.x", low=0.5, high=1.2, mean=2.0, std=0.01)


def test_a_point_that_is_there_again_has_seeds_of_its_own() -> None:
    """As values that are listed are in drawn plans: copies of one run are no evidence."""
    points = np.array([[0.5], [0.1], [0.5], [0.5], [0.1]])
    seeds = _seeds(points, 3)
    assert len(np.unique(seeds)) == seeds.size
    assert np.array_equal(seeds[:2], _seeds(points[:2], 3))
    assert np.array_equal(_seeds(points[[1, 0]], 3), seeds[[1, 0]])


@pytest.mark.parametrize("most", range(1, 200))
def test_levels_of_whole_numbers_are_whole(most: int) -> None:
    number = SweepParameter(name="variation.number", low=0.0, high=float(most), steps=most + 1)
    np.testing.assert_array_equal(number.levels(), np.arange(most + 1))
