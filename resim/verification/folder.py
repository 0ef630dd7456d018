"""The folder of a verification: one result a recording as it comes, and the whole at the end."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from resim.core.errors import InputError
from resim.core.files import read_file
from resim.core.json_text import json_text
from resim.core.provenance import versions
from resim.core.sealed import read_sealed, sealed
from resim.core.spec import read_sealed_json, to_json
from resim.report import SHEET
from resim.results import HALF, VERIFICATION, check_output, whole_file
from resim.verification.cases import CASES, Traces
from resim.verification.entries import FailedRecording
from resim.verification.execution import DRIVES, REPORTS, files_of
from resim.verification.inputs import VerificationBegun, VerificationRequest
from resim.verification.junit import junit
from resim.verification.page import write_verification_page
from resim.verification.report import VerificationReport

SUMMARIES = ("verification.json", "verification.html", "junit.xml")
"""What tells of all recordings."""
REMEDY = "Give the verification.json that `resim verify` wrote."


_OWN = re.compile(rf"({CASES}|{DRIVES}|{REPORTS})/[^/\0]+")
LONGEST = 512
"""Characters of a file's name with its folder."""


def begin(out: Path, a: VerificationRequest) -> None:
    """Make the folder, or go on in it, and say in it what is asked for.

    What is there of other inputs stays until the new results are whole, its summaries as `*.previous`.
    Raises InputError where it holds anything that is no result.
    """
    check_output(out, VERIFICATION)
    files = files_of(a)
    mark = out / VERIFICATION.mark
    before = read_file(mark, "Remove it.") if mark.is_file() else b""
    if before:
        _refuse_other(out, mark, a)
        files += [name for name in _listed(mark) if name not in files and (out / name).is_file()]
    told = _mark(a, files)
    if before != told.encode():
        for name in SUMMARIES:
            if (out / name).is_file():
                (out / name).replace(out / f"{name}.previous")
    _write(mark, told)
    for folder in (out, *(out / name for name in VERIFICATION.inside)):
        for path in folder.glob(".*.new"):  # of one that was killed
            if HALF.fullmatch(path.name):
                path.unlink()


def _mark(a: VerificationRequest, files: Sequence[str]) -> str:
    return json_text(sealed(to_json(VerificationBegun(versions(), a, tuple(files)))))


def _listed(mark: Path) -> list[str]:
    """The files that a verification may have written into its folders; others that the mark names are not its own."""
    told = read_sealed(mark, "Remove it.")["files"]
    names = (name for name in told if isinstance(name, str) and len(name) < LONGEST)
    return [name for name in names if _OWN.fullmatch(name) and name.split("/")[1] not in (".", "..")]


def _refuse_other(out: Path, mark: Path, a: VerificationRequest) -> None:
    """Raise InputError where the folder holds the verification of another suite or build: it would be lost."""
    held = read_sealed(mark, "Remove it.")["inputs"]
    if not isinstance(held, dict):
        raise InputError(mark, "is not what `resim verify` writes", "Remove it.")
    labels = [_label(held.get(which)) for which in ("build", "against")]
    was = _subject(held.get("name"), *labels)
    now = _subject(a.name, a.build.label, None if a.against is None else a.against.label)
    if was != now:
        raise InputError(out, f"holds the verification {was}, not {now}", "Name another folder with --out.")


def _label(build: object) -> str | None:
    label = build.get("label") if isinstance(build, dict) else None
    return label if isinstance(label, str) else None


def _subject(suite: str | None, build: str | None, against: str | None) -> str:
    return f"of {build} on {suite}" + ("" if against is None else f" against {against}")


def write(out: Path, found: VerificationReport, traces: Mapping[str, Traces]) -> None:
    """Write verification.json, verification.html and junit.xml, and take away pages that nothing leads to.

    What somebody else put beside them stays.
    """
    told = {report for r in found.recordings for report in r.reports}
    told |= {r.drive for r in found.recordings if not isinstance(r, FailedRecording) and r.drive}
    told |= {f"{Path(page).parent}/{SHEET}" for page in told}
    with whole_file(out / "verification.html", None) as path:
        write_verification_page(found, traces, path)
    _write(out / "junit.xml", junit(found))
    _write(out / "verification.json", text(found))
    told |= {f"{CASES}/{r.name}.json" for r in found.recordings}
    mark = out / VERIFICATION.mark
    for name in _listed(mark):
        if name not in told:
            (out / name).unlink(missing_ok=True)
    _write(mark, _mark(found.inputs, files_of(found.inputs)))
    for name in SUMMARIES:
        (out / f"{name}.previous").unlink(missing_ok=True)


def text(found: VerificationReport) -> str:
    """Give verification.json."""
    return json_text(sealed(to_json(found)))


def read(path: Path) -> VerificationReport:
    """Read a verification.json. Raises InputError."""
    return read_sealed_json(path, VerificationReport, "resim verify", REMEDY)


def _write(path: Path, text: str) -> None:
    with whole_file(path, None) as beside:
        beside.write_text(text, encoding="utf-8")
