"""space.html: the space, its buckets and clusters, and how much was seen."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from resim.core.spelling import counted
from resim.report.markup import Markup, html, join
from resim.report.tables import table
from resim.space.distance import PairDistances
from resim.space.layout import plane
from resim.space.model import Space
from resim.space.page import figures
from resim.space.page.words import header, interval, number, percent, section, write_page
from resim.space.report import BucketEntry, ClusterEntry, CoverageEntry, SpaceReport

SHOWN = 12
"""Buckets that are shown with their dendrograms, the largest first."""
CLUSTERS = 8
"""Clusters of a bucket that are shown from above, the largest first."""
MEMBERS = 40
"""Members of a cluster that are drawn."""
MAPPED = 800
"""Clusters that the map shows, the most frequent first."""


def write_space_page(space: Space, told: SpaceReport, folder: Path) -> None:
    """Write space.html into the space's folder."""
    parts = [
        _header(told), section("How much was seen", _coverage(told.coverage, "discovery")),
        section("Clusters by distance", _map(space, told)), section("Buckets", _buckets(told)),
        section("Clusters of the largest buckets", _shown(space, told)), section("Sources", _sources(told)),
    ]  # fmt: skip
    write_page(parts, "Scenario space", folder / "space.html")


def _header(told: SpaceReport) -> Markup:
    settings = told.settings
    asked = settings.threshold
    threshold = f"by {asked}" if isinstance(asked, str) else f"{asked:g}"
    clusters = sum(len(one.clusters) for one in told.buckets)
    facts = (
        ("scenarios", f"{told.scenarios} in {counted(len(told.buckets), 'bucket')}"),
        ("clusters", f"{clusters}, {sum(c.members == 1 for b in told.buckets for c in b.clusters)} with one member"),
        ("driven", f"{number(told.hours)} h, {number(told.kilometres)} km by EGOs"),
        ("clustering", f"{settings.linkage} linkage, threshold {threshold}"),
    )  # fmt: skip
    return header("Scenario space", "Kinds of scenarios, and how many are missing", facts, told.notes)


def _coverage(found: CoverageEntry, name: str) -> Markup:
    state = found.convergence
    rows = [
        ["kinds seen", str(found.kinds.seen)],
        ["kinds there are at least (Chao's lower bound; nobody can tell how many more)",
         f"{number(found.kinds.at_least)}; the bound lies below {number(found.kinds.high)}"],
        ["probability that the next scenario is of a kind not seen", percent(state.unseen)],
        ["of the later half, of a new kind or enlarging theirs", percent(state.expanding)],
        ["new kinds an hour in the later half", interval(found.discovery_per_hour)],
        ["new kinds a kilometre in the later half", interval(found.discovery_per_kilometre)],
        ["converged", _converged(found)],
    ]  # fmt: skip
    if (half := found.held_out) is not None:
        agree = "the intervals overlap" if half.agree else "they do not agree: take the larger one"
        rows.append(
            ["held-out half: predicted, found", f"{percent(half.predicted)}, {percent(half.found)}: {agree}"]
        )
    return html("{}{}", table(["", "value (95 %)"], rows), figures.discovery(found.curve, name))


def _converged(found: CoverageEntry) -> str:
    state = found.convergence
    limit = f"{100.0 * state.limit:g} %"
    if state.converged:
        return f"yes: both upper ends are at most {limit}"
    hours = (
        f", {number(state.missing_hours)} h at the rate so far" if np.isfinite(state.missing_hours) else ""
    )
    more = (
        f"{state.missing:.0f} more scenarios"
        if np.isfinite(state.missing)
        else "nobody can tell how many more"
    )
    return f"no: about {more}{hours} until both upper ends can be at most {limit}"


def _map(space: Space, told: SpaceReport) -> Markup:
    drawn = cluster_map(space, told, {})
    return html(
        "<p>Each dot is a cluster, as large as it is frequent; those that are alike lie near.</p>{}", drawn
    )


def cluster_map(space: Space, told: SpaceReport, risk: Mapping[str, float]) -> Markup:
    """Give the clusters laid out by distance, as large as they are frequent. risk: by cluster, which colours them."""
    clusters = sorted(told.clusters().values(), key=lambda one: (-one.members, one.cluster))[:MAPPED]
    own = space.traces.rows_of([one.medoid for one in clusters])
    pairs = PairDistances(space.traces.take(own), space.settings.distance)
    every = np.arange(len(own))
    place = plane(pairs.between(every, every))
    size = np.array([float(one.members) for one in clusters])
    names = [one.cluster for one in clusters]
    values = np.array([risk.get(name, np.nan) for name in names])
    hover = {one.cluster: _cluster_words(one) for one in clusters}
    return figures.cluster_map(place, size, values, names, hover)


def _cluster_words(one: ClusterEntry) -> str:
    return f"{counted(one.members, 'member')}, {_exposure(one)}, medoid {one.medoid}"


def _exposure(one: ClusterEntry) -> str:
    """How often a kind comes, by hour and kilometre."""
    return f"{interval(one.per_hour)} an hour, {interval(one.per_kilometre)} a kilometre"


def _buckets(told: SpaceReport) -> Markup:
    rows = []
    for one in sorted(told.buckets, key=lambda b: (-b.scenarios, b.number)):
        state = one.coverage.convergence
        missing = "–" if state.converged else f"at least {number(state.missing)}"
        if not np.isfinite(state.missing):
            missing = "not known"
        rows.append(
            [one.bucket, str(one.scenarios), str(len(one.clusters)), str(sum(c.members == 1 for c in one.clusters)),
             f"{one.threshold:.3g}, {one.chosen}", f"{number(one.coverage.kinds.at_least)}",
             percent(state.unseen), "yes" if state.converged else "no", missing]
        )  # fmt: skip
    heads = ["bucket", "scenarios", "clusters", "with one member", "threshold", "kinds at least", "next is new",
             "converged", "scenarios missing"]  # fmt: skip
    return table(heads, rows)


def _shown(space: Space, told: SpaceReport) -> Markup:
    largest = sorted(told.buckets, key=lambda b: (-b.scenarios, b.number))[:SHOWN]
    return join(_bucket(space, one) for one in largest)


def _bucket(space: Space, bucket: BucketEntry) -> Markup:
    names = space.rows["cluster"].to_numpy(str)
    views = []
    for one in sorted(bucket.clusters, key=lambda c: (-c.members, c.cluster))[:CLUSTERS]:
        rows = np.flatnonzero(names == one.cluster)
        medoid = int(space.traces.rows_of([one.medoid])[0])
        shown = rows[np.unique(np.linspace(0, len(rows) - 1, MEMBERS).astype(int))].tolist()
        drawn = figures.members(space.traces, shown, medoid)
        words = f"{counted(one.members, 'member')}, radius {one.radius:.2f}; {_exposure(one)}; test case {one.medoid}"
        views.append(
            html("<figure>{}<figcaption><b>{}</b> {}</figcaption></figure>", drawn, one.cluster, words)
        )
    return html("<h3>{}</h3>{}{}", bucket.bucket, figures.dendrogram(bucket), join(views))


def _sources(told: SpaceReport) -> Markup:
    rows = [
        [one.name, "built from" if not one.batch else f"grown, {one.batch}", one.egos, number(one.hours),
         number(one.kilometres), str(one.scenarios), str(one.occasions), f"{100.0 * one.build_share:.0f} %"
         if np.isfinite(one.build_share) else "–"]
        for one in told.sources
    ]  # fmt: skip
    heads = ["source", "", "EGO", "h", "km", "scenarios", "occasions", "driven by a build"]
    return table(heads, rows)
