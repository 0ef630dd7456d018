"""cover.html: the risk of each cluster, which simulated members count, and whether predicted risk is to be believed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from resim.core.spelling import counted
from resim.report.figure import Figure
from resim.report.figure import trace as figure_trace
from resim.report.markup import Markup, html, join
from resim.report.plots import style, to_html
from resim.report.tables import table
from resim.space.calibration import ReliabilityReport
from resim.space.expected import is_believed
from resim.space.model import Space
from resim.space.page.page import cluster_map
from resim.space.page.words import header, interval, number, percent, section, write_page
from resim.space.report import SpaceReport
from resim.space.risk import ClusterRisk, CoverReport, WorstMember

NOT_SHOWN = (
    "Predicted risk is shown where it is calibrated: where held-out drives with such a prediction do not collide more "
    "often. What is not shown counts as an accident in each scenario when a release is decided."
)
LISTED = 100
"""Clusters that are listed, the riskiest first."""
WORST = 10
"""Worst members of all that are listed."""


def write_cover_page(space: Space, told: SpaceReport, found: CoverReport, folder: Path) -> None:
    """Write cover.html into the space's folder."""
    facts = (
        ("build", found.label or "unknown"),
        ("perception", found.perception[:12] or "none"),
        ("test drives verified", str(found.drives)),
        ("members that count", f"{sum(one.counted for one in found.clusters)} simulated, "
         f"{sum(one.measured for one in found.clusters)} driven"),
    )  # fmt: skip
    risk = {one.cluster: one.risk.high for one in found.clusters if is_believed(one, found.calibration)}
    surface = html(
        "<p>Colour: upper limit (95 %) of accidents a scenario; grey: not shown. Size: exposure.</p>{}",
        cluster_map(space, told, risk),  # the limit, as one drive without an accident tells little
    )
    parts = [
        header("Covered space", "Risk of each kind of scenario", facts, found.notes),
        section("Risk by cluster", surface), section("Clusters", _clusters(told, found)),
        section("Worst members", _worst(found)), section("What was given", _given(found)),
        section("Is predicted risk to be believed?", calibration(found.calibration)),
    ]  # fmt: skip
    write_page(parts, "Covered space", folder / "cover.html")


def _clusters(told: SpaceReport, found: CoverReport) -> Markup:
    exposure = told.clusters()
    order = sorted(found.clusters, key=lambda one: (-np.nan_to_num(one.risk.value, nan=-1.0), one.cluster))
    rows = [
        [one.cluster, interval(exposure[one.cluster].per_hour), interval(exposure[one.cluster].per_kilometre),
         _risk(found, one), f"{one.measured_collided} of {one.measured}", f"{one.collided} of {one.counted}",
         str(one.drives), str(one.missing), str(one.not_counted), _why(one), exposure[one.cluster].medoid]
        for one in order[:LISTED]
    ]  # fmt: skip
    heads = [
        "cluster",
        "an hour (95 %)",
        "a kilometre (95 %)",
        "risk a scenario (95 %)",
        "driven, collided or not known",
        "simulated, collided",
        "in drives",
        "not simulated",
        "do not count",
        "why",
        "test case",
    ]
    more = f"{len(order) - LISTED} more are in cover.json." if len(order) > LISTED else ""
    return html("<p>{}</p>{}<p>{}</p>", NOT_SHOWN, table(heads, rows), more)


def _risk(found: CoverReport, one: ClusterRisk) -> str:
    """The risk of a cluster, where it is believed."""
    if not one.drives:
        return "not shown: no member counts"
    return interval(one.risk) if is_believed(one, found.calibration) else "not shown: not calibrated"


def _why(one: ClusterRisk) -> str:
    return "; ".join(f"{why} ({count})" for why, count in one.why.items())


def _worst(found: CoverReport) -> Markup:
    every = [(one.cluster, member) for one in found.clusters for member in one.worst]
    shown = found.calibration is not None and found.calibration.verdict == "calibrated"
    every.sort(key=lambda pair: (-_counts_as(pair[1]), pair[1].member))
    rows = [
        [member.member, cluster, number(member.risk) if shown else "not shown",
         {True: "yes", False: "no", None: "not known"}[member.collided], html("<code>{}</code>", member.repeat)]
        for cluster, member in every[:WORST]
    ]  # fmt: skip
    listed = table(["member", "cluster", "risk", "collided", "to repeat it"], rows)
    return html("<p>Give commands in the folder of this page.</p>{}", listed)


def _given(found: CoverReport) -> Markup:
    folders = [*found.given.items(), *((f"{name} (held out)", one) for name, one in found.held_out.items())]
    rows = [[name, str(one.runs), one.hash] for name, one in folders]
    told = "Of simulated drives in other folders nothing is known here: give all that were made."
    return html("<p>{}</p>{}", told, table(["folder", "runs", "SHA-256"], rows))


def _counts_as(one: WorstMember) -> float:
    return 1.0 if one.collided is not False or np.isnan(one.risk) else float(one.risk)


def calibration(found: ReliabilityReport | None) -> Markup:
    """Give the reliability diagram."""
    if found is None:
        return html("<p>Not shown: no drives were held out (<code>--held-out</code>).</p>")
    mean = np.array([one.predicted for one in found.bins])
    seen, low, high = (
        np.array([getattr(one.collided, name) for one in found.bins]) for name in ("value", "low", "high")
    )
    x = np.column_stack([mean, mean, np.full(len(mean), np.nan)]).ravel()
    y = np.column_stack([low, high, np.full(len(mean), np.nan)]).ravel()
    most = float(max(high.max(initial=0.0), mean.max(initial=0.0), 1e-6))
    figure = Figure(
        [
            figure_trace("scatter", x=np.array([0.0, most]), y=np.array([0.0, most]), mode="lines",
                         line={"color": "#9aa3ad", "dash": "6px,4px", "width": 1.0}),
            figure_trace("scatter", x=x, y=y, mode="lines", line={"color": "#0072B2", "width": 1.6}),
            figure_trace("scatter", x=mean, y=seen, mode="markers", marker={"color": "#0072B2", "size": 8.0}),
        ]
    )  # fmt: skip
    figure.update_xaxes(title_text="predicted risk")
    figure.update_yaxes(title_text="share that collided, or not known")
    rows = [
        [f"{one.low:g} to {one.high:g}", str(one.drives), str(one.recordings), number(one.predicted),
         percent(one.collided), one.verdict]
        for one in found.bins
    ]  # fmt: skip
    told = html(
        "<p>{}: <b>{}</b>. Without a prediction or an outcome: {}.</p>",
        counted(found.drives, "held-out drive"), found.verdict, found.unknown,
    )  # fmt: skip
    drawn = to_html(style(figure, 320.0), "reliability")
    heads = [
        "predicted",
        "drives",
        "of recordings, all known",
        "mean",
        "collided, or not known (95 % of all bins)",
        "",
    ]
    return join([told, drawn, table(heads, rows)])
