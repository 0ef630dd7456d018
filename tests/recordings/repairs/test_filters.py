from __future__ import annotations

import numpy as np
import pytest

from resim.core.geometry import Bools, Floats
from resim.recordings.repairs.filters import moving_average_outliers, robust_outliers


def profile(size: float, seed: int = 0) -> tuple[Floats, Bools]:
    """A speed profile at 25 Hz, 0.05 m/s of noise, and 20 outliers of that size, up to two in a row."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 40.0, 0.04)
    v = np.interp(t, [0.0, 10.0, 14.0, 20.0, 40.0], [20.0, 22.0, 8.0, 8.0, 30.0]) + rng.normal(
        0.0, 0.05, len(t)
    )
    off = np.zeros(len(t), dtype=bool)
    starts = 15 + 60 * np.arange(16)
    off[starts] = True
    off[starts[:4] + 1] = True
    return np.where(off, v + size * rng.choice([-1.0, 1.0], len(t)), v), off


def rates(found: Bools, true: Bools) -> tuple[float, float]:
    """Recall and precision."""
    return float(found[true].mean()), float(true[found].mean()) if found.any() else 0.0


@pytest.mark.parametrize("size", [1.0, 3.0, 20.0])
def test_the_robust_filter_finds_all_outliers_and_nothing_else(size: float) -> None:
    values, true = profile(size)
    recall, precision = rates(robust_outliers(values, 11, 4.0, least=0.5), true)
    assert recall == 1.0
    assert precision == 1.0


def test_the_moving_average_finds_outliers_a_little_above_its_threshold() -> None:
    values, true = profile(2.0)
    recall, precision = rates(moving_average_outliers(values, 11, 1.0), true)
    assert recall == 1.0
    assert precision == 1.0


def test_the_moving_average_takes_the_neighbours_of_large_outliers_with_them() -> None:
    """What the published method does: h / window over the threshold."""
    values, true = profile(20.0)
    recall, precision = rates(moving_average_outliers(values, 11, 1.0), true)
    assert recall == 1.0
    assert precision < 0.2


def test_positions_are_taken_together() -> None:
    values = np.zeros(30) + 1j * np.zeros(30)
    values[[10, 20]] = [3.0, 2.0j]
    for found in (robust_outliers(values, 9, least=0.5), moving_average_outliers(values, 9, 0.5)):
        assert np.flatnonzero(found).tolist() == [10, 20]


def test_data_that_repeat_have_no_outliers_below_the_least() -> None:
    values = np.zeros(30)
    values[7] = 0.4
    assert not robust_outliers(values, 9, least=0.5).any()
    assert not robust_outliers(np.zeros(0), 9).any()


@pytest.mark.parametrize("window", [1, 4, 0])
def test_a_window_has_a_middle(window: int) -> None:
    with pytest.raises(ValueError, match="odd"):
        robust_outliers(np.zeros(9), window)
