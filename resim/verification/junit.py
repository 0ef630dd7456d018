"""A verification as JUnit XML, which CI systems show natively (schema: junit-10.xsd of Jenkins' xUnit plug-in)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from lxml import etree

Entry = Mapping[str, Any]
"""What verification.json holds of a recording."""

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


def junit(found: Mapping[str, Any]) -> str:
    """Give a test case a recording: a failure where the verdict is bad, an error where something broke.

    Measured against simulated, all but "verified" are failures. Build against build, a recording that is worse is one
    only where a limit of the suite is broken, as what a suite allows is no failure; there each limit is a test case,
    too, so that a broken one that no single recording breaks fails as well.
    """
    inputs = found["inputs"]
    cases = [_case(r, found) for r in found["recordings"]] + list(_limits(found))
    counts = {"tests": str(len(cases))}
    counts |= {f"{o}s": str(sum(c.outcome == o for c in cases)) for o in ("failure", "error")}
    root = etree.Element("testsuites", {"name": _clean(inputs["name"]), **counts})
    suite = etree.SubElement(root, "testsuite", {"name": _clean(inputs["name"]), **counts, "skipped": "0"})
    properties = etree.SubElement(suite, "properties")
    for name, value in _properties(found):
        etree.SubElement(properties, "property", {"name": _clean(name), "value": _clean(value)})
    classname = f"{inputs['name']}.{inputs['build']['label']}"
    for case in cases:
        _add(suite, case, classname)
    text: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    return text.decode("utf-8")


def _add(suite: etree._Element, case: _Case, classname: str) -> None:
    about = {"classname": _clean(classname), "name": _clean(case.name), "time": "0"}
    element = etree.SubElement(suite, "testcase", about)
    if case.outcome is not None:
        said = {"type": case.kind, "message": _clean(case.message)}
        etree.SubElement(element, case.outcome, said).text = _clean(case.text)


def _case(r: Entry, found: Mapping[str, Any]) -> _Case:
    name, verdict = r["name"], r["verdict"]
    if verdict == "error":
        kind = "crashed" if r.get("crashed", True) else "broken recording"
        return _Case(name, "error", kind, str(r["error"]), _text(r))
    bad = (
        ("not verified", "undecided", "invalid")
        if "way" in r
        else ()
        if found["summary"]["good"]
        else ("worse",)
    )
    return _Case(name, "failure", verdict, why(r), _text(r)) if verdict in bad else _Case(name)


def _limits(found: Mapping[str, Any]) -> Iterator[_Case]:
    """The limits that the suite sets, where two builds are compared."""
    summary = found["summary"]
    for name, limit in summary.get("limits", {}).items():
        if limit["limit"] is None:
            continue
        case = f"limit: {name}"
        text = f"{name}: {limit['value']:.4g}, at most {limit['limit']:g}" if not limit["kept"] else ""
        worst = f"; worst: {', '.join(summary['worst'])}" if summary["worst"] else ""
        yield (
            _Case(case) if limit["kept"] else _Case(case, "failure", "limit", text, f"{text}{worst}\n{PAGE}")
        )


def why(r: Entry) -> str:
    """Say in a line why a recording is not good: from which second, and the step or what differs."""
    t = r["t"] if "pairs" in r else r["cause"]["t"]
    when = "" if t is None else f", from {t:.1f} s"
    if "pairs" in r:
        return f"{r['verdict']}{when}: {'; '.join(r['differences'])}"
    return f"{r['verdict']}{when}: {r['cause']['step']}: {r['cause']['text']}"


def differences(r: Entry) -> list[str]:
    """Give all that differs, a line each; over seeds once, with the first of them that shows it."""
    if "pairs" in r:
        runs = r["pairs"]
    elif "way" in r:
        way = r["ways"][r["way"]]
        runs = way.get("seeds", [way])
    else:
        return []
    return [text if seed is None else f"{text} (seed {seed})" for text, seed in _first(runs).items()]


def _first(runs: Sequence[Entry]) -> dict[str, int | None]:
    """Each difference with the first seed of it."""
    out: dict[str, int | None] = {}
    for run in runs:
        for text in run["differences"]:
            out.setdefault(text, run.get("seed"))
    return out


def _text(r: Entry) -> str:
    """All that differs, and where to look further."""
    failures = [] if r.get("error") is None else [str(r["error"])]
    look = [
        f"recording: {r['folder']}",
        f"page: {PAGE}#r-{r['name']}",
        *(f"report: {p}" for p in r["reports"]),
    ]
    return "\n".join([*failures, *differences(r), *look])


def _properties(found: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """What the verification follows from: builds, hashes of all inputs, seeds, versions."""
    inputs = found["inputs"]
    for name in ("suite", "build", "against", "criteria", "perception"):
        if (file := inputs[name]) is not None:
            yield name, file.get("label", file["path"])
            yield f"{name}.sha256", file["hash"]
    if inputs["seeds"]:
        yield "seeds", " ".join(map(str, inputs["seeds"]))
    for name, file in inputs["recordings"].items():
        if file["hash"] is not None:
            yield f"recording.{name}.sha256", file["hash"]
    yield from ((f"version.{name}", version) for name, version in found["versions"].items())


def _clean(text: str) -> str:
    """Put a replacement character where XML does not allow one."""
    return NO_XML.sub("\ufffd", text)
