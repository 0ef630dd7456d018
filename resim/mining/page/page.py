"""The page of a study: numbers, kinds, the longest scenarios, and a link to the page of each recording."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from resim.core.errors import InputError
from resim.core.files import shipped
from resim.mining.catalog import read_kinds
from resim.mining.page import figures
from resim.mining.page.counts import Counted, buckets, statistics
from resim.mining.page.recording_page import PAGES
from resim.mining.page.views import VIEWS_CSS, LaneBorders, top_view, views_of
from resim.recordings import read_recording
from resim.recordings.tables import read_parquet
from resim.report import SHEET, write_shared_scripts
from resim.report.document import document
from resim.report.markup import Markup, html, join
from resim.report.tables import table
from resim.road.opendrive import load

if TYPE_CHECKING:
    from resim.mining.report import MiningReport

KINDS = Path("scenarios") / "catalog" / "kinds.toml"


def write_mined_page(report: MiningReport, folder: Path) -> None:
    """Write mined.html into the study's folder, and what the pages of its recordings share."""
    file = shipped() / KINDS
    counted = Counted(read_kinds(file) if file.is_file() else ())
    for part in report.parts:
        own = folder / "parts" / part.recording
        tables = (read_parquet(own / f"{name}.parquet") for name in ("maneuvers", "scenarios"))
        counted.add(part.map or "some map", *tables)
    parts = [
        _header(report, counted), _section("Statistics", _numbers(counted)),
        _section("Scenarios", _scenarios(counted, folder)), _section("Kinds of scenarios", _kinds(counted)),
        _section("Recordings", _recordings(report)),
    ]  # fmt: skip
    write_shared_scripts(folder / PAGES / SHEET)
    body = html("<main>\n{}</main>", join(parts, "\n"))
    page = folder / ".mined.html"
    page.write_text(document("Mined scenarios", body, css=VIEWS_CSS), encoding="utf-8", newline="\n")
    page.replace(folder / "mined.html")


def _section(title: str, body: Markup) -> Markup:
    return html("<section><h2>{}</h2>\n{}</section>", title, body)


def _header(report: MiningReport, counted: Counted) -> Markup:
    hours, way = sum(p.hours for p in report.parts), sum(p.kilometres for p in report.parts)
    facts = (
        ("recordings", f"{len(report.parts)} mined, {len(report.failures)} not"),
        ("driven", f"{hours:.2f} vehicle hours, {way:.1f} vehicle km on lanes"),
        ("maneuvers", str(counted.labels.total())),
        ("scenarios", f"{counted.scenarios}, cut out for {', '.join(report.trigger)}"),
    )
    listed = join(html("<div><dt>{}</dt><dd>{}</dd></div>", name, value) for name, value in facts)
    return html(
        '<header><p class="kind">Mining</p><h1>Found scenarios</h1><dl class="facts">{}</dl></header>', listed
    )


def _numbers(counted: Counted) -> Markup:
    told = table(["statistics", "number"], [[name, str(n)] for name, n in statistics(counted)])
    rows = [[label, str(n)] for label, n in sorted(counted.labels.items(), key=lambda one: (-one[1], one[0]))]
    return html("{}<p>Every label:</p>{}", told, table(["label", "number"], rows))


def _scenarios(counted: Counted, folder: Path) -> Markup:
    if not counted.scenarios:
        return html("<p>No scenario was found.</p>")
    heads, rows = buckets(counted)
    return html(
        "<p>On average {} s and {} vehicles.</p>{}{}<p>By road, direction, lanes, and vehicles with the EGO:</p>{}{}",
        f"{counted.mean_duration:.2f}", f"{counted.mean_vehicles:.2f}", figures.durations(counted),
        figures.tags(counted), table(heads, rows), _longest(counted, folder),
    )  # fmt: skip


def _longest(counted: Counted, folder: Path) -> Markup:
    views = [*_top_views(counted, folder)]
    if not views:
        return Markup()
    return html(
        "<p>The longest {} of {} written scenarios from above, along the EGO's way; the others are on the pages of "
        "their recordings:</p>{}", len(views), counted.written, views_of(views),
    )  # fmt: skip


def _top_views(counted: Counted, folder: Path) -> Iterator[Markup]:
    borders: dict[Path, LaneBorders] = {}
    for one in counted.longest:
        try:
            recording = read_recording(folder / one.folder)
            road = recording.map.resolve()
            if road not in borders:
                borders[road] = LaneBorders(load(road))
        except InputError:
            continue  # it was taken away since
        picture = top_view(one.name, recording.gt, one.ego, borders[road])
        yield html("<figure>{}<figcaption><b>{}</b> {}</figcaption></figure>", picture, one.name, one.labels)


def _kinds(counted: Counted) -> Markup:
    if not counted.kinds:
        return html("<p>The catalog of kinds is not installed.</p>")
    found, never, hidden = [], [], []
    for k, kind in enumerate(counted.kinds):
        row = [kind.name, kind.catalog, kind.never or kind.reading]
        if kind.find is None:
            hidden.append(row)
        elif not counted.found[k]:
            never.append(row)
        else:
            found.append([*row[:2], str(counted.found[k]), row[2]])
    told = table(["kind", "catalog", "found", "reading"], found) if found else html("<p>None was found.</p>")
    return html(
        "{}<details><summary>{} kinds were never found</summary>{}</details>"
        "<details><summary>{} kinds cannot be found in object lists</summary>{}</details>",
        told, len(never), table(["kind", "catalog", "reading"], never), len(hidden),
        table(["kind", "catalog", "why not"], hidden),
    )  # fmt: skip


def _recordings(report: MiningReport) -> Markup:
    rows = [
        [_link(p.recording), str(p.objects), f"{p.hours:.3f}", f"{p.kilometres:.2f}", str(sum(p.labels.values())),
         str(p.scenarios), f"{100.0 * p.off_lane:.1f} %", "; ".join(p.notes)]
        for p in report.parts
    ]  # fmt: skip
    rows += [[f.recording, "–", "–", "–", "–", "–", "–", f"not mined: {f.why}"] for f in report.failures]
    return table(["recording", "objects", "hours", "km", "labels", "scenarios", "off lanes", "notes"], rows)


def _link(recording: str) -> Markup:
    return html('<a href="{}/{}.html">{}</a>', PAGES, quote(recording), recording)
