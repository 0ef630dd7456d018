"""Tables of a sweep: the overview, sensitivity, what is the same in all runs, the worst runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from resim.report.sweep.words import Entry, axis_title, percent, plain, quantity
from resim.report.tables import NONE, decision_words, table


def title(section: Entry) -> str:
    """Give a section's name (HTML)."""
    return f"{escape(section['recording'])} · {escape(section['build'])}"


def overview(sections: Sequence[Entry], *, shares: bool) -> str:
    """Give a row a section: what came of its runs, and as shares of them where these say something."""
    rows = [
        [
            f'<a href="#s-{k}">{title(s)}</a>' if len(sections) > 1 else title(s), str(s["runs"]),
            f"<b>{s['failed']}</b>" if s["failed"] else "0", _of(s["passed"], s, shares), str(s["collisions"]),
            _of(s["same_decision"], s, shares), NONE if s["largest_risk"] is None else percent(s["largest_risk"]),
            _decisions(s),
        ]
        for k, s in enumerate(sections)
    ]  # fmt: skip
    head = [
        "",
        "runs",
        "failed",
        "pass every criterion",
        "collisions",
        "decide as measured",
        "largest risk",
        "decisions",
    ]
    return table(head, rows, "overview")


def _of(count: int, section: Entry, shares: bool) -> str:
    return f"{count} <i>{percent(count / section['runs'])}</i>" if shares else str(count)


def _decisions(section: Entry) -> str:
    return "<br>".join(
        f"{decision_words([w for w in name.split(', ') if w])} <i>{n}</i>"
        for name, n in section["decisions"].items()
    )


def failures(section: Entry) -> str:
    """Give why runs failed, and how many."""
    if not section["failed"]:
        return ""
    items = "".join(f"<li>{n} × {escape(why)}</li>" for why, n in section["failures"].items())
    return (
        f'<div class="warnings"><b>{section["failed"]} of {section["runs"]} runs failed</b>: they have no result, and '
        f"count as passing nothing<ul>{items}</ul></div>"
    )


def sensitivity(section: Entry, parameters: Sequence[Entry]) -> str:
    """Give Sobol indices by outcome, or of what varies only how far the means reach."""
    head = ["outcome", *(f"{escape(p['label'])}<br><i>total, first order</i>" for p in parameters),
            "seeds", "left over", "estimated by"]  # fmt: skip
    rows = [_indices(o, parameters) for o in section["outcomes"]]
    return table(head, rows, "sensitivity")


def _indices(outcome: Entry, parameters: Sequence[Entry]) -> list[str]:
    found, label = outcome["sensitivity"], escape(outcome["label"])
    if (sobol := found["sobol"]) is None:
        reach = [found["range"][p["name"]] for p in parameters]
        cells = [
            NONE if r is None else f"<i>means reach over</i> {quantity(r, outcome['unit'])}" for r in reach
        ]
        why = f"no indices: {outcome['without']} points have no value" if outcome["without"] else "no indices"
        return [label, *cells, NONE, NONE, why]
    cells = [_index(sobol[p["name"]], p["name"] == found["ranking"][0]) for p in parameters]
    how = "analysis of variance"
    if sobol["method"] == "chaos":
        doubt = " <b>unreliable</b>" if sobol["q2"] < 0.5 else ""
        how = f"polynomials of degree {sobol['degree']}, Q² {sobol['q2']:.2f}{doubt}"
    noise = NONE if sobol["noise"] is None else f"{sobol['noise']:.2f}"
    return [label, *cells, noise, f"{sobol['unexplained']:.2f}", how]


def _index(found: Entry, leads: bool) -> str:
    total = found["total"]
    text = f"<b>{total:.2f}</b>" if leads and total > 0.0 else f"{total:.2f}"
    bar = f'<span class="meter" style="width:{max(60.0 * total, 1.0):.0f}px"></span>'
    first = f"<i>{found['first']:.2f} {_between(found['first_interval'])}</i>"
    return f"{bar}{text} {_between(found['total_interval'])}<br>{first}"


def _between(interval: Sequence[float | None]) -> str:
    return (
        "" if interval[0] is None or interval[1] is None else f"<i>[{interval[0]:.2f}, {interval[1]:.2f}]</i>"
    )


def constant(section: Entry) -> str:
    """Say what is the same in all runs."""
    shares = [o for o in section["constant"] if o["share"]]
    groups: Mapping[str, list[str]] = {
        "Good in all runs": [escape(o["label"]) for o in shares if o["value"] == 1.0],
        "Good in no run": [escape(o["label"]) for o in shares if o["value"] == 0.0],
        "Does not vary, or was not measured": [
            f"{escape(o['label'])} ({'no value' if o['value'] is None else quantity(o['value'], o['unit'])})"
            for o in section["constant"] if not o["share"]
        ],
    }  # fmt: skip
    return "".join(f"<p><b>{name}</b>: {', '.join(some)}.</p>" for name, some in groups.items() if some)


def worst(section: Entry, parameters: Sequence[Entry]) -> str:
    """Give the worst runs, each with the command that repeats it."""
    names = [escape(axis_title(p)) for p in parameters]
    head = ["run", *names, "seed", "risk", "fails", "decision", "repeat it"]
    rows = [
        [
            str(w["run"]), *(plain(w["parameters"][p["name"]]) for p in parameters), str(w["seed"]),
            NONE if w["risk"] is None else percent(w["risk"]), _what(w),
            NONE if w["decision"] is None else decision_words([d for d in w["decision"].split(", ") if d]),
            f"<code>{escape(w['command'])}</code>",
        ]
        for w in section["worst"]
    ]  # fmt: skip
    return table(head, rows, "worst")


def _what(run: Entry) -> str:
    if run["failure"] is not None or run["end"] == "failed":
        return f"<b>failed</b>: {escape(run['failure'] or 'no result')}"
    return ("<b>collision</b>; " if run["collision"] else "") + (
        escape(", ".join(run["failing"])) or "passes all"
    )
