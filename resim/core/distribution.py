"""A distribution as a file says it, and draws from it."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from resim.core.geometry import Floats
from resim.core.spec import Strict

Finite = Annotated[float, Field(strict=True)]
_MOST_DRAWS = 1000


MOST_SPREAD = 100.0
"""Standard deviation of a lognormal number over its mean, at most: beyond it one draw makes the mean."""


class RandomNumber(Strict):
    """A number that differs from one to the next.

    Attributes:
        kind: normal, lognormal or uniform; of a uniform one, min and max say all.
        mean: Mean, of what is drawn before it is cut.
        sd: Standard deviation, likewise.
        min: Least: what is below is drawn again.
        max: Largest: what is above is drawn again.
    """

    kind: Literal["normal", "lognormal", "uniform"] = "normal"
    mean: Finite | None = None
    sd: Annotated[float, Field(strict=True, ge=0.0)] = 0.0
    min: Finite | None = None
    max: Finite | None = None

    @model_validator(mode="after")
    def _whole(self) -> RandomNumber:
        low, high = self.min, self.max
        if low is not None and high is not None and low > high:
            raise ValueError(f"min: expected at most max ({high:g}), found {low:g}")
        if self.kind == "uniform":
            if low is None or high is None:
                raise ValueError("a uniform distribution has min and max")
            return self
        if self.mean is None:
            raise ValueError("mean: is missing")
        if self.kind == "lognormal" and self.mean <= 0.0:
            raise ValueError(f"mean: expected more than 0 of a lognormal distribution, found {self.mean:g}")
        if self.kind == "lognormal" and self.sd > MOST_SPREAD * self.mean:
            raise ValueError(
                f"sd: expected at most {MOST_SPREAD:g} times the mean of a lognormal, found {self.sd:g}"
            )
        reach = 4.0 * self.sd
        if (low is not None and self.mean + reach < low) or (high is not None and self.mean - reach > high):
            raise ValueError(
                "mean: lies more than 4 sd outside of min and max, so hardly anything would be drawn"
            )
        return self

    def draw(self, rng: np.random.Generator, count: int) -> Floats:
        """Give so many draws (count,)."""
        low = -np.inf if self.min is None else self.min
        high = np.inf if self.max is None else self.max
        if self.kind == "uniform":
            return rng.uniform(low, high, count)
        out = self._uncut(rng, count)
        for _ in range(_MOST_DRAWS):
            outside = (out < low) | (out > high)
            if not outside.any():
                return out
            out[outside] = self._uncut(rng, int(outside.sum()))
        return np.clip(out, low, high)

    def _uncut(self, rng: np.random.Generator, count: int) -> Floats:
        assert self.mean is not None
        if self.kind == "normal":
            return rng.normal(self.mean, self.sd, count)
        spread = np.log1p((self.sd / self.mean) ** 2)  # of the logarithm, by mean and sd of the number itself
        return rng.lognormal(np.log(self.mean) - 0.5 * spread, np.sqrt(spread), count)


def constant(value: float) -> RandomNumber:
    """Give the distribution that always has one value."""
    return RandomNumber(mean=value)
