"""`resim assess fit-prediction`: how do objects go on, as recordings have it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import Accept, assess_app, command
from resim.cli.inputs import A_RECORDING
from resim.cli.terminal import add_to_json, say

if TYPE_CHECKING:
    from resim.metrics.risk.fitting import Refit


@command(assess_app, "fit-prediction")
def fit_prediction(
    recordings: Annotated[
        list[Path],
        typer.Argument(callback=A_RECORDING, help="Recording folders; every object of the GT counts."),
    ],
    out: Annotated[Path, typer.Option(help="Parameter file (JSON) to write; the set takes its name.")],
    kind: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND", help="Kind to fit, such as car; may be given several times; default: all."
        ),
    ] = None,
    accept: Accept = None,
) -> None:
    """Refit the prediction of the accident risk to recordings, by maximum likelihood.

    Kinds with under 50 scenes, 1 s apart, keep the published parameters.
    """
    from resim.resimulation.predictions import refit_prediction
    from resim.results import PREDICTION, whole_file, write_json

    with whole_file(out, PREDICTION) as file:
        made = refit_prediction(recordings, name=out.stem, kinds=kind or (), accept=accept or ())
        write_json(made.set.model_dump(mode="json", exclude_unset=True), file)
    for name, fit in made.fits.items():
        _print(name, fit)
    for name, why in made.left.items():
        say(f"{name} keeps the published parameters: {why}")
    add_to_json(prediction=out)
    say("")
    say(f"prediction: {out}")


def _print(kind: str, fit: Refit) -> None:
    from rich.table import Table

    from resim.cli.verdicts import console

    out = console()
    table = Table(title=f"{kind}: {len(fit.points)} points of {fit.objects} objects")
    for column in ("parameter", "published", "refitted", "standard error"):
        table.add_column(column, justify="left" if column == "parameter" else "right")
    for name, error in fit.errors.items():
        told = "not determined" if error is None else f"{error:.2g}"
        table.add_row(name, f"{getattr(fit.old, name):.3g}", f"{getattr(fit.motion, name):.3g}", told)
    table.add_section()
    table.add_row("log-likelihood per point", f"{fit.before:.3f}", f"{fit.after:.3f}", "")
    table.add_row("within 3 sigma", f"{100.0 * fit.within_before:.1f} %", f"{100.0 * fit.within:.1f} %", "")
    out.print(table)
    table = Table(title=f"{kind}: the data against the refitted surface, by initial value")
    for column in ("answer", "from", "to", "points", "mean", "its surface", "spread", "its surface"):
        table.add_column(column, justify="left" if column == "answer" else "right")
    for b in fit.bins:
        numbers = (b.mean, b.mean_fitted, b.spread, b.spread_fitted)
        table.add_row(b.what, f"{b.low:.3f}", f"{b.high:.3f}", str(b.points), *(f"{x:.3f}" for x in numbers))
    out.print(table)
