"""release.html: the verdict, what forbids it, what is left of the ODD, and what to do next."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from resim.core.spelling import counted
from resim.report.markup import Markup, html
from resim.report.tables import table
from resim.space.page.cover import calibration
from resim.space.page.words import header, number, percent, section, write_page
from resim.space.release_report import AccidentBudget, ReleaseCheck, ReleaseReport
from resim.space.risk import CoverReport

LISTED = 50


def write_release_page(found: ReleaseReport, cover: CoverReport | None, folder: Path) -> None:
    """Write release.html."""
    facts = (
        ("verdict", found.verdict.upper()), ("build", found.label or "none"),
        ("limits", found.limits.name), ("confidence", f"{100.0 * found.limits.confidence:g} %"),
    )  # fmt: skip
    parts = [
        header("Release", "May the function be released?", facts, found.notes),
        section("Statement", html("<p>{}</p>{}", found.statement, _checks(found.checks))),
        section("Accidents, by what they are of", _budgets(found.budgets)),
        section("Clusters that forbid it", _forbidding(found)),
        section("What is left of the ODD", _remaining(found)),
        section("The next test plan", _plan(found)),
        section(
            "Is predicted risk to be believed?", calibration(None if cover is None else cover.calibration)
        ),
        section("Repeat it", _hashes(found)),
    ]
    write_page(parts, "Release", folder / "release.html")


def _checks(checks: tuple[ReleaseCheck, ...]) -> Markup:
    rows = [
        [one.name, number(one.value), _interval(one), number(one.limit),
         "met" if one.met else "exceeded" if one.exceeded else "not shown", _missing(one), one.source]
        for one in checks
    ]  # fmt: skip
    heads = [
        "asked for",
        "estimate",
        "interval",
        "limit",
        "",
        "hours missing, at least",
        "source of the limit",
    ]
    return table(heads, rows, "checks reasons")


def _missing(one: ReleaseCheck) -> str:
    if one.met or one.missing_hours == 0.0:
        return "–"
    return number(one.missing_hours) if np.isfinite(one.missing_hours) else "not known"


def _interval(one: ReleaseCheck) -> str:
    if np.isnan(one.low):
        return "–"
    upper = number(one.high) if np.isfinite(one.high) else "not known"
    return f"{number(one.low)} to {upper}"


def _budgets(budgets: tuple[AccidentBudget, ...]) -> Markup:
    rows = [
        [one.per, _known(one), _at_most(one.thin), _at_most(one.unseen), _at_most(one.high),
         number(one.limit)]
        for one in budgets
    ]  # fmt: skip
    heads = ["by", "clusters with known risk", "clusters without (each scenario an accident)",
             "kinds not seen (each scenario an accident)", "all", "limit"]  # fmt: skip
    return table(heads, rows)


def _at_most(value: float) -> str:
    return f"at most {number(value)}" if np.isfinite(value) else "not known"


def _known(one: AccidentBudget) -> str:
    if not np.isfinite(one.known.value):
        return "none"
    return f"{number(one.known.value)}, at most {number(one.known.high)}"


def _forbidding(found: ReleaseReport) -> Markup:
    if not found.forbidding:
        return html("<p>None.</p>")
    rows = [
        [one.cluster, one.bucket, f"{100.0 * one.share:.3g}\u00a0%", number(one.risk), number(one.accidents),
         one.medoid, one.why]
        for one in found.forbidding[:LISTED]
    ]  # fmt: skip
    more = len(found.forbidding) - LISTED
    heads = ["cluster", "bucket", "share", "risk at most", "accidents an hour at most", "test case", "why"]
    return html(
        "{}<p>{}</p>", table(heads, rows, "reasons"), f"{more} more are in release.json." if more > 0 else ""
    )


def _remaining(found: ReleaseReport) -> Markup:
    left = found.remaining
    enough = "its accidents are within the limits" if left.enough else (
        "not even that is enough: kinds that were not seen, and what is in no scenario, cannot be left out"
    )  # fmt: skip
    return html(
        "<p>{}, {} of what comes; accidents an hour: {}; {}.</p>", counted(left.clusters, "cluster"),
        percent(left.share),
        _at_most(left.high), enough,
    )  # fmt: skip


def _plan(found: ReleaseReport) -> Markup:
    rows = [
        [str(k), one.task, one.cluster or "–",
         number(one.after), f"{100.0 * (1.0 - one.after / one.before):.3g}\u00a0%" if np.isfinite(one.before) else "–",
         one.first]
        for k, one in enumerate(found.plan, start=1)
    ]  # fmt: skip
    heads = ["rank", "what", "cluster", "accidents an hour then, at most", "less by", "before it"]
    return (
        table(heads, rows, "reasons")
        if rows
        else html("<p>Nothing that is known would help: drive more.</p>")
    )


def _hashes(found: ReleaseReport) -> Markup:
    rows = [["space.json", found.space], ["cover.json", found.cover or "–"], ["limits", found.limits_hash],
            ["build", found.build or "–"], ["perception", found.perception or "–"]]  # fmt: skip
    return table(["of", "SHA-256"], rows)
