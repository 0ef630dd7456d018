"""A verification as JUnit XML, which CI systems show natively."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lxml import etree

GOOD = ("verified", "same", "changed", "better")
"""Verdicts that are no failure of a recording by itself."""


def junit(found: Mapping[str, Any]) -> str:
    """Give a test case a recording: a failure where the verdict is not good, an error where something broke."""
    inputs, recordings = found["inputs"], found["recordings"]
    errors = sum(r["verdict"] == "error" for r in recordings)
    failures = sum(r["verdict"] not in (*GOOD, "error") for r in recordings)
    counts = {"tests": str(len(recordings)), "failures": str(failures), "errors": str(errors)}
    root = etree.Element("testsuites", counts)
    suite = etree.SubElement(
        root, "testsuite", {"name": inputs["name"], **counts, "skipped": "0", "time": "0"}
    )
    for r in recordings:
        case = etree.SubElement(
            suite,
            "testcase",
            {"classname": f"{inputs['name']}.{inputs['build']['label']}", "name": r["name"], "time": "0"},
        )
        if r["verdict"] == "error":
            etree.SubElement(case, "error", {"type": "error", "message": why(r)})
        elif r["verdict"] not in GOOD:
            failure = etree.SubElement(case, "failure", {"type": r["verdict"], "message": why(r)})
            failure.text = "\n".join(differences(r))
    text: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    return text.decode("utf-8")


def why(entry: Mapping[str, Any]) -> str:
    """Say in a line why a recording is not good."""
    if entry["verdict"] == "error":
        return str(entry["error"])
    if "pairs" in entry:
        return "; ".join(entry["differences"])
    cause = entry["cause"]
    when = "" if cause["t"] is None else f"from {cause['t']:.1f} s: "
    return f"{entry['verdict']}, {when}{cause['step']}: {cause['text']}"


def differences(entry: Mapping[str, Any]) -> list[str]:
    """Give all that differs, a line each."""
    if "pairs" in entry:
        return list(entry["differences"])
    way = entry["ways"][entry["way"]]
    runs = way.get("seeds", [way])
    return list(dict.fromkeys(text for run in runs for text in run["differences"]))
