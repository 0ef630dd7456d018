"""The page: numbers, kinds, scenarios, and every maneuver over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from resim.core.errors import InputError
from resim.core.files import shipped
from resim.mining.catalog import count_kinds, read_kinds
from resim.mining.page import figures
from resim.mining.page.counts import buckets, statistics
from resim.mining.page.graphs import graphs
from resim.recordings import read_recording
from resim.recordings.tables import read_parquet
from resim.report.document import document
from resim.report.markup import Markup, html, join
from resim.report.tables import table

if TYPE_CHECKING:
    from resim.mining.report import MiningReport

SHOWN = 60
"""Scenarios that are shown from above, the longest first."""
OVER_TIME = 12
"""Recordings whose maneuvers are shown over time."""
KINDS = Path("scenarios") / "catalog" / "kinds.toml"


def write_mined_page(
    report: MiningReport, maneuvers: pd.DataFrame, scenarios: pd.DataFrame, folder: Path
) -> None:
    """Write mined.html into the study's folder."""
    parts = [
        _header(report, maneuvers, scenarios), _section("Statistics", _numbers(maneuvers)),
        _section("Scenarios", _scenarios(report, scenarios, folder)),
        _section("Kinds of scenarios", _kinds(maneuvers)),
        _section("Over time", _over_time(report, maneuvers, folder)), _section("Recordings", _recordings(report)),
    ]  # fmt: skip
    body = html("<main>\n{}</main>", join(parts, "\n"))
    page = folder / ".mined.html"
    page.write_text(document("Mined scenarios", body), encoding="utf-8", newline="\n")
    page.replace(folder / "mined.html")


def _section(title: str, body: Markup) -> Markup:
    return html("<section><h2>{}</h2>\n{}</section>", title, body)


def _header(report: MiningReport, maneuvers: pd.DataFrame, scenarios: pd.DataFrame) -> Markup:
    hours, way = sum(p.hours for p in report.parts), sum(p.kilometres for p in report.parts)
    facts = (
        ("recordings", f"{len(report.parts)} mined, {len(report.failures)} not"),
        ("driven", f"{hours:.2f} vehicle hours, {way:.1f} vehicle km on lanes"),
        ("maneuvers", str(len(maneuvers))),
        ("scenarios", f"{len(scenarios)}, cut out for {', '.join(report.trigger)}"),
    )
    listed = join(html("<div><dt>{}</dt><dd>{}</dd></div>", name, value) for name, value in facts)
    return html(
        '<header><p class="kind">Mining</p><h1>Found scenarios</h1><dl class="facts">{}</dl></header>', listed
    )


def _numbers(maneuvers: pd.DataFrame) -> Markup:
    told = table(["statistics", "number"], [[name, str(n)] for name, n in statistics(maneuvers)])
    counts = maneuvers["label"].value_counts()
    rows = [[str(label), str(n)] for label, n in counts.items()]
    return html("{}<p>Every label:</p>{}", told, table(["label", "number"], rows))


def _scenarios(report: MiningReport, scenarios: pd.DataFrame, folder: Path) -> Markup:
    if not len(scenarios):
        return html("<p>No scenario was found.</p>")
    heads, rows = buckets(scenarios, {part.recording: part.map or "some map" for part in report.parts})
    mean = float(scenarios["duration"].mean())
    return html(
        "<p>On average {} s and {} vehicles.</p>{}{}<p>By road, direction, lanes, and vehicles with the EGO:</p>{}{}",
        f"{mean:.2f}", f"{float(scenarios['vehicles'].mean()):.2f}", figures.durations(scenarios),
        figures.tags(scenarios), table(heads, rows), _top_views(scenarios, folder),
    )  # fmt: skip


def _top_views(scenarios: pd.DataFrame, folder: Path) -> Markup:
    written = scenarios[scenarios["folder"] != ""]
    shown = written.sort_values(["duration", "scenario"], ascending=[False, True], kind="stable").head(SHOWN)
    views = []
    for name, where, labels, ego in zip(
        shown["scenario"], shown["folder"], shown["labels"], shown["ego"], strict=True
    ):
        try:
            tracks = read_recording(folder / str(where)).gt
        except InputError:
            continue  # it was taken away since
        picture = figures.top_view(tracks, str(ego))
        views.append(
            html("<figure>{}<figcaption><b>{}</b> {}</figcaption></figure>", picture, str(name), str(labels))
        )
    told = html(
        "<p>{} of {} written scenarios from above, along the EGO's way:</p>", len(views), len(written)
    )
    return html("{}{}", told, join(views))


def _kinds(maneuvers: pd.DataFrame) -> Markup:
    file = shipped() / KINDS
    if not file.is_file():
        return html("<p>The catalog of kinds is not installed.</p>")
    found, never, hidden = [], [], []
    for one in count_kinds(read_kinds(file), maneuvers):
        row = [one.kind.name, one.kind.catalog, one.kind.never or one.kind.reading]
        if one.found is None:
            hidden.append(row)
        elif one.found == 0:
            never.append(row)
        else:
            found.append([*row[:2], str(one.found), row[2]])
    told = table(["kind", "catalog", "found", "reading"], found) if found else html("<p>None was found.</p>")
    return html(
        "{}<details><summary>{} kinds were never found</summary>{}</details>"
        "<details><summary>{} kinds cannot be found in object lists</summary>{}</details>",
        told, len(never), table(["kind", "catalog", "reading"], never), len(hidden),
        table(["kind", "catalog", "why not"], hidden),
    )  # fmt: skip


def _over_time(report: MiningReport, maneuvers: pd.DataFrame, folder: Path) -> Markup:
    drawn = []
    for number, part in enumerate(report.parts[:OVER_TIME]):
        own = maneuvers[(maneuvers["recording"] == part.recording) & (maneuvers["label"] != "follow_lane")]
        ways = read_parquet(folder / "parts" / part.recording / "overview.parquet")
        drawn.append(html("<h3>{}</h3>", part.recording))
        if len(own):
            drawn.append(figures.over_time(part.recording, own, number))
        if len(ways):
            drawn.append(graphs(part.recording, ways, own, number))
    left = len(report.parts) - OVER_TIME
    more = html("<p>{} more recordings are in maneuvers.parquet.</p>", left) if left > 0 else Markup()
    return html("{}{}", join(drawn), more)


def _recordings(report: MiningReport) -> Markup:
    rows = [
        [p.recording, str(p.objects), f"{p.hours:.3f}", f"{p.kilometres:.2f}", str(sum(p.labels.values())),
         str(p.scenarios), f"{100.0 * p.off_lane:.1f} %", "; ".join(p.notes)]
        for p in report.parts
    ]  # fmt: skip
    rows += [[f.recording, "–", "–", "–", "–", "–", "–", f"not mined: {f.why}"] for f in report.failures]
    return table(["recording", "objects", "hours", "km", "labels", "scenarios", "off lanes", "notes"], rows)
