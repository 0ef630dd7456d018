"""The page of a sweep, put together: one HTML file that opens from disk; the same rows give the same bytes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

from resim.report.document import document
from resim.report.plots import sample, to_html
from resim.report.sweep import tables
from resim.report.sweep.boundary import boundary_html
from resim.report.sweep.figures import DEMANDED, HALF, map_figure, response_figure
from resim.report.sweep.words import Entry, keeps, overview_line, percent, quantity, requirement_lines
from resim.report.tables import table

DASHED = ' stroke-dasharray="6 4"'
REDRAW = (
    "document.querySelectorAll('details').forEach(d => "
    "d.addEventListener('toggle', () => window.dispatchEvent(new Event('resize'))));"
    "addEventListener('hashchange', () => document.getElementById(location.hash.slice(1))?.setAttribute('open', ''))"
)
"""Figures in a part that was folded get its width once it is open."""
PLANS = {
    "grid": "all combinations of the values",
    "one_at_a_time": "one parameter at a time",
    "sobol": "Sobol points",
    "halton": "Halton points",
    "latin_hypercube": "Latin hypercube",
    "adaptive": "adaptive, where an outcome changes",
}

READING = (
    "<h2>How to read it</h2><ul>"
    "<li>The plan spends its runs where the outcome changes: it halves every cell that has good and other points, "
    "until the cells are as small as asked for. Its points are therefore <b>not spread over the ranges</b>, and no "
    "share of runs, sensitivity or response is told: they would be those of the points, not of the parameters. For "
    "these, sweep the same parameters with another plan.</li>"
    "<li>A point is good where enough of its seeds are; near the boundary chance decides, too, which makes it wider "
    "than a cell. Good at every point tried is no more than that: it holds for the points, and says nothing of how "
    "rarely a run between them is otherwise.</li>"
    "<li>The cells are not the whole boundary where chance decides: in trials with noisy outcomes 13 to 15 % of the "
    "line on which half of the runs are good lay outside of them. More seeds a point leave out less.</li>"
    "<li>What lies within one cell of the first grid and touches none of its points is not found: how likely that is "
    "for an island of a given size is told above, for one that may be anywhere. More steps miss less.</li>"
    "<li>A run that failed is never good.</li></ul>"
)


def write_sweep_page(found: Entry, path: Path) -> None:
    """Write the page; found: what report.json holds."""
    path.write_text(page(found), encoding="utf-8", newline="\n")


def page(found: Entry) -> str:
    """Give the page's HTML."""
    css = files("resim.report.sweep").joinpath("sweep.css").read_text(encoding="utf-8")
    several = len(found["sections"]) > 1
    body = [
        f"<style>{css}</style><main>\n",
        _header(found),
        tables.overview(found["sections"], shares=found["plan"] != "adaptive"),
    ]
    for k, section in enumerate(found["sections"]):
        inside = "".join(_section(found, section, k))
        if several:
            inside = f"<summary>{tables.title(section)}</summary>{inside}"
            inside = f'<details class="part" id="s-{k}"{" open" if k == 0 else ""}>{inside}</details>\n'
        body.append(inside)
    body += [_reading(found), _inputs(found), f"</main><script>{REDRAW}</script>"]
    return document(f"{found['name']} · sweep", "".join(body))


def _header(found: Entry) -> str:
    first, inputs = found["sections"][0], found["inputs"]
    plan = escape(str(PLANS.get(found["plan"], found["plan"])))
    counts = sorted({s["points"] for s in found["sections"]})  # of an adaptive plan, each section has its own
    points = " to ".join(str(n) for n in dict.fromkeys((counts[0], counts[-1])))
    facts = [("plan", f"{plan}: {points} points, {first['seeds']} seeds each")]
    facts += [
        (name, escape(Path(inputs[name]["path"]).name))
        for name in ("perception", "criteria")
        if inputs[name] is not None
    ]
    facts += [
        (escape(p["label"]), f"{quantity(p['low'], '')} to {escape(quantity(p['high'], p['unit']))}")
        for p in found["parameters"]
    ]
    listed = "".join(f"<div><dt>{name}</dt><dd>{value}</dd></div>" for name, value in facts)
    line = f'<p class="line">{escape(overview_line(first))}.</p>' if len(found["sections"]) == 1 else ""
    return (
        f'<header><p class="kind">Sweep report</p><h1>{escape(found["name"])}</h1><dl class="facts">{listed}</dl>\n'
        f"{line}</header>\n"
    )


def _section(found: Entry, section: Entry, k: int) -> Iterator[str]:
    yield tables.failures(section)
    if "boundary" in section:
        yield boundary_html(section, found["parameters"], k)
    else:
        yield from _spread(found, section, k)
    yield f"<h2>The same in all runs</h2>\n{tables.constant(section)}"
    yield "<h2>Worst runs <i>failed first, then collisions, then by risk, then by criteria that fail</i></h2>\n"
    yield "<p>The commands are for the folder that this report was made from.</p>"
    yield tables.worst(section, found["parameters"])


def _spread(found: Entry, section: Entry, k: int) -> Iterator[str]:
    """What points that are spread over the ranges tell of these."""
    parameters = found["parameters"]
    yield f"<h2>Requirements <i>in {percent(found['demanded'])} of runs</i></h2>\n{_requirements(found, section)}"
    yield _maps(section, parameters, k)
    yield "<h2>Sensitivity <i>shares of the variance of all runs, with 95 % intervals</i></h2>\n"
    yield tables.sensitivity(section, parameters)
    for share, words in ((True, "How often a run is good"), (False, "Values")):
        outcomes = [o for o in section["outcomes"] if o["share"] == share]
        if outcomes:
            yield f"<h2>{words} <i>mean and 95 % band over points</i></h2>\n{_responses(outcomes, parameters, k)}"


def _requirements(found: Entry, section: Entry) -> str:
    items = [
        f"<dt>{escape(what)}</dt><dd><ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul></dd>"
        for what, lines in requirement_lines(section, found["parameters"], found["demanded"])
    ]
    return f'<dl class="requirements">{"".join(items)}</dl>' if items else "<p>No outcome varies.</p>"


def _maps(section: Entry, parameters: Sequence[Entry], k: int) -> str:
    """A map for each share that varies."""
    by_name = {p["name"]: p for p in parameters}
    drawn = [o for o in section["outcomes"] if o["share"] and o["map"] is not None]
    if not drawn:
        return ""
    figures = [
        f"<figure><figcaption><b>{escape(keeps(o))}</b> {_note(o['map'], by_name)}</figcaption>"
        + to_html(map_figure(o, by_name[o["map"]["a"]], by_name[o["map"]["b"]]), f"map-{k}-{n}")
        + "</figure>"
        for n, o in enumerate(drawn)
    ]
    key = "".join(
        sample(f"{percent(level)} of runs", color) + sample("its 95 % bounds", color, DASHED)
        for level, color in zip(map(float, drawn[0]["map"]["boundaries"]), (HALF, DEMANDED), strict=True)
    )
    return (
        "<h2>Boundaries <i>share of runs that are good</i></h2>\n"
        f'<div class="panels">{"".join(figures)}</div><div class="key-here">{key}</div>'
    )


def _note(found: Entry, by_name: dict[str, Entry]) -> str:
    parts = []
    if found["others"]:
        parts.append("varies, too: " + ", ".join(by_name[name]["label"] for name in found["others"]))
    if found["width"] is not None:
        parts.append(f"smoothed over {percent(found['width'])} of the ranges")
    return f'<span class="note">{escape("; ".join(parts))}</span>' if parts else ""


def _responses(outcomes: Sequence[Entry], parameters: Sequence[Entry], k: int) -> str:
    kind = "share" if outcomes[0]["share"] else "value"
    figures = [
        f"<figure>{to_html(response_figure(outcomes, p), f'{kind}-{k}-{n}')}</figure>"
        for n, p in enumerate(parameters)
        if p["name"] in outcomes[0]["responses"]
    ]
    return f'<div class="panels">{"".join(figures)}</div>'


def _reading(found: Entry) -> str:
    if found["plan"] == "adaptive":
        return READING
    return (
        "<h2>How to read it</h2><ul>"
        "<li>All intervals are of 95 %. What is counted is points of the plan, not runs: the seeds of a point are no "
        "independent evidence about a parameter. Only where one point stands alone, its seeds are counted.</li>"
        "<li>Shares have Wilson's interval with as many independent runs as the variance between points comes to; "
        "means have Student's t over points. The other parameters vary as the sweep varies them.</li>"
        "<li>A requirement is told at its safe end: the farthest value up to (or from) which the share of good runs "
        f"is shown to be {percent(found['demanded'])} or more, that is the lower end of its interval. In fewer than "
        "5 % of sweeps the true share is less. <i>Estimate</i> is where the share itself is that high, <i>possible</i> "
        "where the upper end of its interval is. All runs within a bound count, so that good runs well within make up "
        "for worse ones near the bound: therefore the share at the bound alone. Bounds are values that were swept, "
        "never between two of them. Of a grid, each run counts, as its points are all that is asked about.</li>"
        "<li>Boundaries on the maps are interpolated between the values swept. Drawn points are smoothed by a Gaussian "
        "kernel, whose width is that by which points are best told from the others. Where a bound is not drawn, there "
        "are too few seeds or points to show so high a share.</li>"
        "<li>Sensitivity: <b>first order</b> is what a parameter does alone, <b>total</b> includes what it does "
        "together with others; <b>seeds</b> is chance. On a full grid the variance is taken apart exactly, with "
        "intervals over seeds (jackknife); of drawn points, polynomials are fitted (chaos expansion), and Q² is what "
        "they predict where they were not fitted; what they leave over may be any parameter's, so that the upper ends "
        "of the intervals have it, too. Sharp outcomes leave much over. One at a time tells main effects only.</li>"
        "<li>A run that failed is never good.</li></ul>"
    )


def _inputs(found: Entry) -> str:
    inputs = found["inputs"]
    used = [(name, inputs[name]) for name in ("criteria", "perception") if inputs[name] is not None]
    used += [(f"build {b['label']}", b) for b in inputs["builds"].values()]
    used += [(f"recording {name}", r) for name, r in inputs["recordings"].items()]
    rows = [[escape(name), f"<code>{f['hash']}</code>"] for name, f in used]
    versions = ", ".join(f"{escape(name)} {escape(v)}" for name, v in found["versions"].items())
    return (
        f"<details><summary>Inputs, hashes and versions</summary><p>Run with {versions}.</p>"
        f"{table(['', 'SHA-256'], rows)}</details>"
    )
