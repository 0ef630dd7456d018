"""How a recording is to be repaired."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from resim.core.errors import InputError
from resim.core.finding import Finding

Filter = Literal["robust", "moving-average"]

LONGEST = 60.0
"""Longest gap [s] that anyone may ask to have filled."""
FILTERS: tuple[Filter, ...] = ("robust", "moving-average")


@dataclass(frozen=True)
class RepairOptions:
    """max_gap [s]: the longest gap that is filled. outliers: the filter that tells them.

    findings: what else is known to be wrong, for repairs that must not reach across it.
    """

    max_gap: float
    outliers: Filter
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 <= self.max_gap <= LONGEST:
            raise InputError("--max-gap", f"{self.max_gap:g} s is not allowed", f"Give 0 to {LONGEST:g} s.")
        if self.outliers not in FILTERS:
            raise InputError(
                "--outliers", f"{self.outliers!r} is not a filter", f"Filters: {', '.join(FILTERS)}."
            )

    def torn(self, like: Finding) -> tuple[Finding, ...]:
        """Give the jumps for good, which no repair takes out, of the object that the finding is of."""
        return tuple(
            f for f in self.findings
            if f.code in ("POSITION_JUMP", "ID_REUSED", "ID_SWITCH")
            and f.source == like.source and (f.object == like.object or not like.object)
        )  # fmt: skip
