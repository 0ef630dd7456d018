"""The page's tables: numbers of the errors, sums, what was perceived, provenance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from resim.report.markup import Markup, html, join
from resim.report.plots import number
from resim.report.steps import SYMBOLS
from resim.report.view import View
from resim.resimulation.fidelity import QUANTITIES, STATISTICS, STEPS, SUMS
from resim.resimulation.report import PerceptionProvenance, RunProvenance
from resim.resimulation.report import provenance as run_provenance
from resim.simulation.case import SimulatedDrive

DIGITS: Mapping[str, int] = {"d": 3, "v": 3, "heading": 4}
NONE = Markup('<span class="none">–</span>')
HEADS = {
    "mean": "mean",
    "std": "std",
    "min": "min",
    "q25": "25 %",
    "q50": "50 %",
    "q75": "75 %",
    "max": "max",
}


def table(head: Sequence[str], rows: Iterable[Sequence[str]], css: str = "") -> Markup:
    """Give a table; a row's first cell is its head."""
    top = join(html('<th scope="col">{}</th>', cell) for cell in head)
    body = join(
        html(
            '<tr><th scope="row">{}</th>{}</tr>', row[0], join(html("<td>{}</td>", cell) for cell in row[1:])
        )
        for row in rows
    )
    return html(
        '<div class="wide"><table class="{}"><thead><tr>{}</tr></thead><tbody>{}</tbody></table></div>',
        css,
        top,
        body,
    )


def decision_words(decision: Sequence[str] | None) -> str:
    """Give a decision in words."""
    if decision is None:
        return NONE
    return ", then ".join(word.replace("_", " ") for word in decision) or "no braking, no lane change"


def difference_words(seconds: float | None, off: float | None) -> str:
    """Give a difference of reaction times in words, later minus earlier; off: its spread [s]."""
    if seconds is None:
        return NONE
    spread = "" if off is None else f" (± {off:.2f} s)"
    if abs(seconds) < 0.005:
        return f"at the same time as GT{spread}"
    return html("<b>{:.2f} s {}</b> than GT{}", abs(seconds), "later" if seconds > 0.0 else "earlier", spread)


def reaction_words(seconds: float | None) -> str:
    """Give a time of first braking in words."""
    return "no braking" if seconds is None else f"{seconds:.2f} s"


def numbers(view: View) -> Markup:
    """Give the errors of every step: a table for each of d, Δv and Δheading, EGO and TO side by side."""
    errors = view.report.errors
    out = []
    for quantity, unit in QUANTITIES.items():
        rows = []
        for step in STEPS:
            if step in view.result.errors:
                cells = [errors[step][who][quantity] for who in ("ego", "to")]
                rows.append([step, *(_number(c, key, quantity) for c in cells for key in STATISTICS)])
        heads = [HEADS[key] for key in STATISTICS]
        head = [
            f"{SYMBOLS[quantity]} [{unit}]",
            *(html("EGO<br>{}", h) for h in heads),
            *(html("TO<br>{}", h) for h in heads),
        ]
        out.append(table(head, rows, "numbers"))
    return join(out)


def _number(found: Mapping[str, float] | None, key: str, quantity: str) -> str:
    return NONE if found is None else number(found[key], DIGITS[quantity])


def sums(view: View) -> Markup:
    """Give Eq. 5.6: the sum of the steps' mean errors against the measured pipeline error."""
    rows = []
    for whole, parts in SUMS.items():
        for who, found in view.report.sums.get(whole, {}).items():
            cells = [number(found["d"][key], 4) for key in ("sum_of_means", "sum", "measured")]
            cells += [number(found[q][key], 4) for q in ("v", "heading") for key in ("sum", "measured")]
            rows.append([f"{whole} = {' + '.join(parts)}", who.upper(), *cells])
    if not rows:
        return Markup("<p>No branch has all of its steps, so there is no sum to compare.</p>")
    measured = Markup("<br>measured")
    head = ["", "", Markup("d [m]<br>sum of means"), Markup("<br>mean of sums"), measured,
            Markup("Δv [m/s]<br>sum"), measured, Markup("Δheading [rad]<br>sum"), measured]  # fmt: skip
    return table(head, rows, "sums")


def perceived(view: View) -> Markup:
    """Give what the AD function was shown in each run."""
    rows = [
        row
        for source, drive in view.result.simulated().items()
        for row in _perceived_rows(view, source, drive)
    ]
    return table(["run", "object", "seen from", "to", "in cycles", "d mean [m]", "d max [m]", "Δv mean [m/s]"],
                 rows, "sums")  # fmt: skip


def _perceived_rows(view: View, run: str, drive: SimulatedDrive) -> Iterable[list[str]]:
    seen = [p for p in drive.perceived if p.t >= view.start - 1e-6]
    counts = [len(p.ids) for p in seen]
    if not seen:
        yield [run, "no cycle", *[NONE] * 6]
        return
    span = f"{min(counts)} to {max(counts)} at once" if min(counts) != max(counts) else f"{counts[0]} at once"
    yield [
        run,
        f"all objects: {span}",
        f"{seen[0].t:.2f} s",
        f"{seen[-1].t:.2f} s",
        str(len(seen)),
        *[NONE] * 3,
    ]
    for name in view.focus:
        at = [(p, int(np.flatnonzero(p.ids == name)[0])) for p in seen if name in p.ids]
        if not at:
            yield [run, view.label(name), "never", *[NONE] * 5]
            continue
        truth = drive.truth.at(np.array([p.t for p, _ in at]))
        n = truth.index(name)
        x, y = np.array([[axis[k] for axis in p.map_positions()] for p, k in at]).T
        apart = np.hypot(x - truth.x[n], y - truth.y[n])
        dv = np.array([p.v[k] for p, k in at]) - truth.v[n]
        known = np.isfinite(apart)
        cells = [number(float(f(a[known])), 3) if known.any() else NONE
                 for f, a in ((np.mean, apart), (np.max, apart), (np.mean, dv))]  # fmt: skip
        yield [run, view.label(name), f"{at[0][0].t:.2f} s", f"{at[-1][0].t:.2f} s", str(len(at)), *cells]


def findings(view: View) -> Markup:
    """Give what the examination of the recording found, worst first, and what was repaired before."""
    rows = [
        [
            html('<span class="{}">{}</span>', f.severity, f.severity), f.code, f"{f.source} {f.object}",
            span_words(f.start, f.end), f.text, f.meaning,
        ]
        for f in view.result.recording.findings
    ]  # fmt: skip
    head = ["", "code", "where", "when", "what", "what it means"]
    parts = [table(head, rows, "findings") if rows else Markup("<p>Nothing was found.</p>")]
    for source, counts in view.result.recording.repaired.items():
        what = ", ".join(f"{code} {count}" for code, count in counts.items())
        parts.append(
            html("<p>{} samples of {} were repaired before: {}.</p>", sum(counts.values()), source, what)
        )
    return join(parts)


def span_words(start: float, end: float) -> str:
    """Give a span of time in words; a dash where it has none."""
    if start != start:
        return NONE
    return f"{start:.2f} s" if start == end else f"{start:.2f} to {end:.2f} s"


def provenance(view: View) -> Markup:
    """Give versions, hashes, seed and settings; no wall-clock times, which would differ from page to page."""
    rows = [
        [name, html("<code>{}</code>", f"{value:.3g}" if isinstance(value, float) else str(value))]
        for name, value in _facts(run_provenance(view.result, {}))
    ]
    rows += [
        [f"recording: {key}", str(value)] for key, value in sorted(view.result.recording.provenance.items())
    ]
    return table(["what", "value"], rows, "provenance")


def _facts(found: RunProvenance) -> Iterable[tuple[str, object]]:
    """What run.json says, by name, without times and hashes of files."""
    for name, value in vars(found).items():
        if name in ("times", "files"):
            continue
        if isinstance(value, Mapping):
            yield from ((f"{name}: {key}", one) for key, one in value.items())
        elif isinstance(value, PerceptionProvenance):
            yield from ((f"{name}: set", [*value.set]), (f"{name}: seeds", [s.seed for s in value.seeds]))
        else:
            yield name, value
