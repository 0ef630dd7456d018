"""Offsets that each object has for good, and columns that nothing is known of."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from resim.perception.training.residuals import Regression
from resim.perception.training.spread import SpreadProblem, fit_spreads
from resim.perception.training.variogram import reconsidered


@pytest.mark.parametrize(("duration", "step"), [(10.0, 0.04), (60.0, 0.2)])
def test_an_offset_that_an_object_has_for_good_is_as_large_as_it_is(duration: float, step: float) -> None:
    rng = np.random.default_rng(4)
    shape = 30, int(duration / step)
    offset = rng.normal(0.0, 1.0, (30, 1))
    error = offset - offset.mean() + rng.normal(0.0, 0.2, shape)
    drive = np.repeat(np.arange(10), 3)
    problem = SpreadProblem(
        error, np.ones(shape, dtype=bool), np.full(shape, step), np.zeros((*shape, 0)), drive
    )
    fitted = fit_spreads(problem)
    assert fitted is not None
    found = reconsidered(fitted, problem)
    assert found.drift is not None
    assert found.noise is not None
    assert np.exp(found.drift) == pytest.approx(offset.std(), rel=0.06)
    assert np.exp(found.noise) == pytest.approx(0.2, rel=0.03)


def test_a_column_of_the_model_that_is_0_throughout_hides_no_dependence() -> None:
    """As the latency of headings on a straight road: nothing is known of it, but what else errors depend on is."""
    rng = np.random.default_rng(0)
    x = rng.normal(0.0, 1.0, (40, 3))
    x[:, 1] = 0.0
    y = 0.7 * x[:, 2] + rng.normal(0.0, 0.1, 40)
    drives = x.reshape(8, 5, 3), y.reshape(8, 5)
    normal, right = np.einsum("dti,dtj->dij", drives[0], drives[0]), np.einsum("dti,dt->di", *drives)
    regression = Regression(("constant", "latency", "braking"), normal, right, 0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        judged = regression.judged(["constant", "latency"], "braking")
    assert judged is not None
    assert judged[0][-1] == pytest.approx(0.7, abs=0.1)
    assert 0.0 < judged[1][-1] < 0.1
