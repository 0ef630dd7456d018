"""Distributions of files: their moments, their ends, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from resim.core.distribution import RandomNumber, constant


@pytest.mark.parametrize("kind", ["normal", "lognormal"])
def test_draws_have_the_mean_and_the_spread(kind: str) -> None:
    drawn = RandomNumber(kind=kind, mean=5.0, sd=1.5).draw(np.random.default_rng(1), 100_000)
    assert drawn.mean() == pytest.approx(5.0, abs=0.02)
    assert drawn.std() == pytest.approx(1.5, abs=0.02)


def test_draws_stay_between_the_ends_and_are_the_same_for_a_seed() -> None:
    one = RandomNumber(mean=0.0, sd=1.0, min=-0.5, max=0.5)
    drawn = one.draw(np.random.default_rng(3), 10_000)
    assert np.abs(drawn).max() <= 0.5
    assert (
        0.27 < drawn.std() < 0.30
    )  # a normal distribution cut at half a standard deviation, not piled up there
    assert (drawn == one.draw(np.random.default_rng(3), 10_000)).all()
    assert (constant(2.5).draw(np.random.default_rng(1), 4) == 2.5).all()
    drawn = RandomNumber(kind="uniform", min=2.0, max=4.0).draw(np.random.default_rng(1), 10_000)
    assert (drawn.min(), drawn.max()) == (pytest.approx(2.0, abs=0.01), pytest.approx(4.0, abs=0.01))


@pytest.mark.parametrize(
    ("told", "problem"),
    [
        ({}, "mean: is missing"),
        ({"kind": "uniform", "mean": 1.0}, "a uniform distribution has min and max"),
        ({"kind": "lognormal", "mean": -1.0}, "expected more than 0"),
        ({"mean": 1.0, "min": 3.0, "max": 2.0}, "min: expected at most max"),
        ({"mean": 0.0, "sd": 1.0, "min": 9.0}, "more than 4 sd outside"),
        ({"mean": 0.0, "sd": -1.0}, "greater than or equal to 0"),
    ],
)
def test_what_no_number_can_be_drawn_of_is_refused(told: dict[str, object], problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        RandomNumber(**told)
