"""kernels.html: traces, features and components, and how good the kernels are (Wagner 2021, Figs. 6.1 to 6.4)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from resim.core.correlation import RANKS, nonlinear, pearson
from resim.core.geometry import Floats
from resim.report.document import document
from resim.report.figure import Figure
from resim.report.figure import trace as figure_trace
from resim.report.markup import Markup, html, join
from resim.report.plots import captioned, compact, dots, joined, line, style
from resim.report.tables import table
from resim.variations.evaluation import (
    RECONSTRUCTED,
    UNCORRELATED,
    KernelEvaluation,
    evaluate,
    not_shown,
)
from resim.variations.features import parts
from resim.variations.kernels import KernelFile, ManeuverKernel
from resim.variations.likeness import ALIKE, PLANTED, TOLD, Likeness
from resim.variations.swept import BOX

SHOWN = 500
"""Traces of a maneuver that are drawn, as in Fig. 6.1."""
COLOR, ONE = "#0072B2", "#D55E00"
SCALE = [[0.0, "#1a9641"], [0.3, "#a6d96a"], [0.5, "#ffffbf"], [0.75, "#fdae61"], [1.0, "#d7191c"]]
"""Green is uncorrelated, red is correlated."""
PERCENT = 100.0

PooledTraces = Mapping[str, tuple[Floats, Floats]]


def write_kernel_page(
    kernels: KernelFile, pooled: PooledTraces, likeness: Mapping[str, tuple[Likeness, Likeness]], path: Path
) -> None:
    """Write the page.

    pooled: by maneuver the features (N, F) that it was trained on, and those (M, F) held out. likeness: where there are
    enough, how well variations are told from measured traces, and how well planted noise is.
    """
    found = {name: evaluate(kernel, pooled[name][1]) for name, kernel in kernels.kernels.items()}
    body = [_header(kernels), _summary(kernels, found), _likeness(found, likeness, kernels.data)]
    for number, (name, kernel) in enumerate(kernels.kernels.items()):
        body.append(_kernel(kernel, pooled[name][0], f"k{number}"))
    body.append(_sources(kernels))
    page = html("<main>\n{}</main>", join(body, "\n"))
    path.write_text(document("Maneuver kernels", page), encoding="utf-8", newline="\n")


def _header(kernels: KernelFile) -> Markup:
    facts = (
        ("data", "real drives, as the user vouches" if kernels.data == "real" else "synthetic drives"),
        ("recordings", str(len(kernels.sources))),
        ("kernels", ", ".join(kernels.kernels)),
    )
    listed = join(html("<div><dt>{}</dt><dd>{}</dd></div>", name, value) for name, value in facts)
    claim = (
        ""
        if kernels.data == "real"
        else html('<p class="note">Trained on synthetic drives: nothing here says how humans drive.</p>')
    )
    return html(
        '<header><p class="kind">Kernels</p><h1>Maneuver kernels</h1><dl class="facts">{}</dl>{}</header>',
        listed, claim,
    )  # fmt: skip


def _summary(kernels: KernelFile, found: Mapping[str, KernelEvaluation]) -> Markup:
    head = ["maneuver", "traces", "held out", "components", "reconstruction", "of those held out",
            f"largest |r| of two components beyond its bias (under {UNCORRELATED:g})",
            f"largest NCC (b = {RANKS}) beyond its bias",
            "held-out traces show it"]  # fmt: skip
    rows = []
    for name, one in found.items():
        kernel = kernels.kernels[name]
        rows.append([
            name, str(kernel.traces), str(kernel.held_out), str(kernel.count), _share(kernel.reconstruction),
            _share(one.reconstruction), f"{_or_none(one.linear)} (bias {_or_none(one.linear_bias)})",
            f"{_or_none(one.nonlinear)} (bias {_or_none(one.bias)})", verdict(kernel, one),
        ])  # fmt: skip
    rows += [
        [name, "–", "–", "–", "–", "–", "–", "–", f"no kernel: {why}"]
        for name, why in kernels.not_made.items()
    ]
    return html("<section><h2>How good they are</h2>{}</section>", table(head, rows))


def _likeness(
    found: Mapping[str, KernelEvaluation], likeness: Mapping[str, tuple[Likeness, Likeness]], data: str
) -> Markup:
    """Whether variations can be told from measured traces."""
    rows = []
    for name, one in found.items():
        if name not in likeness:
            rows.append(
                [
                    name,
                    str(one.held_out),
                    "–",
                    "–",
                    "–",
                    f"not shown: {one.missing} held-out traces are missing",
                ]
            )
            continue
        alike, noisy = likeness[name]
        good = alike.auc <= ALIKE and noisy.auc > TOLD
        told = (
            "like measured traces" if good else "told apart" if alike.auc > ALIKE else "the test is too weak"
        )
        rows.append([name, str(alike.traces), _auc(alike), _auc(noisy), _by(alike), told])
    head = ["maneuver", "traces", f"AUC, variations (at most {ALIKE:g})", f"AUC, {100 * PLANTED:g} cm of noise "
            f"(over {TOLD:g})", "what tells most, alone", "held-out traces show it"]  # fmt: skip
    whose = "human drivers, as the user vouches" if data == "real" else "synthetic drivers"
    note = html(
        '<p class="note">One variation at {} % of each held-out trace; gradient boosting on statistics of speeds, '
        "accelerations and jerk, split by origin. The traces are of {}.</p>", f"{100 * BOX:g}", whose,
    )  # fmt: skip
    return html("<section><h2>Can variations be told?</h2>{}{}</section>", note, table(head, rows))


def _auc(one: Likeness) -> str:
    return f"{one.auc:.3f} ({one.low:.3f} to {one.high:.3f})"


def _by(one: Likeness) -> str:
    return ", ".join(f"{name} {auc:.2f}" for name, auc in one.by.items())


def _or_none(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.3f}"


def verdict(kernel: ManeuverKernel, one: KernelEvaluation) -> str:
    """Say in words what held-out traces show of a kernel."""
    if missing := not_shown(kernel):
        return missing
    told = "uncorrelated" if one.uncorrelated else "correlated"
    more = "reconstructed" if one.reconstructed else f"not reconstructed to {PERCENT * RECONSTRUCTED:g} %"
    return f"{told}, {more}"


def _share(value: float) -> str:
    return "–" if np.isnan(value) else f"{PERCENT * value:.4f} %"


def _kernel(kernel: ManeuverKernel, features: Floats, name: str) -> Markup:
    return html(
        "<section><h2>{}</h2>\n{}{}{}{}{}</section>", kernel.label.replace("_", " "), _traces(features, name),
        _example(kernel, features, name), _features(features, name), _components(kernel, features, name),
        _bounds(kernel),
    )  # fmt: skip


def _traces(features: Floats, name: str) -> Markup:
    """Fig. 6.1."""
    _, s, d = parts(features[:SHOWN])
    x, y = joined([*s], [*d])
    figure = Figure([line(x, y, color="rgba(0,114,178,0.25)", name="trace", width=0.8)])
    figure.update_xaxes(title_text="along the lane [m]")
    figure.update_yaxes(title_text="across the lane [m]")
    note = f"{min(len(features), SHOWN)} of {len(features)} traces, from their first point (Fig. 6.1)"
    return captioned(style(figure, 260.0), f"{name}traces", "Traces", note)


def _example(kernel: ManeuverKernel, features: Floats, name: str) -> Markup:
    """Fig. 6.2: one trace as features, and all of them by their first components."""
    figure = Figure.of_panels(1, 2, horizontal_spacing=0.12)
    scores = kernel.components(features)
    middle = int(np.argmin(np.square(scores / np.maximum(kernel.sd, 1e-12)).sum(axis=1)))
    _, s, d = parts(features[middle])
    figure.add_trace(dots(s, d, color=ONE, name="points", hover="%{x:.2f} m, %{y:.3f} m"), 1, 1)
    second = scores[:, 1] if kernel.count > 1 else np.zeros(len(scores))
    cloud = dots(scores[:, 0], second, color=COLOR, name="traces", hover="%{x:.2f}, %{y:.3f}", size=3.0)
    figure.add_trace(cloud, 1, 2)
    one = dots(
        scores[[middle], 0],
        second[[middle]],
        color=ONE,
        name="this trace",
        hover="%{x:.2f}, %{y:.3f}",
        size=9.0,
    )
    figure.add_trace(one, 1, 2)
    figure.update_xaxes(col=1, title_text="along the lane [m]")
    figure.update_yaxes(col=1, title_text="across the lane [m]")
    figure.update_xaxes(col=2, title_text="component 1 [m]")
    figure.update_yaxes(col=2, title_text="component 2 [m]")
    note = "the points of one trace, and where it is among the others by its first two components (Fig. 6.2)"
    return captioned(style(figure, 280.0), f"{name}example", "Features and components", note)


def _features(features: Floats, name: str) -> Markup:
    """Fig. 6.3."""
    if len(features) < RANKS:
        return Markup()
    note = f"t, then along, then across, by Pearson and nonlinearly (b = {RANKS}) (Fig. 6.3)"
    figure = _matrices(np.abs(pearson(features)), nonlinear(features), "feature")
    return captioned(figure, f"{name}features", "Correlation of the features", note)


def _components(kernel: ManeuverKernel, features: Floats, name: str) -> Markup:
    """Fig. 6.4."""
    if len(features) < RANKS:
        return Markup()
    scores = kernel.components(features)
    figure = _matrices(np.abs(pearson(scores)), nonlinear(scores), "component")
    note = f"of the traces it was trained on, by Pearson and nonlinearly (b = {RANKS}) (Fig. 6.4)"
    return captioned(figure, f"{name}components", "Correlation of the components", note)


def _matrices(left: Floats, right: Floats, what: str) -> Figure:
    figure = Figure.of_panels(1, 2, horizontal_spacing=0.1, subplot_titles=("Pearson, absolute", "nonlinear"))
    for column, matrix in enumerate((left, right), start=1):
        shown = figure_trace(
            "heatmap", z=compact(np.round(matrix, 3)).astype(np.float32), zmin=0.0, zmax=1.0, colorscale=SCALE,
            showscale=column == 2, hovertemplate="%{x}, %{y}: %{z:.3f}<extra></extra>",
        )  # fmt: skip
        figure.add_trace(shown, 1, column)
        figure.update_xaxes(col=column, title_text=what)
        figure.update_yaxes(col=column, autorange="reversed")
    return style(figure, 360.0)


def _bounds(kernel: ManeuverKernel) -> Markup:
    total = np.cumsum(kernel.explained)
    rows = [
        [str(k + 1), f"{PERCENT * kernel.explained[k]:.4f} %", f"{PERCENT * total[k]:.4f} %", f"{kernel.sd[k]:.4g}",
         f"{kernel.low[k]:.4g}", f"{kernel.high[k]:.4g}"]
        for k in range(kernel.count)
    ]  # fmt: skip
    head = ["component", "explained variance", "together", "standard deviation", "least", "largest"]
    return html("<p>Components: what they explain, and their bounds:</p>{}", table(head, rows))


def _sources(kernels: KernelFile) -> Markup:
    rows = [
        [one.recording, one.source, ", ".join(f"{n} {label}" for label, n in one.traces.items()),
         "; ".join(f"{n} {why}" for why, n in one.left_out.items()), one.hash[:16]]
        for one in kernels.sources
    ]  # fmt: skip
    head = ["recording", "where it comes from", "traces", "left out", "hash"]
    return html("<section><h2>Data</h2>{}</section>", table(head, rows))
