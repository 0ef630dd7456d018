"""Cross-verify a build, or compare two: what `resim verify` does."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pandas as pd

from resim.execution.workers import in_child
from resim.jobs.given import path_of
from resim.report.markup import Markup
from resim.report.notebook import notebook_html
from resim.results import VERIFICATION, check_output, locked
from resim.verification.entries import VerifiedRecording
from resim.verification.execution import outcome_code
from resim.verification.execution import verify as execute
from resim.verification.folder import begin, read, text, write
from resim.verification.inputs import VerificationRequest
from resim.verification.report import Summary, VerificationReport
from resim.verification.request import VerifyOptions, make_request, refuse_changes, refuse_others
from resim.verification.suite import read_suite


@dataclass(frozen=True)
class VerificationListener:
    """Hears of a verification while it runs.

    Attributes:
        begun: Of how many recordings it is.
        done: Of each recording: its name, its verdict, whether its result was there before.
        damaged: Of the file of a result that is not as it was written; its recording is run again.
        unreported: Whose report cannot be made, and why.
    """

    begun: Callable[[int], None] = lambda recordings: None
    done: Callable[[str, str, bool], None] = lambda name, verdict, kept: None
    damaged: Callable[[Path], None] = lambda path: None
    unreported: Callable[[str, str], None] = lambda name, reason: None


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """A verified suite, or two builds compared on it. Shows itself in a notebook.

    Attributes:
        report: What verification.json says.
        folder: Folder of the results.
    """

    report: VerificationReport
    folder: Path

    @property
    def summary(self) -> Summary:
        """Counts of recordings by verdict, and of causes."""
        return self.report.summary

    @property
    def good(self) -> bool:
        """Whether every recording is verified, or no limit of two builds is exceeded, and nothing failed."""
        return self.code == 0

    @property
    def code(self) -> int:
        """The exit code: 0 good, 1 a verdict is bad, 2 a recording is broken, 3 the function failed."""
        return outcome_code(self.report)

    @cached_property
    def recordings(self) -> pd.DataFrame:
        """A row a recording: name, verdict, cause, error."""
        return pd.DataFrame(
            {
                "name": r.name, "verdict": r.verdict,
                "cause": r.cause.step if isinstance(r, VerifiedRecording) and r.cause else "", "error": r.error or "",
            } for r in self.report.recordings
        )  # fmt: skip

    def __repr__(self) -> str:
        inputs, counts = self.report.inputs, self.recordings["verdict"].value_counts()
        what = inputs.build.label + (f" against {inputs.against.label}" if inputs.against else "")
        told = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
        return f"<Verification {inputs.name}, {what}: {told}>"

    def _repr_html_(self) -> str:
        return notebook_html(repr(self).strip("<>"), Markup(), {"recordings": self.recordings})


def verify(
    suite: str | Path,
    build: str | Path,
    out: str | Path,
    options: VerifyOptions = VerifyOptions(),
    *,
    workers: int | None = None,
    listener: VerificationListener = VerificationListener(),
) -> Verification:
    """Cross-verify a build on a suite: does simulation give the measured drives' verdicts?

    Args:
        suite: Suite file: recordings, criteria, tolerances.
        build: Build file of the AD function that drove.
        out: Folder for the results; an interrupted verification there is resumed.
        options: What is asked for besides.
        workers: Processes; all cores, if None.
        listener: Hears of it while it runs.

    Returns:
        Verdicts by recording, with causes.

    Raises:
        InputError: A file cannot be used, or recordings were driven by another function.
    """
    return _run((path_of(suite), path_of(build), None, options, path_of(out)), workers, listener)


def compare(
    suite: str | Path,
    build: str | Path,
    against: str | Path,
    out: str | Path,
    options: VerifyOptions = VerifyOptions(),
    *,
    workers: int | None = None,
    listener: VerificationListener = VerificationListener(),
) -> Verification:
    """Compare a build with an older one, in the same scenarios with the same seeds.

    Args:
        suite: Suite file: recordings, criteria, limits.
        build: Build file of the newer function.
        against: Build file of the older one.
        out: Folder for the results; an interrupted comparison there is resumed.
        options: What is asked for besides.
        workers: Processes; all cores, if None.
        listener: Hears of it while it runs.

    Returns:
        What the builds differ in, by recording.

    Raises:
        InputError: A file cannot be used.
    """
    return _run((path_of(suite), path_of(build), path_of(against), options, path_of(out)), workers, listener)


_RequestInputs = tuple[Path, Path, Path | None, VerifyOptions, Path]


def _request(asked: _RequestInputs) -> VerificationRequest:
    """Read what is asked for; in a child process, as builds and criteria bring code."""
    suite, build, against, options, out = asked
    wanted = make_request(read_suite(suite), build, against, options, out)
    refuse_others(wanted, out)
    return wanted


def _run(asked: _RequestInputs, workers: int | None, listener: VerificationListener) -> Verification:
    out = asked[-1]
    check_output(out, VERIFICATION, [one for one in asked[:3] if one is not None])
    wanted = in_child(_request, asked)
    with locked(out, "resim verify"):
        begin(out, wanted)
        listener.begun(len(wanted.recordings))
        found, traces = execute(
            wanted,
            out,
            out,
            workers=workers or os.cpu_count() or 1,
            tell=listener.done,
            damaged=listener.damaged,
            unreported=listener.unreported,
        )
        write(out, found, traces)
    return Verification(found, out)


@dataclass(frozen=True, eq=False)
class Replay:
    """A verification that was repeated.

    Attributes:
        verification: What was found now.
        same: Whether it gives the same bytes.
        differ: Names of recordings that differ.
        versions: What was of another version then, in words.
    """

    verification: Verification
    same: bool
    differ: tuple[str, ...]
    versions: tuple[str, ...]


def replay(
    file: str | Path, *, workers: int | None = None, listener: VerificationListener = VerificationListener()
) -> Replay:
    """Repeat a verification, and say whether it gives the same bytes.

    Args:
        file: The verification.json that `verify` wrote.
        workers: Processes; all cores, if None.
        listener: Hears of it while it runs.

    Returns:
        What was found now, and what differs.

    Raises:
        InputError: The file is none, or an input has changed since.
    """
    path = path_of(file)
    before = read(path)
    wanted = before.inputs
    in_child(_refuse_changes, (wanted, path))
    listener.begun(len(wanted.recordings))
    found, _ = execute(wanted, path.parent, None, workers=workers or os.cpu_count() or 1, tell=listener.done)
    was = {r.name: r for r in before.recordings}
    return Replay(
        Verification(found, path.parent),
        text(found) == path.read_text(encoding="utf-8"),
        tuple(r.name for r in found.recordings if r != was.get(r.name)),
        tuple(
            f"{name} {version}, now {found.versions.get(name)}"
            for name, version in before.versions.items()
            if found.versions.get(name) != version
        ),
    )


def _refuse_changes(task: tuple[VerificationRequest, Path]) -> None:
    refuse_changes(*task)
