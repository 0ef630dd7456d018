"""A recording before it is believed: checked, refused on errors, and repaired where that is safe."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from resim.core.errors import InputError
from resim.core.finding import Finding
from resim.core.schema import REPAIRED
from resim.core.spelling import did_you_mean
from resim.recordings import Recording, RecordingTables, read_tables, recording_of, write_tables
from resim.recordings.checks import CODES, examine
from resim.recordings.repairs import FILTERS, AppliedRepair, Repaired, repair
from resim.road.flaws import MAP_CODES
from resim.road.opendrive import load

MOST_LINES = 3
"""Findings of a code that are told one by one."""


def load_checked(folder: str | Path, *, accept: Collection[str] = ()) -> Recording:
    """Read a recording folder, examine it, and give it with what was found.

    Args:
        folder: The recording's folder.
        accept: Codes of errors to continue despite.

    Returns:
        The recording, with its findings.

    Raises:
        InputError: It cannot be read, or has other errors.
    """
    check_codes(accept)
    folder = Path(folder)
    tables = read_tables(folder)
    findings = examine(tables, load(tables.map))
    refuse_findings(folder, findings, accept)
    return replace(recording_of(tables, lenient=True), findings=findings)


def repair_recording(
    folder: Path, out: Path, *, max_gap: float = 1.0, outliers: str = "robust"
) -> tuple[tuple[Finding, ...], Repaired]:
    """Write a repaired copy of a recording folder as a new one, and give what was found, and what was done.

    max_gap [s] and outliers as in `repair`. The copy's provenance says in `repaired` from what and how it was
    made. Raises InputError for settings that are none, and for a folder that exists or lies in the recording.
    """
    chosen = next((name for name in FILTERS if name == outliers), None)
    if chosen is None:
        raise InputError("--outliers", f"{outliers!r} is not a filter", f"Filters: {', '.join(FILTERS)}.")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(out, "exists already", "Name a new folder: a recording is never replaced.")
    if out.resolve().is_relative_to(folder.resolve()):
        raise InputError(out, f"lies in {folder}, which stays as it is", "Name a folder elsewhere.")
    tables = read_tables(folder)
    network = load(tables.map)
    found = examine(tables, network)
    repaired = repair(tables, network, max_gap=max_gap, outliers=chosen)
    done = _repairs_in_words(repaired.done)
    how = f"from {folder.resolve().name}, --max-gap {max_gap:g} --outliers {outliers}: {done}"
    write_tables(_noted(repaired.tables, how), out)
    return found, repaired


def _noted(tables: RecordingTables, how: str) -> RecordingTables:
    """The tables with the repair in their provenance, after those before."""
    before = tables.settings.provenance
    note = "; then ".join(part for part in (before.get(REPAIRED, ""), how) if part)
    return replace(
        tables, settings=tables.settings.model_copy(update={"provenance": {**before, REPAIRED: note}})
    )


def _repairs_in_words(done: tuple[AppliedRepair, ...]) -> str:
    parts = [f"{d.source} {d.code} {d.count.samples} samples" for d in done]
    return ", ".join(parts) or "nothing to repair"


def refuse_findings(folder: Path, findings: tuple[Finding, ...], accept: Collection[str]) -> None:
    """Raise InputError for a recording with errors, but those whose codes are accepted."""
    errors = [f for f in findings if f.severity == "error" and f.code not in accept]
    if errors:
        more = f" (and {len(errors) - 1} more errors)" if len(errors) > 1 else ""
        codes = " ".join(f"--accept {code}" for code in dict.fromkeys(f.code for f in errors))
        how = "repair it with --fix" if any(f.repair for f in errors) else "correct it"
        remedy = f"See `resim check`; {how}, or continue with {codes}"
        raise InputError(folder, f"{finding_line(errors[0])}{more}", remedy)


def finding_line(finding: Finding) -> str:
    """Give a finding as `gt 3 at 2.40 s: CODE: what was found`."""
    where = f"{finding.source} {finding.object}".rstrip()
    when = "" if math.isnan(finding.start) else f" at {finding.start:.2f} s"
    return f"{where}{when}: {finding.code}: {finding.text}"


def finding_lines(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Give what is wrong with a recording, notes left out: the first of each code, and how many more there are."""
    return tuple(by_code((f.code, finding_line(f)) for f in findings if f.severity != "note"))


def by_code(lines: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Give the first lines of each code, and how many more there are of it."""
    every = list(lines)
    for code in dict.fromkeys(code for code, _ in every):
        own = [line for name, line in every if name == code]
        yield from own[:MOST_LINES]
        if len(own) > MOST_LINES:
            yield f"... and {len(own) - MOST_LINES} more {code}"


def check_codes(accept: Collection[str]) -> None:
    """Raise InputError for a code that no finding has."""
    known = {*CODES, *MAP_CODES}
    if unknown := [code for code in accept if code not in known]:
        alike = did_you_mean(unknown[0], sorted(known))
        remedy = "" if alike else f"Codes: {', '.join(sorted(known))}."
        raise InputError("--accept", f"no finding has the code {unknown[0]!r}{alike}", remedy)
