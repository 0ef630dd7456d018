"""The folder of a verification: one result a recording as it comes, and the whole at the end."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from resim.core.errors import InputError
from resim.core.files import read_file
from resim.core.provenance import versions
from resim.core.sealed import read_sealed, sealed
from resim.results import VERIFICATION, check_output, json_text, whole_file
from resim.verification.execution import CASES, REPORTS, files_of
from resim.verification.junit import junit
from resim.verification.page import write_verification_page
from resim.verification.request import VerificationRequest

REMEDY = "Give the verification.json that `resim verify` wrote."


def begin(out: Path, a: VerificationRequest) -> None:
    """Make the folder, or go on in it: say in it what is asked for, and take away what is of something else.

    Raises InputError where it holds anything that is no result.
    """
    check_output(out, VERIFICATION)
    files = files_of(a)
    told = json_text(sealed({"versions": versions(), "inputs": a.model_dump(mode="json"), "files": files}))
    mark = out / VERIFICATION.mark
    before = read_file(mark, "Remove it.") if mark.is_file() else b""
    if before != told.encode():
        for name in ("verification.json", "verification.html", "junit.xml"):
            (out / name).unlink(missing_ok=True)
    if before:
        others = {*read_sealed(mark, "Remove it.")["files"]} - {*files}
        for path in (*out.glob(f"{CASES}/*"), *out.glob(f"{REPORTS}/*")):
            if f"{path.parent.name}/{path.name}" in others:
                path.unlink()
    _write(mark, told)
    for path in [*out.glob(".*.new"), *out.glob("*/.*.new")]:  # of one that was killed
        path.unlink()


def write(out: Path, found: Mapping[str, Any], traces: Mapping[str, Any]) -> None:
    """Write verification.json, verification.html and junit.xml, and take away reports that nothing leads to."""
    told = {report for r in found["recordings"] for report in r["reports"]}
    a = VerificationRequest.model_validate(found["inputs"])
    for name in files_of(a):
        if name.startswith(f"{REPORTS}/") and name not in told:
            (out / name).unlink(missing_ok=True)
    with whole_file(out / "verification.html") as path:
        write_verification_page(found, traces, path)
    _write(out / "junit.xml", junit(found))
    _write(out / "verification.json", text(found))


def text(found: Mapping[str, Any]) -> str:
    """Give verification.json."""
    return json_text(sealed(found))


def read(path: Path) -> dict[str, Any]:
    """Read a verification.json. Raises InputError."""
    try:
        found = read_sealed(path, REMEDY)
        names = [str(r["name"]) for r in found["recordings"]]
        if not names or not isinstance(found["versions"], dict) or not isinstance(found["inputs"], dict):
            raise TypeError
        if found["schema"] != "resim-verification-1":
            raise InputError(
                path, f"has the schema {found['schema']!r}, expected resim-verification-1", REMEDY
            )
        return {name: found[name] for name in ("schema", "versions", "inputs", "summary", "recordings")}
    except (ValueError, KeyError, TypeError) as e:
        raise InputError(path, "is not what `resim verify` writes", REMEDY) from e


def _write(path: Path, text: str) -> None:
    with whole_file(path, (path.suffix,)) as beside:
        beside.write_text(text, encoding="utf-8")
