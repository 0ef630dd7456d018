"""A suite, recording by recording in child processes: what was finished before is kept, what breaks stops nothing."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.core.plugins.unlisted_files import NOT_OF_HASH
from resim.core.provenance import versions
from resim.core.schema import VerificationSchema
from resim.execution.child import Failure
from resim.execution.workers import run_all
from resim.report import SHEET, write_shared_scripts
from resim.results import whole_file
from resim.verification.cases import CASES, Traces, VerificationCase, keep, kept
from resim.verification.entries import FailedRecording
from resim.verification.inputs import VerificationRequest
from resim.verification.report import RecordingResult, VerificationReport
from resim.verification.request import tasks
from resim.verification.summary import summary
from resim.verification.tasks import VerificationTask, drive_page, report, reports_of, run

SCHEMA: VerificationSchema = "resim-verification-1"
REPORTS = "reports"
"""The folder of the re-simulation reports of those to look at."""
DRIVES = "drives"
"""The folder of the pages that play all recordings."""
LONGEST, LONGEST_SEED = 3600.0, 60.0
"""s of wall clock for one recording with all of its variations, and more for each seed that it may take."""

RecordingListener = Callable[[str, str, bool], None]
"""Hears of each recording: its name, its verdict, whether it was kept from before."""


def verify(
    a: VerificationRequest,
    base: Path,
    out: Path | None,
    *,
    workers: int,
    tell: RecordingListener = lambda name, verdict, kept: None,
    damaged: Callable[[Path], None] = lambda path: None,
    unreported: Callable[[str, str], None] = lambda name, reason: None,
) -> tuple[VerificationReport, dict[str, Traces]]:
    """Give what verification.json says, and the traces for the page by recording.

    base: folder that the paths in `a` are from. out: folder of the results, in which each recording's result is kept as
    soon as it is there, and taken from if it was made from the same; None keeps nothing. damaged: hears of the file
    of a result that is not as it was written; it is made again. unreported: hears whose report cannot be made, and why.
    """
    todo = tasks(a, base)
    if out is not None:
        todo = {
            name: replace(task, reports=out / REPORTS, drives=out / DRIVES) for name, task in todo.items()
        }
        _write_scripts(a, out)
    keys = {name: _key(a, name) for name in todo}
    found = {} if out is None else _kept(a, out, todo, keys, damaged)
    for name, case in found.items():
        tell(name, case.entry.verdict, True)
    for case in _run(a, [task for name, task in todo.items() if name not in found], workers):
        name = case.entry.name
        found[name] = case
        if out is not None and case.entry.verdict != "error" and not _is_unpinned(case):
            keep(out, keys[name], case)
        tell(name, case.entry.verdict, False)
    recordings = [found[name].entry for name in todo]
    told = summary(recordings, a.limits if a.against is not None else None)
    chosen = told.worst[: a.reports]
    lost: dict[str, str] = {}
    if out is not None:
        lost = _write_reports(out, [todo[name] for name in chosen], found, keys, workers)
        for name, reason in sorted(lost.items()):
            unreported(name, reason)
    linked = {name: reports_of(name, builds=a.against is not None) for name in chosen if name not in lost}
    entries = tuple(_with_pages(found[r.name], linked.get(r.name, ()), out is None) for r in recordings)
    traces = {name: drawn for name in todo if (drawn := found[name].traces) is not None}
    return VerificationReport(SCHEMA, versions(), a, told, entries), traces


def _kept(
    a: VerificationRequest,
    out: Path,
    todo: Mapping[str, VerificationTask],
    keys: Mapping[str, str],
    damaged: Callable[[Path], None],
) -> dict[str, VerificationCase]:
    """What was found before, without reports of anything else."""
    every = {name: kept(out, task.source, keys[name], damaged) for name, task in todo.items()}
    found = {name: case for name, case in every.items() if case is not None and _has_drive(out, case)}
    _remove_reports(out, [*todo], found, builds=a.against is not None)
    return found


def _is_unpinned(case: VerificationCase) -> bool:
    """Whether the result follows from more than its key knows: the next command may find another."""
    notes = () if isinstance(case.entry, FailedRecording) else case.entry.notes
    return any(note.endswith(NOT_OF_HASH) for note in notes)


def _with_pages(case: VerificationCase, reports: Sequence[str], as_if: bool) -> RecordingResult:
    """What is told of a recording, with the pages that lead on from it; as_if: as if its drive's page were written."""
    told = replace(case.entry, reports=tuple(f"{REPORTS}/{page}" for page in reports))
    if isinstance(told, FailedRecording) or (case.drive is None and not as_if):
        return told
    return replace(told, drive=f"{DRIVES}/{drive_page(told.name)}")


def _has_drive(out: Path, case: VerificationCase) -> bool:
    """Whether the page that plays the drive is as it was written, or there is none."""
    page = out / DRIVES / drive_page(case.entry.name)
    return case.drive is None or (page.is_file() and file_hash(page) == case.drive)


def _write_scripts(a: VerificationRequest, out: Path) -> None:
    """Write the scripts that pages share, into folders that may hold more than one or have those of another resim."""
    many = len(a.recordings)
    pages = {DRIVES: many, REPORTS: min(many, a.reports) * (1 if a.against is None else 2)}
    for name, count in pages.items():
        sheet = out / name / SHEET
        if count > 1 or sheet.is_file():
            with whole_file(sheet, None) as path:
                write_shared_scripts(path, plots=name == REPORTS)


def _run(
    a: VerificationRequest, todo: Sequence[VerificationTask], workers: int
) -> Iterator[VerificationCase]:
    """What each recording gives, as they come."""
    limit = LONGEST + LONGEST_SEED * len(a.seeds)
    for k, result in run_all(run, todo, workers=workers, time_limit=limit):
        yield _failed(result, todo[k]) if isinstance(result, Failure) else result


def _write_reports(
    out: Path,
    chosen: list[VerificationTask],
    found: dict[str, VerificationCase],
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
            found[name] = replace(found[name], reports=result)
            keep(out, keys[name], found[name])
    return lost


def _reports(out: Path, case: VerificationCase) -> list[str]:
    """The names of the reports that were written of this result, if they are there as they were written."""
    try:
        hashes = {name: file_hash(out / REPORTS / name) for name in case.reports}
    except InputError:
        return []
    return [*hashes] if hashes == case.reports else []


def _remove_reports(out: Path, names: list[str], kept: dict[str, VerificationCase], *, builds: bool) -> None:
    """Take away the reports of these recordings but those of the results that are kept: they are of something else."""
    of_these = {name for case in kept.values() for name in _reports(out, case)}
    for page in {page for name in names for page in reports_of(name, builds=builds)} - of_these:
        (out / REPORTS / page).unlink(missing_ok=True)


def files_of(a: VerificationRequest) -> list[str]:
    """Give the names of the files that a verification may write into its folders, as seen from its results."""
    pages = [page for name in a.recordings for page in reports_of(name, builds=a.against is not None)]
    files = [f"{CASES}/{name}.json" for name in a.recordings]
    files += [f"{folder}/{SHEET}" for folder in (REPORTS, DRIVES)]
    files += [f"{DRIVES}/{drive_page(name)}" for name in a.recordings]
    return files + [f"{REPORTS}/{page}" for page in pages]


def _failed(failure: Failure, task: VerificationTask) -> VerificationCase:
    """A recording without a result; it is told without where on this machine it lies."""
    reason = failure.reason.replace(str(task.folder), task.source.folder)
    entry = FailedRecording(
        **vars(task.source), verdict="error", error=reason, crashed=failure.crashed or failure.of_function
    )
    return VerificationCase(entry, None, None)


def _key(a: VerificationRequest, name: str) -> str:
    """What the result of a recording follows from."""
    told = a.model_dump(mode="json", exclude={"recordings", "wanted", "suite", "name", "limits", "reports"})
    told |= {"recording": a.recordings[name].model_dump(), "wanted": a.wanted.get(name)}
    told |= {"versions": versions()}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def outcome_code(verification: VerificationReport) -> int:
    """Give the exit code: 2 where a recording is broken, 3 where a function failed, 1 for a bad verdict, else 0."""
    errors = [r for r in verification.recordings if r.verdict == "error"]
    if errors:
        return 2 if any(isinstance(r, FailedRecording) and not r.crashed for r in errors) else 3
    return 0 if verification.summary.good else 1
