"""The test of likeness tells what is planted, and does not tell what is the same."""

import numpy as np
import pytest
from traced import kernel, lane_changes

from resim.variations.features import POINTS
from resim.variations.likeness import (
    ALIKE,
    TOLD,
    apart_by_series,
    area,
    tell_apart,
    varied_traces,
    with_noise,
)

HELD_OUT = lane_changes(120, seed=4)


def test_area_is_the_share_of_pairs_in_order() -> None:
    rng = np.random.default_rng(0)
    score, y = rng.integers(0, 6, 40).astype(float), rng.integers(0, 2, 40)
    pairs = [(a, b) for a in score[y == 1] for b in score[y == 0]]
    wanted = np.mean([1.0 if a > b else 0.5 if a == b else 0.0 for a, b in pairs])
    assert area(score, y) == pytest.approx(wanted)


def test_small_variations_are_not_told_and_noise_is() -> None:
    measured, varied = varied_traces(kernel(), HELD_OUT, 0.005)
    alike = tell_apart(measured, varied)
    assert alike.low <= alike.auc <= alike.high
    assert alike.auc <= ALIKE
    noisy = tell_apart(measured, with_noise(measured, np.random.default_rng(1)))
    assert noisy.auc > TOLD
    assert any("jerk" in name or "acceleration" in name for name in noisy.by)


def test_traces_are_taken_as_they_are() -> None:
    measured, _ = varied_traces(kernel(), HELD_OUT[:3], 0.0)
    np.testing.assert_allclose(measured, HELD_OUT[:3], atol=2e-3)


def test_speeds_at_which_a_recording_dwells_are_told_by_their_values() -> None:
    """As NGSIM's do at whole 5 ft/s; those across, where nothing differs, tell nothing."""
    rng = np.random.default_rng(3)
    t, step = np.linspace(0.0, 9.8, POINTS), 0.2
    measured = []
    for _ in range(150):
        speed = 1.524 * np.repeat(rng.integers(6, 12, 7), 7)[: POINTS - 1]
        s = np.concatenate([[0.0], np.cumsum(speed * step)])
        measured.append(np.concatenate([t, s, np.zeros(POINTS)]))
    one = np.array(measured)
    other = one.copy()
    other[:, POINTS : 2 * POINTS] += rng.normal(0.0, 0.15, (150, 1)) * t
    found = apart_by_series(one, other)
    assert found["speed along"].auc > TOLD
    assert found["speed across"].auc == 0.5
