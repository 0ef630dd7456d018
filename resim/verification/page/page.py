"""The page of a verification: its head, and the parts of either kind, as one HTML file without plotly."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from resim.report.document import document, text
from resim.report.markup import Markup, html, join
from resim.verification.cases import Traces
from resim.verification.inputs import HashedFile, VerificationRequest
from resim.verification.page import builds, measured
from resim.verification.page.cells import link, row, rows_table
from resim.verification.report import ComparisonSummary, VerificationReport


def write_verification_page(found: VerificationReport, traces: Mapping[str, Traces], path: Path) -> None:
    """Write the page: one HTML file that opens from disk; the same verification gives the same bytes.

    traces: the EGO's speeds by recording.
    """
    path.write_text(page(found, traces), encoding="utf-8", newline="\n")


def page(found: VerificationReport, traces: Mapping[str, Traces]) -> Markup:
    """Give the page's HTML."""
    inputs, told, against = found.inputs, found.summary, found.inputs.against
    if isinstance(told, ComparisonSummary):
        kind = builds.builds(found, told, traces)
    else:
        kind = measured.measured(found, told, traces)
    title = f"{inputs.name} · {inputs.build.label}"
    title += "" if against is None else f" against {against.label}"
    css, script = (text("resim.verification.page", name) for name in ("verification.css", "filter.js"))
    body = join([_header(found), _errors(found), *kind])
    return document(title, html("<main>\n{}</main>", body), css=css, scripts=[script], plots=False)


def _header(found: VerificationReport) -> Markup:
    inputs = found.inputs
    facts = join(html("<div><dt>{}</dt><dd>{}</dd></div>", name, value) for name, value in _facts(inputs))
    meaning = measured.meaning if inputs.against is None else builds.meaning
    of = "Cross-verification" if inputs.against is None else "Build against build"
    return html(
        '<header><p class="kind">{of}</p><h1>{name}</h1><dl class="facts">{facts}</dl>\n'
        '<p class="line">{line}</p><p>{meaning}</p>{inputs}</header>\n',
        of=of,
        name=inputs.name,
        facts=facts,
        line=_line(found),
        meaning=meaning(inputs),
        inputs=_inputs(found),
    )


def _facts(inputs: VerificationRequest) -> Iterator[tuple[str, str]]:
    yield "build", html("<b>{}</b>", inputs.build.label)
    if inputs.against is not None:
        yield "against", html("<b>{}</b>", inputs.against.label)
    yield "criteria", Path(inputs.criteria.path).name
    if inputs.perception is not None:
        settings = "".join(f", {s}" for s in inputs.settings)
        yield "perception model", Path(inputs.perception.path).name + settings
        many = "at most " if inputs.against is None else ""
        yield "seeds", many + _seeds(inputs.seeds)
    if inputs.against is None:
        yield "re-simulated", " and ".join(inputs.bases)


def _seeds(seeds: tuple[int, ...]) -> str:
    return f"{len(seeds)} ({seeds[0]} to {seeds[-1]})" if len(seeds) > 1 else str(seeds[0])


def _line(found: VerificationReport) -> Markup:
    """The outcome in a sentence."""
    of, told = len(found.recordings), found.summary
    errors = told.error
    broken = f", {errors} could not be judged because of an error" if errors else ""
    if not isinstance(told, ComparisonSummary):
        return html("<b>{} of {}</b> recordings verified{}.", told.verified, of, broken)
    kept = "Suite limits are met" if told.good else Markup("<b>Suite limits are exceeded</b>")
    return html("{}: {} of {} recordings are worse, {} better{}.", kept, told.worse, of, told.better, broken)


def _errors(found: VerificationReport) -> Markup:
    """What broke, apart from verdicts that are not good."""
    broken = [r for r in found.recordings if r.verdict == "error"]
    if not broken:
        return Markup()
    items = join(html("<li>{}: {}</li>", link(r.name), r.error) for r in broken)
    return html(
        '<div class="warnings errors"><b>Errors</b>: a broken recording or a function that crashed; they say nothing '
        "of the build's verdict<ul>{}</ul></div>\n",
        items,
    )


def _inputs(found: VerificationReport) -> Markup:
    """Everything that the verification follows from, folded."""
    asked = found.inputs
    files: dict[str, HashedFile | None] = {
        "suite": asked.suite, "build": asked.build, "against": asked.against, "criteria": asked.criteria,
        "perception": asked.perception, **{f"recording {name}": file for name, file in asked.recordings.items()},
    }  # fmt: skip
    rows = [row([n, file.path, _hash(file.hash)]) for n, file in files.items() if file is not None]
    versions = ", ".join(f"{name} {v}" for name, v in found.versions.items())
    return html(
        "<details><summary>Inputs, hashes and versions</summary><p>To repeat it: <code>resim verify --replay "
        "verification.json</code>. Made with {}.</p>{}</details>",
        versions,
        rows_table(["", "path from this file", "SHA-256"], rows, "inputs"),
    )


def _hash(found: str | None) -> Markup:
    return Markup("<i>could not be read</i>") if found is None else html("<code>{}</code>", found)
