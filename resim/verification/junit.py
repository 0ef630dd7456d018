"""A verification as JUnit XML, which CI systems show natively (schema: junit-10.xsd of Jenkins' xUnit plug-in)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from lxml import etree

from resim.verification.entries import (
    ComparedRecording,
    FailedRecording,
    SeedRun,
    VerifiedRecording,
    runs_of,
)
from resim.verification.inputs import HashedFile, NamedBuild
from resim.verification.paired import RunPair
from resim.verification.report import ComparisonSummary, RecordingResult, VerificationReport

NO_XML = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML document may have, however they are written, and controls it should not (XML 1.0, 2.2)."""
PAGE = "verification.html"


@dataclass(frozen=True)
class _Case:
    """A test case: a failure or an error with a message of one line and a text of many, or neither."""

    name: str
    outcome: Literal["failure", "error"] | None = None
    kind: str = ""
    message: str = ""
    text: str = ""


def junit(found: VerificationReport) -> str:
    """Give a test case a recording: a failure where the verdict is bad, an error where something broke.

    Measured against simulated, all but "verified" are failures. Build against build, a recording that is worse is one
    only where a suite limit is exceeded, as what a suite allows is no failure; there each limit is a test case,
    too, so that a broken one that no single recording breaks fails as well.
    """
    name, label = found.inputs.name, found.inputs.build.label
    cases = [_case(r, found) for r in found.recordings] + list(_limits(found))
    counts = {"tests": str(len(cases))}
    counts |= {f"{o}s": str(sum(c.outcome == o for c in cases)) for o in ("failure", "error")}
    root = etree.Element("testsuites", {"name": _clean(name), **counts})
    suite = etree.SubElement(root, "testsuite", {"name": _clean(name), **counts, "skipped": "0"})
    properties = etree.SubElement(suite, "properties")
    for told, value in _properties(found):
        etree.SubElement(properties, "property", {"name": _clean(told), "value": _clean(value)})
    for case in cases:
        _add(suite, case, f"{name}.{label}")
    text: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    return text.decode("utf-8")


def _add(suite: etree._Element, case: _Case, classname: str) -> None:
    about = {"classname": _clean(classname), "name": _clean(case.name), "time": "0"}
    element = etree.SubElement(suite, "testcase", about)
    if case.outcome is not None:
        said = {"type": case.kind, "message": _clean(case.message)}
        etree.SubElement(element, case.outcome, said).text = _clean(case.text)


def _case(r: RecordingResult, found: VerificationReport) -> _Case:
    if isinstance(r, FailedRecording):
        return _Case(r.name, "error", "crashed" if r.crashed else "broken recording", r.error, _text(r))
    if r.verdict == "error":
        return _Case(r.name, "error", "crashed", str(r.error), _text(r))
    bad: tuple[str, ...] = ("not verified", "undecided", "invalid")
    if isinstance(r, ComparedRecording):
        bad = () if found.summary.good else ("worse",)
    return _Case(r.name, "failure", r.verdict, why(r), _text(r)) if r.verdict in bad else _Case(r.name)


def _limits(found: VerificationReport) -> Iterator[_Case]:
    """The limits that the suite sets, where two builds are compared."""
    summary = found.summary
    for name, limit in summary.limits.items() if isinstance(summary, ComparisonSummary) else ():
        if limit.limit is None:
            continue
        case = f"limit: {name}"
        text = "" if limit.kept else f"{name}: {limit.value:.4g}, at most {limit.limit:g}"
        worst = f"; worst: {', '.join(summary.worst)}" if summary.worst else ""
        yield _Case(case) if limit.kept else _Case(case, "failure", "limit", text, f"{text}{worst}\n{PAGE}")


def why(r: VerifiedRecording | ComparedRecording) -> str:
    """Say in a line why a recording is not good: from which second, and the step or what differs."""
    if isinstance(r, ComparedRecording):
        return f"{r.verdict}{_since(r.t)}: {'; '.join(r.differences)}"
    if r.cause is None:
        return r.verdict
    return f"{r.verdict}{_since(r.cause.t)}: {r.cause.step}: {r.cause.text}"


def _since(t: float | None) -> str:
    return "" if t is None else f", from {t:.1f} s"


def differences(r: RecordingResult) -> list[str]:
    """Give all that differs, a line each; over seeds once, with the first of them that shows it."""
    if isinstance(r, FailedRecording):
        return []
    runs = r.pairs if isinstance(r, ComparedRecording) else runs_of(r.judged)
    first: dict[str, int | None] = {}
    for run in runs:
        seed = None if not isinstance(run, RunPair | SeedRun) else run.seed
        for text in run.differences:
            first.setdefault(text, seed)
    return [text if seed is None else f"{text} (seed {seed})" for text, seed in first.items()]


def _text(r: RecordingResult) -> str:
    """All that differs, and where to look further."""
    failures = [] if r.error is None else [r.error]
    look = [f"recording: {r.folder}", f"page: {PAGE}#r-{r.name}", *(f"report: {p}" for p in r.reports)]
    return "\n".join([*failures, *differences(r), *look])


def _properties(found: VerificationReport) -> Iterator[tuple[str, str]]:
    """What the verification follows from: builds, hashes of all inputs, seeds, versions."""
    asked = found.inputs
    files: dict[str, HashedFile | None] = {
        "suite": asked.suite, "build": asked.build, "against": asked.against, "criteria": asked.criteria,
        "perception": asked.perception,
    }  # fmt: skip
    for name, file in files.items():
        if file is not None:
            yield name, file.label if isinstance(file, NamedBuild) else file.path
            yield f"{name}.sha256", str(file.hash)
    if asked.seeds:
        yield "seeds", " ".join(map(str, asked.seeds))
    for name, file in asked.recordings.items():
        if file.hash is not None:
            yield f"recording.{name}.sha256", file.hash
    yield from ((f"version.{name}", version) for name, version in found.versions.items())


def _clean(text: str) -> str:
    """Put a replacement character where XML does not allow one."""
    return NO_XML.sub("\ufffd", text)
