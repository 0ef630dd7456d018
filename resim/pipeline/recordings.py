"""A recording before it is believed: examined, refused on errors, and repaired where that is safe."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from resim.check import CODES, examine
from resim.core.errors import InputError
from resim.core.finding import Finding
from resim.ingest import Recording, read_tables, recording_of
from resim.road.flaws import MAP_CODES
from resim.road.opendrive import load


def examined(folder: Path, *, accept: Collection[str] = ()) -> Recording:
    """Read a recording folder, examine it, and give it with what was found.

    accept: codes of errors in spite of which it is taken. Raises InputError for any other error.
    """
    check_codes(accept)
    tables = read_tables(folder)
    findings = examine(tables, load(tables.map))
    refuse_findings(folder, findings, accept)
    return replace(recording_of(tables, lenient=True), findings=findings)


def refuse_findings(folder: Path, findings: tuple[Finding, ...], accept: Collection[str]) -> None:
    """Raise InputError for a recording with errors, but those whose codes are accepted."""
    errors = [f for f in findings if f.severity == "error" and f.code not in accept]
    if errors:
        more = f" (and {len(errors) - 1} more errors)" if len(errors) > 1 else ""
        codes = " ".join(f"--accept {code}" for code in dict.fromkeys(f.code for f in errors))
        remedy = f"See `resim check`; repair it with --fix, or go on with {codes}"
        raise InputError(folder, f"{finding_line(errors[0])}{more}", remedy)


def finding_line(finding: Finding) -> str:
    """Give a finding as `gt 3: CODE: what was found`."""
    where = f"{finding.source} {finding.object}".rstrip()
    return f"{where}: {finding.code}: {finding.text}"


def check_codes(accept: Collection[str]) -> None:
    """Raise InputError for a code that no finding has."""
    known = {*CODES, *MAP_CODES}
    if unknown := [code for code in accept if code not in known]:
        raise InputError(
            "--accept", f"no finding has the code {unknown[0]!r}", f"Codes: {', '.join(sorted(known))}."
        )
