"""Linear and nonlinear correlation: Fig. B.4's pattern, and what is known of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resim.core.correlation import independent_nonlinear, nonlinear, pearson, uncorrelated_pearson
from resim.core.geometry import Floats


def example(samples: int = 10_000) -> Floats:
    """The signals of Eq. B.11, noise 30 dB below the mean square."""
    t, rng = np.linspace(0.0, 100.0, samples), np.random.default_rng(1)
    x1, x3 = 0.75 * (np.sin(t) + 1.0), 0.75 * (np.cos(t) + 1.0)

    def noisy(x: Floats) -> Floats:
        return x + rng.normal(0.0, np.sqrt(np.mean(x**2) * 1e-3), samples)

    return np.stack([x1, noisy(x1), x3, noisy(x3), np.exp(t / 100.0) - 1.0], axis=1)


def test_fig_b4_with_ten_ranks() -> None:
    signals = example()
    linear, more = np.abs(pearson(signals)), nonlinear(signals, 10)
    assert linear[0, 1] == pytest.approx(0.999, abs=1e-3)
    assert linear[0, 2] == pytest.approx(0.003, abs=2e-3)
    assert linear[:4, 4].max() <= 0.05
    assert more[0, 1] == pytest.approx(0.78, abs=0.01)  # noise is recognised
    assert more[0, 2] == pytest.approx(0.66, abs=0.01)  # shifted in time: mediocre
    assert more[:4, 4].max() < 0.02
    assert more[0, 1] > more[0, 2] > more[0, 4]


def plainly(x: Floats, y: Floats, b: int) -> float:
    """Eq. B.10 counted pair by pair."""
    count = len(x)
    ranks = []
    for values in (x, y):
        rank = [0] * count
        for place, n in enumerate(sorted(range(count), key=lambda k: (values[k], k))):
            rank[n] = place * b // count
        ranks.append(rank)
    total = 0.0
    for i in range(b):
        for j in range(b):
            n = sum(1 for p, q in zip(*ranks, strict=True) if (p, q) == (i, j))
            total += n / count * np.log(n / count) / np.log(b) if n else 0.0
    return 2.0 + total


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(2, 7), st.integers(10, 60), st.booleans())
def test_equals_the_formula_counted_plainly(seed: int, b: int, count: int, ties: bool) -> None:
    rng = np.random.default_rng(seed)
    signals = rng.normal(size=(count, 3))
    signals = np.round(signals, 1) if ties else signals
    found = nonlinear(signals, b)
    for i in range(3):
        for j in range(3):
            assert found[i, j] == pytest.approx(plainly(signals[:, i], signals[:, j], b), abs=1e-6)


def test_independent_signals_have_the_bias_that_is_named() -> None:
    rng = np.random.default_rng(3)
    for samples, b, off in (
        (1000, 10, 0.1),
        (500, 20, 0.25),
    ):  # of first order: cells with few samples are off
        mean = np.mean([nonlinear(rng.normal(size=(samples, 2)), b)[0, 1] for _ in range(60)])
        assert mean == pytest.approx(independent_nonlinear(samples, b), rel=off)


@pytest.mark.parametrize(("trained", "samples", "count"), [(500, 500, 20), (2000, 300, 5)])
def test_held_out_components_have_the_bias_that_is_named(trained: int, samples: int, count: int) -> None:
    """Axes of a sample of uncorrelated signals, by their covariance, and the largest coefficient of another sample."""
    rng, largest = np.random.default_rng(3), []
    spread = 0.8 ** np.arange(count)
    for _ in range(60):
        _, axes = np.linalg.eigh(np.cov(rng.normal(size=(trained, count)) * spread, rowvar=False))
        held = (rng.normal(size=(samples, count)) * spread) @ axes
        largest.append(np.abs(np.corrcoef(held, rowvar=False) - np.eye(count)).max())
    assert np.mean(largest) == pytest.approx(uncorrelated_pearson(trained, samples, count), rel=0.07)
    assert uncorrelated_pearson(trained, samples, 1) == 0.0


def test_a_constant_signal_correlates_with_nothing() -> None:
    found = pearson(np.column_stack([np.full(20, 0.1), np.arange(20.0)]))
    np.testing.assert_array_equal(found, np.eye(2))


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(ValueError, match="expected from 2 to 5 ranks"):
        nonlinear(np.zeros((5, 2)), 10)
