"""The page of a perception model: how well it tells what the sensors do in drives that it was not trained on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from resim.perception.model import PerceptionModel
from resim.perception.parameters import fit_in_words, parameters
from resim.perception.validation import SHARES, Report
from resim.report.document import document
from resim.report.figure import Figure
from resim.report.figure import trace as figure_trace
from resim.report.markup import Markup, html, join
from resim.report.plots import number, sample, style, to_html
from resim.report.tables import NONE, table

MEASURED, MODEL = "#0072B2", "#D55E00"


def write_perception_page(model: PerceptionModel, report: Report, path: Path) -> None:
    """Write the page: one HTML file; the same model and report give the same bytes."""
    key = sample("measured", MEASURED) + sample("model", MODEL)
    body = html(
        "<main>\n"
        '<header><p class="kind">Perception model</p><h1>{name}</h1><p>{provenance}</p></header>\n'
        "<section><h2>On drives that it was not trained on</h2>"
        "<p>{drives} drives in {folds} folds: each fold's errors against those of a model that was "
        "trained on the others. Errors are perceived minus true, latency included. The Wasserstein distance is that "
        "between measured and model; beside it, as a yardstick, that between two halves of the measured drives.</p>"
        '{agreement}<div class="key-here">{key}</div>'
        "<figure><figcaption><b>Distribution of the errors</b></figcaption>{distributions}"
        "</figure><figure><figcaption><b>Autocorrelation of the errors</b></figcaption>"
        "{autocorrelations}</figure>"
        '<figure><figcaption><b>Lengths of drop-outs</b> <span class="note">{detected}</span></figcaption>'
        "{dropouts}</figure>{latencies}</section>\n"
        "{fit}<section><h2>Parameters</h2>{parameters}</section></main>",
        name=model.name,
        provenance=model.provenance,
        drives=report.drives,
        folds=report.folds,
        agreement=_agreement(report),
        key=key,
        distributions=to_html(_distributions(report), "errors"),
        autocorrelations=to_html(_autocorrelations(report), "correlation"),
        detected=_detected(report),
        dropouts=_dropouts(report),
        latencies=_latencies(report),
        fit=_fit(model),
        parameters=_parameters(model),
    )
    path.write_text(document(f"{model.name} · perception model", body), encoding="utf-8", newline="\n")


def _agreement(report: Report) -> Markup:
    rows = []
    for name, a in report.quantities.items():
        cells = [f"{number(pair[0], 4)} | {number(pair[1], 4)}" for pair in (a.mean, a.deviation)]
        yardstick = NONE if a.yardstick is None else number(a.yardstick, 4)
        rows.append([f"{name} [{a.unit}]", str(a.samples), *cells, number(a.wasserstein, 4), yardstick])
    head = ["error", "samples", Markup("mean<br>measured | model"), Markup("standard deviation<br>measured | model"),
            Markup("Wasserstein<br>distance"), "yardstick"]  # fmt: skip
    return table(head, rows, "sums")


Curve = tuple[Sequence[float], Sequence[float]]


def _distributions(report: Report) -> Figure:
    """Draw quantiles of both, as distribution functions."""
    share = [100.0 * s for s in SHARES]
    curves = {
        f"{name} [{a.unit}]": ((a.quantiles_measured, share), (a.quantiles_model, share))
        for name, a in report.quantities.items()
    }
    figure = _panels(curves, "%{y:.0f} % are under %{x:.3g}", 300.0)
    figure.update_yaxes(title_text="share [%]", col=1)
    return figure


def _autocorrelations(report: Report) -> Figure:
    """Draw the correlation of errors a lag apart, of both."""

    def known(values: Sequence[float | None]) -> Curve:
        pairs = [(lag, v) for lag, v in zip(report.lags, values, strict=True) if v is not None]
        return [lag for lag, _ in pairs], [v for _, v in pairs]

    curves = {
        f"{name}: lag [s]": (known(a.autocorrelation_measured), known(a.autocorrelation_model))
        for name, a in report.quantities.items()
    }
    figure = _panels(curves, "%{x:.1f} s: %{y:.2f}", 280.0, mode="lines+markers")
    figure.update_xaxes(rangemode="tozero")
    figure.update_yaxes(title_text="correlation", range=[-0.8, 1.05], col=1)
    return figure


def _panels(
    curves: Mapping[str, tuple[Curve, Curve]], hover: str, height: float, mode: str = "lines"
) -> Figure:
    """Draw a panel for each title on its x axis, with the measured curve and the model's."""
    figure = Figure.of_panels(rows=1, cols=len(curves), shared_yaxes=True, horizontal_spacing=0.03)
    for column, (title, both) in enumerate(curves.items(), start=1):
        for (x, y), color, who in zip(both, (MEASURED, MODEL), ("measured", "model"), strict=True):
            trace = figure_trace("scatter",
                x=list(x), y=list(y), mode=mode, name=who, line={"color": color, "width": 2}, marker={"size": 6},
                hovertemplate=hover,
            )  # fmt: skip
            figure.add_trace(trace, row=1, col=column)
        figure.update_xaxes(title_text=title, row=1, col=column)
    return style(figure, height, margin={"l": 62, "r": 14, "t": 10, "b": 46})


def _dropouts(report: Report) -> Markup:
    """The figure of the drop-outs, or words where there is none."""
    if not report.dropouts_measured and not report.dropouts_model:
        return Markup(
            '<p id="dropouts">There are no drop-outs: nothing was lost, measured or in the model.</p>'
        )
    return to_html(_dropout_figure(report), "dropouts")


def _dropout_figure(report: Report) -> Figure:
    figure = Figure()
    both = ((report.dropouts_measured, MEASURED, "measured"), (report.dropouts_model, MODEL, "model"))
    for values, color, who in both:
        lengths = np.sort(np.array(values, dtype=float))
        share = 100.0 * np.arange(1, len(lengths) + 1) / max(len(lengths), 1)
        figure.add_trace(
            figure_trace("scatter",
                x=lengths, y=share, mode="lines", line={"color": color, "width": 2, "shape": "hv"}, name=who,
                hovertemplate="%{y:.0f} % last up to %{x:.2f} s",
            )
        )  # fmt: skip
    style(figure, 240.0, margin={"l": 62, "r": 14, "t": 10, "b": 46})
    figure.update_xaxes(title_text="length [s]", rangemode="tozero")
    figure.update_yaxes(title_text="share [%]", range=[0.0, 103.0])
    return figure


def _detected(report: Report) -> str:
    measured, model = (f"{100.0 * share:.1f} %" for share in report.detected)
    return (
        f"objects are detected {measured} of the time, in the model {model}; {len(report.dropouts_measured)} "
        f"drop-outs, in the model {len(report.dropouts_model)} (over its seeds)"
    )


def _latencies(report: Report) -> Markup:
    rows = [[name, *(f"{v:.3f} s" for v in values)] for name, values in report.latencies.items()]
    folds = max((len(values) for values in report.latencies.values()), default=0)
    head = ["latency", *(f"fold {n}" for n in range(1, 1 + folds))]
    return Markup("<h3>Latencies, trained without each fold</h3>") + table(head, rows, "sums")


def _fit(model: PerceptionModel) -> Markup:
    """Which assumptions fail, what it costs, and what was left out of the training."""
    if model.training is None:
        return Markup()
    verdict, misfits = fit_in_words(model.training)
    items = join(html("<li>{}</li>", text) for text in misfits)
    rows = [[part.what, f"{part.count} of {part.of}", part.reason] for part in model.training.left_out]
    dropped = (
        table(["left out", "count", "reason"], rows, "sums")
        if rows
        else Markup("<p>Nothing was left out.</p>")
    )
    return html(
        '<section id="fit"><h2>Does the model fit?</h2><p>{}.</p>{}'
        "<p>Tested is what is left of the errors of the training: tails, independence in time and between objects, "
        "one latency for all, and whether errors or their spread depend on what the model leaves out. For a model that "
        "fits, the probability that any test fails is 5 %.</p>{}</section>\n",
        verdict,
        html("<ul>{}</ul>", items) if items else "",
        dropped,
    )


def _parameters(model: PerceptionModel) -> Markup:
    known = model.training.estimates if model.training is not None else {}
    rows = []
    for name, value, unit in parameters(model):
        found = known.get(name)
        span = NONE if found is None else f"{found.low:.4g} to {found.high:.4g}"
        samples = NONE if found is None else str(found.samples)
        rows.append([name, f"{value:.4g}", unit, span, samples])
    return table(["parameter", "value", "unit", "95 % interval", "samples"], rows, "sums")
