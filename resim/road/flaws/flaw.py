"""The form of a finding."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from resim.core.spec import NumberOrNan

Severity = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")


@dataclass(frozen=True)
class Flaw:
    """One flaw: its code, where it stands, how large it is, and a sentence that says so.

    road: id, None where it concerns the map or a junction. section: index of the lane section, lane: id, s:
    [m] along the road; each None where the flaw has none. value in `unit`, NaN with "" where none.
    """

    severity: Severity
    code: str
    road: str | None
    section: int | None
    lane: int | None
    s: float | None
    value: NumberOrNan
    unit: str
    text: str

    def order(self) -> tuple[Any, ...]:
        """Give the key that sorts flaws: the worst first, and no two alike."""
        size = 0.0 if math.isnan(self.value) else -abs(self.value)
        return (SEVERITIES.index(self.severity), self.code, size, self.road or "", self.s or 0.0, self.text)
