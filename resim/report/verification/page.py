"""The page of a verification: its head, and the parts of either kind, as one HTML file without plotly."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path
from typing import Any

from resim.report.document import document, text
from resim.report.verification import builds, measured
from resim.report.verification.cells import Entry, link, row, rows_table


def write_verification_page(found: Entry, traces: Mapping[str, Any], path: Path) -> None:
    """Write the page: one HTML file that opens from disk; the same verification gives the same bytes.

    found: what verification.json holds; traces: the EGO's speeds by recording (`resim.batch.tasks`).
    """
    path.write_text(page(found, traces), encoding="utf-8", newline="\n")


def page(found: Entry, traces: Mapping[str, Any]) -> str:
    """Give the page's HTML."""
    inputs = found["inputs"]
    against = inputs["against"]
    kind = measured.measured(found, traces) if against is None else builds.builds(found, traces)
    title = f"{inputs['name']} · {inputs['build']['label']}"
    title += "" if against is None else f" against {against['label']}"
    css, script = (text("resim.report.verification", name) for name in ("verification.css", "filter.js"))
    body = "".join([_header(found), _errors(found), *kind])
    return document(title, f"<main>\n{body}</main>", css=css, scripts=[script], plots=False)


def _header(found: Entry) -> str:
    inputs, told = found["inputs"], found["summary"]
    facts = "".join(f"<div><dt>{name}</dt><dd>{value}</dd></div>" for name, value in _facts(inputs))
    kind = measured if inputs["against"] is None else builds
    of = "Cross-verification" if inputs["against"] is None else "Build against build"
    return (
        f'<header><p class="kind">{of}</p><h1>{escape(inputs["name"])}</h1><dl class="facts">{facts}</dl>\n'
        f'<p class="line">{_line(found["recordings"], told, inputs)}</p><p>{kind.meaning(inputs)}</p>'
        f"{_inputs(found)}</header>\n"
    )


def _facts(inputs: Entry) -> Iterator[tuple[str, str]]:
    yield "build", f"<b>{escape(inputs['build']['label'])}</b>"
    if inputs["against"] is not None:
        yield "against", f"<b>{escape(inputs['against']['label'])}</b>"
    yield "criteria", escape(Path(inputs["criteria"]["path"]).name)
    if inputs["perception"] is not None:
        settings = "".join(f", {escape(s)}" for s in inputs["settings"])
        yield "perception model", escape(Path(inputs["perception"]["path"]).name) + settings
        many = "at most " if inputs["against"] is None else ""
        yield "seeds", many + _seeds(inputs["seeds"])
    if inputs["against"] is None:
        yield "re-simulated", " and ".join(inputs["bases"])


def _seeds(seeds: list[int]) -> str:
    return f"{len(seeds)} ({seeds[0]} to {seeds[-1]})" if len(seeds) > 1 else str(seeds[0])


def _line(recordings: list[Entry], told: Entry, inputs: Entry) -> str:
    """The outcome in a sentence."""
    of, errors = len(recordings), told["error"]
    broken = f", {errors} could not be judged because of an error" if errors else ""
    if inputs["against"] is None:
        return f"<b>{told['verified']} of {of}</b> recordings verified{broken}."
    kept = "The limits of the suite are kept" if told["good"] else "<b>The limits of the suite are broken</b>"
    return f"{kept}: {told['worse']} of {of} recordings are worse, {told['better']} better{broken}."


def _errors(found: Entry) -> str:
    """What broke, apart from verdicts that are not good."""
    broken = [r for r in found["recordings"] if r["verdict"] == "error"]
    if not broken:
        return ""
    items = "".join(f"<li>{link(r['name'])}: {escape(str(r['error']))}</li>" for r in broken)
    return (
        '<div class="warnings errors"><b>Errors</b>: a broken recording or a function that crashed; they say nothing '
        f"of the build's verdict<ul>{items}</ul></div>\n"
    )


def _inputs(found: Entry) -> str:
    """Everything that the verification follows from, folded."""
    inputs = found["inputs"]
    files_used = {name: inputs[name] for name in ("suite", "build", "against", "criteria", "perception")}
    rows = [
        row([name, escape(file["path"]), _hash(file["hash"])])
        for name, file in files_used.items()
        if file is not None
    ]
    rows += [
        row([f"recording {escape(name)}", escape(file["path"]), _hash(file["hash"])])
        for name, file in inputs["recordings"].items()
    ]
    versions = ", ".join(f"{escape(name)} {escape(v)}" for name, v in found["versions"].items())
    return (
        "<details><summary>Inputs, hashes and versions</summary><p>To repeat it: <code>resim verify --replay "
        f"verification.json</code>. Made with {versions}.</p>"
        f"{rows_table(['', 'path from this file', 'SHA-256'], rows, 'inputs')}</details>"
    )


def _hash(found: str | None) -> str:
    return "<i>could not be read</i>" if found is None else f"<code>{found}</code>"
