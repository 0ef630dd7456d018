"""comparison.html: two spaces beside each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from resim.report.figure import Figure
from resim.report.figure import trace as figure_trace
from resim.report.markup import Markup, html
from resim.report.plots import style, to_html
from resim.report.tables import table
from resim.space.comparison import SpaceComparison
from resim.space.page.words import header, interval, percent, section, write_page

LISTED = 60


def write_comparison_page(found: SpaceComparison, folder: Path) -> None:
    """Write comparison.html."""
    both = len(found.kinds) - found.only_one - found.only_other
    facts = (
        ("kinds in both", str(both)),
        (f"only in {found.one}", f"{found.only_one}, {percent(found.only_one_share)} of it"),
        (f"only in {found.other}", f"{found.only_other}, {percent(found.only_other_share)} of it"),
        ("apart (total variation)", interval(found.apart)),
    )  # fmt: skip
    parts = [
        header("Two spaces", f"{found.one} and {found.other}", facts, found.notes),
        section("Shares of kinds", _shares(found)), section("Kinds that differ most", _kinds(found)),
    ]  # fmt: skip
    write_page(parts, "Two spaces", folder / "comparison.html")


def _shares(found: SpaceComparison) -> Markup:
    one, other = (
        np.array([getattr(kind, name).value for kind in found.kinds]) for name in ("one_share", "other_share")
    )
    most = float(max(one.max(initial=0.0), other.max(initial=0.0)))
    figure = Figure(
        [
            figure_trace("scatter", x=np.array([0.0, most]), y=np.array([0.0, most]), mode="lines",
                         line={"color": "#9aa3ad", "width": 1.0, "dash": "6px,4px"}),
            figure_trace("scatter", x=one, y=other, mode="markers", marker={"color": "#0072B2", "size": 7.0},
                         text=[f"{kind.bucket}: {kind.medoid}" for kind in found.kinds], hoverinfo="text"),
        ]
    )  # fmt: skip
    figure.update_xaxes(title_text=f"share in {found.one}")
    figure.update_yaxes(title_text=f"share in {found.other}")
    return to_html(style(figure, 340.0), "shares")


def _kinds(found: SpaceComparison) -> Markup:
    rows = [
        [str(kind.kind), kind.bucket, kind.medoid, str(kind.one), str(kind.other), percent(kind.one_share),
         percent(kind.other_share), percent(kind.difference)]
        for kind in found.kinds[:LISTED]
    ]  # fmt: skip
    heads = [
        "kind",
        "bucket",
        "test case",
        f"in {found.one}",
        f"in {found.other}",
        f"share in {found.one}",
        f"share in {found.other}",
        "difference (95 %)",
    ]
    more = len(found.kinds) - LISTED
    return html("{}<p>{}</p>", table(heads, rows), f"{more} more are in comparison.json." if more > 0 else "")
