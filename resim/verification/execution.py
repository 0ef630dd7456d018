"""A suite, recording by recording in child processes: what was finished before is kept, what breaks stops nothing."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.core.provenance import versions
from resim.core.sealed import read_sealed, sealed
from resim.execution.child import Failure
from resim.execution.workers import run_all
from resim.results import whole_file, write_json
from resim.verification.request import VerificationRequest, tasks
from resim.verification.summary import summary
from resim.verification.tasks import VerificationTask, report, reports_of, run

SCHEMA = "resim-verification-1"
CASES, REPORTS = "cases", "reports"
"""Folders in the results: what each recording gave, and the re-simulation reports of those to look at."""
LONGEST, LONGEST_SEED = 3600.0, 60.0
"""s of wall clock for one recording with all of its variations, and more for each seed that it may take."""

Told = Callable[[str, str, bool], None]
"""Hears of each recording: its name, its verdict, whether it was kept from before."""


def verify(
    a: VerificationRequest,
    base: Path,
    out: Path | None,
    *,
    workers: int,
    tell: Told = lambda name, verdict, kept: None,
    damaged: Callable[[Path], None] = lambda path: None,
    unreported: Callable[[str, str], None] = lambda name, reason: None,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Give what verification.json holds, and the traces for the page by recording.

    base: folder that the paths in `a` are from. out: folder of the results, in which each recording's result is kept as
    soon as it is there, and taken from if it was made from the same; None keeps nothing. damaged: hears of the file
    of a result that is not as it was written; it is made again. unreported: hears whose report cannot be made, and why.
    """
    todo, kept = tasks(a, base, None if out is None else out / REPORTS), {}
    keys = {name: _key(a, name) for name in todo}
    if out is not None:
        kept = {n: case for n in todo if (case := _kept(out, n, keys[n], damaged)) is not None}
        _remove_reports(out, [*todo], kept, builds=a.against is not None)
        for name, case in kept.items():
            tell(name, case["entry"]["verdict"], True)
    missing = [name for name in todo if name not in kept]
    found = dict(kept)
    limit = LONGEST + LONGEST_SEED * len(a.seeds)
    results = run_all(run, [todo[n] for n in missing], workers=workers, time_limit=limit)
    for k, result in results:
        name = missing[k]
        found[name] = _case(result, todo[name], a.recordings[name].path)
        if out is not None and found[name]["entry"]["verdict"] != "error":
            _keep(out, name, keys[name], found[name])
        tell(name, found[name]["entry"]["verdict"], False)
    recordings = [{"name": n, **_source(a, n), **found[n]["entry"]} for n in todo]
    told = summary(recordings, a.limits if a.against is not None else None)
    chosen = told["worst"][: a.reports]
    lost: dict[str, str] = {}
    if out is not None:
        lost = _write_reports(out, [todo[name] for name in chosen], found, keys, workers)
        for name, reason in sorted(lost.items()):
            unreported(name, reason)
    for r in recordings:
        linked = r["name"] in chosen and r["name"] not in lost
        names = reports_of(r["name"], builds=a.against is not None) if linked else []
        r["reports"] = [f"{REPORTS}/{name}" for name in names]
    whole = {"schema": SCHEMA, "versions": versions(), "inputs": a.model_dump(mode="json"), "summary": told}
    return {**whole, "recordings": recordings}, {n: found[n]["traces"] for n in todo}


def _write_reports(
    out: Path,
    chosen: list[VerificationTask],
    found: dict[str, dict[str, Any]],
    keys: dict[str, str],
    workers: int,
) -> dict[str, str]:
    """Write the reports of the chosen recordings that have none of this result; give why any could not be made."""
    todo = [task for task in chosen if not _reports(out, found[task.name])]
    lost = {}
    for k, result in run_all(report, todo, workers=workers, time_limit=LONGEST):
        name = todo[k].name
        if isinstance(result, Failure):
            lost[name] = result.reason
        else:
            found[name] = {**found[name], "reports": result}
            _keep(out, name, keys[name], found[name])
    return lost


def _reports(out: Path, case: dict[str, Any]) -> list[str]:
    """The names of the reports that were written of this result, if they are there as they were written."""
    try:
        hashes = {name: file_hash(out / REPORTS / name) for name in case.get("reports", {})}
    except InputError:
        return []
    return [*hashes] if hashes == case.get("reports") else []


def _remove_reports(out: Path, names: list[str], kept: dict[str, dict[str, Any]], *, builds: bool) -> None:
    """Take away the reports of these recordings but those of the results that are kept: they are of something else."""
    of_these = {name for case in kept.values() for name in _reports(out, case)}
    for page in {page for name in names for page in reports_of(name, builds=builds)} - of_these:
        (out / REPORTS / page).unlink(missing_ok=True)


def files_of(a: VerificationRequest) -> list[str]:
    """Give the names of the files that a verification may write into its folders, as seen from its results."""
    pages = [page for name in a.recordings for page in reports_of(name, builds=a.against is not None)]
    return [*(f"{CASES}/{name}.json" for name in a.recordings), *(f"{REPORTS}/{page}" for page in pages)]


def _case(result: dict[str, Any] | Failure, task: VerificationTask, place: str) -> dict[str, Any]:
    """A recording's result; what failed is told without where on this machine it lies."""
    if not isinstance(result, Failure):
        return result
    reason = result.reason.replace(str(task.folder), place)
    entry = {"verdict": "error", "error": reason, "crashed": result.crashed}
    return {"entry": entry, "traces": {}, "time": None}


def _source(a: VerificationRequest, name: str) -> dict[str, Any]:
    file = a.recordings[name]
    return {"folder": file.path, "hash": file.hash}


def _keep(out: Path, name: str, key: str, case: dict[str, Any]) -> None:
    """Write what was found for a recording, and from which inputs."""
    with whole_file(out / CASES / f"{name}.json", (".json",)) as path:
        write_json(sealed({"key": key, **case}), path)


def _kept(out: Path, name: str, key: str, damaged: Callable[[Path], None]) -> dict[str, Any] | None:
    """What was found for a recording before, from the same inputs."""
    path = out / CASES / f"{name}.json"
    if not path.exists():
        return None
    try:
        case = read_sealed(path, "")
        if not isinstance(case["entry"]["verdict"], str) or not isinstance(case["traces"], dict):
            raise TypeError
        return case if case.pop("key") == key else None
    except (InputError, KeyError, TypeError):
        damaged(path)
        return None


def _key(a: VerificationRequest, name: str) -> str:
    """What the result of a recording follows from."""
    told = a.model_dump(mode="json", exclude={"recordings", "wanted", "suite", "name", "limits", "reports"})
    told |= {"recording": a.recordings[name].model_dump(), "wanted": a.wanted.get(name)}
    told |= {"versions": versions()}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def outcome_code(verification: Mapping[str, Any]) -> int:
    """Give the exit code: 2 where a recording is broken or a function crashed, 1 where a verdict is bad, else 0."""
    told = verification["summary"]
    return 2 if told["error"] else 0 if told["good"] else 1
