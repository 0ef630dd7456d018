"""What training finds with few drives: dependences and maneuvers that are there, and none that are not."""

from __future__ import annotations

import numpy as np
import pytest
from perception.generator import KNOWN, Beyond, drives
from scipy.stats import norm

from resim.perception.training import train
from resim.perception.training.clusters import between_drives, by_drive, certain


@pytest.mark.parametrize("count", [6, 10])
def test_a_dependence_is_found_with_few_drives(count: int) -> None:
    """A score over n drives never exceeds the root of n: 10 drives did not show what 5 and 20 did."""
    found = train(drives(KNOWN["noise"], 1, count, rate=10.0), name="few")
    assert found.errors.longitudinal.noise.range == pytest.approx(0.01, rel=0.2)
    assert found.errors.lateral.noise.model_dump(exclude={"constant"}) == pytest.approx(
        {"range": 0.0, "bearing": 0.0, "relative_speed": 0.0, "acceleration": 0.0}
    )
    assert found.maneuvers == {}


def test_a_maneuver_has_its_own_errors_with_few_drives() -> None:
    braking = Beyond(braking=(("heading", 0.02),))
    found = train(drives(KNOWN["noise"], 1, 9, rate=10.0, beyond=braking), name="few")
    own, every = found.maneuvers["braking"].errors.heading.bias, found.errors.heading.bias
    at = -2.0  # m/s², while it brakes
    assert own.constant + at * own.acceleration == pytest.approx(0.02, abs=0.003)
    assert abs(every.constant + at * every.acceleration) < 0.017


def test_estimates_are_judged_by_what_each_drive_changes() -> None:
    """The mean of drives of very different length, each left out in turn: said in closed form."""
    rng = np.random.default_rng(1)
    drive = np.repeat(np.arange(7), [3, 50, 5, 8, 20, 2, 12])
    y = rng.standard_normal(7)[drive] + 0.1 * rng.standard_normal(len(drive))
    scores, weights = by_drive(y - y.mean(), drive), by_drive(np.ones(len(y)), drive)
    means = np.array([y[drive != k].mean() for k in range(7)])
    expected = 6.0 / 7.0 * ((means - y.mean()) ** 2).sum()
    assert between_drives(scores[:, None], weights[:, None, None])[0, 0] == pytest.approx(expected)


@pytest.mark.parametrize("count", [5, 6, 8, 10, 20])
def test_what_is_sure_has_no_bound_and_errs_as_seldom_as_it_says(count: int) -> None:
    """Offsets that differ from drive to drive, in drives of different length, and none in the mean."""
    rng = np.random.default_rng(count)
    length = rng.integers(50, 150, count)
    information = length[:, None, None].astype(float)

    def z(sums: np.ndarray) -> float:
        mean = sums.sum() / length.sum()
        return float(abs(mean) / np.sqrt(between_drives((sums - mean * length)[:, None], information)[0, 0]))

    assert z(length * (1.0 + 0.001 * rng.standard_normal(count))) > 100.0
    said = certain(2.0, count)
    wrong = np.mean([z(length * rng.standard_normal(count)) > said for _ in range(1500)])
    assert wrong < 2.0 * norm.sf(2.0) + 3.0 * np.sqrt(0.0455 / 1500)
