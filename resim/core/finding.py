"""Findings: what a look at a recording turned up, one struct that readers, checks and reports share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from resim.core.spec import NumberOrNan

Severity = Literal["error", "warning", "note"]
Source = Literal["gt", "sd", "recording"]

SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")
"""From worst: results would be wrong; results are qualified; worth knowing."""


@dataclass(frozen=True)
class Finding:
    """One fault of a recording.

    code: its kind, one of `recordings.checks.CODES`. source: the table it is in, "recording" where it is in both.
    object: its id there, "" where the whole table is concerned. start, end [s]: when, NaN where that has no
    meaning. value: how large, in `unit`. text: what was found, in one line with numbers. meaning: what it does
    to the result. repair: what a repair would do, "" where none is safe. details: the numbers and ids that this
    repair needs, by name (`resim.recordings.repairs`): SI units.
    """

    code: str
    severity: Severity
    source: Source
    object: str
    start: NumberOrNan
    end: NumberOrNan
    value: NumberOrNan
    unit: str
    text: str
    meaning: str
    repair: str
    details: Mapping[str, NumberOrNan | str] = field(default_factory=dict, hash=False)
