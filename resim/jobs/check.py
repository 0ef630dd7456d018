"""Examine and repair a recording: what `resim check` does."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import pandas as pd

from resim.core.finding import Finding
from resim.jobs.given import path_of
from resim.recordings import read_tables
from resim.recordings.checked import repair_recording
from resim.recordings.checks import examine
from resim.recordings.repairs import Repaired
from resim.report.markup import Markup
from resim.report.notebook import notebook_html
from resim.road.flaws import Flaw, flaws
from resim.road.opendrive import load

MAX_GAP = 1.0
"""Longest gap [s] that a repair fills, if nothing else is said."""


@dataclass(frozen=True)
class CheckResult:
    """What is wrong with a recording and its map.

    Attributes:
        recording: Its folder.
        map: Its map.
        findings: What is wrong with the recording, worst first.
        flaws: Errors in its map.
        repaired: What was repaired, and what is left, where a copy was repaired.
    """

    recording: Path
    map: Path
    findings: tuple[Finding, ...]
    flaws: tuple[Flaw, ...]
    repaired: Repaired | None = None

    @property
    def errors(self) -> int:
        """How many errors there are, in a repaired copy those that are left."""
        found = self.findings if self.repaired is None else self.repaired.left
        return sum(f.severity == "error" for f in found) + len(self.flaws)

    @property
    def table(self) -> pd.DataFrame:
        """The findings, a row each."""
        return pd.DataFrame([asdict(finding) for finding in self.findings])

    def __repr__(self) -> str:
        kinds = ", ".join(f"{f.code} ({f.severity})" for f in self.findings[:5]) or "nothing found"
        return f"<CheckResult {self.recording.name}: {self.errors} error(s); {kinds}>"

    def _repr_html_(self) -> str:
        return notebook_html(repr(self).strip("<>"), Markup(), {"findings": self.table})


def check(recording: str | Path) -> CheckResult:
    """Examine a recording: what is wrong with it, what that means for results, and what can be repaired.

    Args:
        recording: Its folder, which stays as it is.

    Returns:
        The findings, and the errors of the map.

    Raises:
        InputError: The recording cannot be read.
    """
    folder = path_of(recording)
    tables = read_tables(folder)
    network = load(tables.map)
    errors = tuple(f for f in flaws(network) if f.severity == "error")
    return CheckResult(folder, tables.map, tuple(examine(tables, network)), errors)


def repair(
    recording: str | Path, out: str | Path, *, max_gap: float = MAX_GAP, outliers: str = "robust"
) -> CheckResult:
    """Write a repaired copy of a recording.

    Args:
        recording: Its folder, which stays as it is.
        out: A new folder for the copy.
        max_gap: Longest gap [s] that is filled.
        outliers: What tells outliers: robust or moving-average.

    Returns:
        The findings before, what was repaired, and what is left.

    Raises:
        InputError: The recording cannot be read, or the folder is there.
    """
    folder = path_of(recording)
    found, repaired = repair_recording(folder, path_of(out), max_gap=max_gap, outliers=outliers)
    road = read_tables(folder).map
    errors = tuple(f for f in flaws(load(road)) if f.severity == "error")
    return CheckResult(folder, road, tuple(found), errors, repaired)
