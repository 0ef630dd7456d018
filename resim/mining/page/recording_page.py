"""The page of one recording: every maneuver over time, ways, speeds and lanes, and each scenario from above."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from resim.mining.page import figures
from resim.mining.page.graphs import graphs
from resim.mining.page.views import VIEWS_CSS, LaneBorders, top_view, views_of
from resim.report.document import document
from resim.report.markup import Markup, html, join

if TYPE_CHECKING:
    from resim.mining.study import MinedRecording

PAGES = "pages"
"""The folder of these pages, seen from the study's."""


def write_recording_page(
    mined: MinedRecording, name: str, frames: tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame], out: Path
) -> None:
    """Write the page of a recording into the study's folder.

    frames: its maneuvers, scenarios and overview, as they are written.
    """
    maneuvers, scenarios, overview = frames
    follows = maneuvers["label"].to_numpy() == "follow_lane"  # last: of too many, these are left out first
    own = maneuvers.iloc[np.argsort(follows, kind="stable")]
    parts: list[Markup] = [html("<h2>Over time</h2>")]
    if len(own):
        parts.append(figures.over_time(name, own))
    if len(own) > figures.MOST_MARKS:
        text = "<p>The first {} of {} maneuvers; all are in parts/{}/maneuvers.parquet.</p>"
        parts.append(html(text, figures.MOST_MARKS, len(own), name))
    if len(overview):
        parts.append(graphs(name, overview, own))
    parts.append(html("<h2>Scenarios from above, along the EGO's way</h2>"))
    parts.append(views_of(_views(mined, scenarios)) if len(scenarios) else html("<p>None was found.</p>"))
    head = html(
        '<header><p class="kind">Mining</p><h1>{}</h1><p>{} maneuvers, {} scenarios. '
        '<a href="../mined.html">All recordings</a></p></header>',
        name, len(maneuvers), len(scenarios),
    )  # fmt: skip
    body = html("<main>\n{}\n{}</main>", head, join(parts, "\n"))
    file = out / PAGES / f"{name}.html"
    file.parent.mkdir(parents=True, exist_ok=True)
    beside = file.with_name(f".{file.name}")
    beside.write_text(
        document(f"Mined: {name}", body, css=VIEWS_CSS, shared=True), encoding="utf-8", newline="\n"
    )
    beside.replace(file)


def _views(mined: MinedRecording, scenarios: pd.DataFrame) -> Iterator[Markup]:
    gt, borders = mined.recording.gt, LaneBorders(mined.network)
    columns = (scenarios[name].tolist() for name in ("scenario", "start", "end", "labels", "ego"))
    for one, scenario, start, end, labels, ego in zip(mined.scenarios, *columns, strict=True):
        shown = gt.ids[np.unique([one.ego, *one.members])].tolist()
        cut = gt.select(shown).window(float(gt.t[one.ego_start]), float(gt.t[one.ego_end]))
        picture = top_view(scenario, cut, ego, borders)
        yield html(
            "<figure>{}<figcaption><b>{}</b> {} to {} s: {}</figcaption></figure>",
            picture, scenario, f"{start:.2f}", f"{end:.2f}", labels,
        )  # fmt: skip
