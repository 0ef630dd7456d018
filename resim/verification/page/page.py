"""The page of a verification: its head, and the parts of either kind, as one HTML file without plotly."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from resim.report.document import document, text
from resim.report.markup import Markup, html, join
from resim.verification.page import builds, measured
from resim.verification.page.cells import Entry, link, row, rows_table


def write_verification_page(found: Entry, traces: Mapping[str, Any], path: Path) -> None:
    """Write the page: one HTML file that opens from disk; the same verification gives the same bytes.

    found: what verification.json holds; traces: the EGO's speeds by recording (`resim.verification.tasks`).
    """
    path.write_text(page(found, traces), encoding="utf-8", newline="\n")


def page(found: Entry, traces: Mapping[str, Any]) -> Markup:
    """Give the page's HTML."""
    inputs = found["inputs"]
    against = inputs["against"]
    kind = measured.measured(found, traces) if against is None else builds.builds(found, traces)
    title = f"{inputs['name']} · {inputs['build']['label']}"
    title += "" if against is None else f" against {against['label']}"
    css, script = (text("resim.verification.page", name) for name in ("verification.css", "filter.js"))
    body = join([_header(found), _errors(found), *kind])
    return document(title, html("<main>\n{}</main>", body), css=css, scripts=[script], plots=False)


def _header(found: Entry) -> Markup:
    inputs, told = found["inputs"], found["summary"]
    facts = join(html("<div><dt>{}</dt><dd>{}</dd></div>", name, value) for name, value in _facts(inputs))
    kind = measured if inputs["against"] is None else builds
    of = "Cross-verification" if inputs["against"] is None else "Build against build"
    return html(
        '<header><p class="kind">{of}</p><h1>{name}</h1><dl class="facts">{facts}</dl>\n'
        '<p class="line">{line}</p><p>{meaning}</p>{inputs}</header>\n',
        of=of,
        name=inputs["name"],
        facts=facts,
        line=_line(found["recordings"], told, inputs),
        meaning=kind.meaning(inputs),
        inputs=_inputs(found),
    )


def _facts(inputs: Entry) -> Iterator[tuple[str, str]]:
    yield "build", html("<b>{}</b>", inputs["build"]["label"])
    if inputs["against"] is not None:
        yield "against", html("<b>{}</b>", inputs["against"]["label"])
    yield "criteria", Path(inputs["criteria"]["path"]).name
    if inputs["perception"] is not None:
        settings = "".join(f", {s}" for s in inputs["settings"])
        yield "perception model", Path(inputs["perception"]["path"]).name + settings
        many = "at most " if inputs["against"] is None else ""
        yield "seeds", many + _seeds(inputs["seeds"])
    if inputs["against"] is None:
        yield "re-simulated", " and ".join(inputs["bases"])


def _seeds(seeds: list[int]) -> str:
    return f"{len(seeds)} ({seeds[0]} to {seeds[-1]})" if len(seeds) > 1 else str(seeds[0])


def _line(recordings: list[Entry], told: Entry, inputs: Entry) -> Markup:
    """The outcome in a sentence."""
    of, errors = len(recordings), told["error"]
    broken = f", {errors} could not be judged because of an error" if errors else ""
    if inputs["against"] is None:
        return html("<b>{} of {}</b> recordings verified{}.", told["verified"], of, broken)
    kept = (
        "The limits of the suite are kept"
        if told["good"]
        else Markup("<b>The limits of the suite are broken</b>")
    )
    return html(
        "{}: {} of {} recordings are worse, {} better{}.", kept, told["worse"], of, told["better"], broken
    )


def _errors(found: Entry) -> Markup:
    """What broke, apart from verdicts that are not good."""
    broken = [r for r in found["recordings"] if r["verdict"] == "error"]
    if not broken:
        return Markup()
    items = join(html("<li>{}: {}</li>", link(r["name"]), r["error"]) for r in broken)
    return html(
        '<div class="warnings errors"><b>Errors</b>: a broken recording or a function that crashed; they say nothing '
        "of the build's verdict<ul>{}</ul></div>\n",
        items,
    )


def _inputs(found: Entry) -> Markup:
    """Everything that the verification follows from, folded."""
    inputs = found["inputs"]
    files_used = {name: inputs[name] for name in ("suite", "build", "against", "criteria", "perception")}
    rows = [
        row([name, file["path"], _hash(file["hash"])])
        for name, file in files_used.items()
        if file is not None
    ]
    rows += [
        row([f"recording {name}", file["path"], _hash(file["hash"])])
        for name, file in inputs["recordings"].items()
    ]
    versions = ", ".join(f"{name} {v}" for name, v in found["versions"].items())
    return html(
        "<details><summary>Inputs, hashes and versions</summary><p>To repeat it: <code>resim verify --replay "
        "verification.json</code>. Made with {}.</p>{}</details>",
        versions,
        rows_table(["", "path from this file", "SHA-256"], rows, "inputs"),
    )


def _hash(found: str | None) -> Markup:
    return Markup("<i>could not be read</i>") if found is None else html("<code>{}</code>", found)
