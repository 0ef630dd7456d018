"""The outcome: what the EGO did in GT, rGT and rSD, and over the seeds of a perception model in rGT+M."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from resim.report.markup import Markup, html, join
from resim.report.plots import number
from resim.report.tables import NONE, decision_words, difference_words, reaction_words, table
from resim.report.view import View
from resim.resimulation.report import PerceptionReport, SeedReport

RUNS = ("rGT", "rSD")
ENDS = {"duration": "whole duration", "measured": "last sample"}


def outcome(view: View) -> Markup:
    """Give the table of decision, reaction, collision, end and error in GT, rGT, rSD and, over its seeds, rGT+M."""
    report, off = view.report, view.report.reaction_spread
    sources = [s for s in ("GT", *RUNS) if s == "GT" or s in report.end]
    runs = sources[1:]
    rows = [
        ["", "measured", *(badge(view, s) for s in runs)],
        ["decision", *(decision_words(report.decision[s]) for s in sources)],
        ["first braking", *(_if_there(view, s, reaction_words(report.reaction[s])) for s in sources)],
        ["difference", NONE, *(difference_words(report.reaction_difference[s], off) for s in runs)],
        ["collision", *(_if_there(view, s, _collisions(view, s)) for s in sources)],
        ["end", *(_end_words(view, s) for s in sources)],
        ["error at the end", NONE, *(_metres(report.end_position_error[s]) for s in runs)],
    ]
    if report.perception is not None:
        rows = [[*row, cell] for row, cell in zip(rows, _over_seeds(report.perception), strict=True)]
        sources.append("rGT+M")
    return table(["", *sources], rows, "outcome")


def verdict(view: View, run: str) -> tuple[str, str]:
    """Give the class and the words of the badge: whether a run decided as the measured drive did."""
    report = view.report
    if run not in report.end:
        return "none", "not run"
    if report.failure[run]:
        return "failed", "✕ run failed: not comparable"
    early = report.end[run] != "duration"
    until = f", up to its end at {_end(view, run):.2f} s" if early else ""
    same = report.decision[run] == report.decision["GT"]
    if same:  # one that broke off might have decided something else later
        return "none" if early else "same", f"= same decision{until}"
    return "different", f"≠ different decision{until}"


def badge(view: View, run: str) -> Markup:
    """Give the verdict as a badge: colour, sign and words."""
    css, words = verdict(view, run)
    return html('<span class="badge {}">{}</span>', css, words)


def _if_there(view: View, source: str, words: str) -> str:
    return words if view.report.decision[source] is not None else NONE


def _collisions(view: View, source: str) -> str:
    if source not in view.report.collisions:
        return NONE
    hits = view.report.collisions[source]
    return join((html("<b>{} at {:.2f} s</b>", view.label(h.id), h.t) for h in hits), "; ") or "none"


def _end(view: View, source: str) -> float:
    times = view.tracks[source].t
    return float(times[-1]) if len(times) else float("nan")


def _end_words(view: View, source: str) -> str:
    if source not in view.tracks:
        return NONE
    end = view.report.end.get(source, "measured")
    return html("{}, {:.2f} s", end_words(end), _end(view, source))


def end_words(end: str) -> str:
    """Give why a run ended in words, in bold where it ended early."""
    return ENDS.get(end, html("<b>{}</b>", end.replace("_", " ")))


def _metres(error: float | None) -> str:
    return NONE if error is None else f"{error:.2f} m"


def _over_seeds(perception: PerceptionReport) -> list[str]:
    """The table's column of the runs with a perception model: medians, in brackets ranges, and counts."""
    seeds = perception.seeds
    return [
        seeds_badge(perception),
        tallied([decision_words(s.decision) for s in seeds]),
        middle(seeds, "reaction", "s", missing="do not brake"),
        middle(seeds, "reaction_difference", "s", sign="+"),
        tallied([Markup("<b>yes</b>") if s.collision else "none" for s in seeds]),
        tallied([end_words(s.end) for s in seeds]),
        middle(seeds, "end_position_error", "m", missing="ended before"),
    ]


def seeds_badge(perception: PerceptionReport) -> Markup:
    """Give as a badge how many of the seeds decide as the measured drive did."""
    same, every = perception.same_decision, len(perception.seeds)
    css, sign = ("same", "=") if same == every else ("different", "≠") if same == 0 else ("none", "")
    return html('<span class="badge {}">{} {} of {} seeds decide as measured</span>', css, sign, same, every)


def tallied(words: Sequence[str]) -> Markup:
    """Give each of the words with how many runs it is of, the most frequent first; just it, if it is of all."""
    counts = Counter(words).most_common()
    told = (html("{} ({} of {})", word, n, len(words)) if n < len(words) else word for word, n in counts)
    return join(told, "; ")


def middle(seeds: Sequence[SeedReport], name: str, unit: str, *, sign: str = "", missing: str = "") -> Markup:
    """Give the median of a number over the seeds, its range, and of how many seeds it is not known and why."""
    values = np.array([v for s in seeds if (v := getattr(s, name)) is not None], dtype=float)
    lost = len(seeds) - len(values)
    without = f"; {lost} of {len(seeds)} {missing}" if lost and missing else ""
    if not len(values):
        return NONE + without
    low, median, high = (
        ("+" if sign and value > 0.0 else "") + number(float(value), 2)
        for value in np.quantile(values, [0.0, 0.5, 1.0])
    )
    return html("median <b>{} {}</b> ({} to {}){}", median, unit, low, high, without)
