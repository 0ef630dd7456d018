"""Shares of seeds, with what is known about them."""

from __future__ import annotations

from dataclasses import dataclass

from resim.core.intervals import CONFIDENCE, wilson


@dataclass(frozen=True)
class SeedShare:
    """`count` of `of` seeds agree; low, high: the interval of their true share at a confidence, and how it was made."""

    count: int
    of: int
    low: float
    high: float
    confidence: float
    method: str

    @property
    def value(self) -> float:
        """The share."""
        return self.count / self.of


def share(agrees: list[bool]) -> SeedShare:
    """Give the share of those that agree, of one or more; its interval takes their number for given beforehand."""
    low, high = wilson(sum(agrees), len(agrees))
    return SeedShare(sum(agrees), len(agrees), float(low), float(high), CONFIDENCE, "Wilson")
