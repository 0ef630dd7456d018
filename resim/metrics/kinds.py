"""Words for measures that criteria and definitions share."""

from __future__ import annotations

from typing import Literal

MeasureKind = Literal["functional", "quantitative", "legal"]
"""functional: what the function and its perception did; quantitative: how near, how hard, how risky; legal: what rules
say (Groh 2018, III.B)."""
WorstEnd = Literal["low", "high", "both"]
"""Which end of a measure is the worse one; both: the one farther from 0."""
