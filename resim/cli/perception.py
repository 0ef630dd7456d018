"""`resim perception`: learn what the vehicle sees from drives that were measured twice, and show it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import Accept, Settings, app, command
from resim.cli.inputs import A_MODEL, A_RECORDING
from resim.cli.progress import ProgressReporter
from resim.cli.terminal import add_to_json, say

if TYPE_CHECKING:
    from resim.perception.model import PerceptionModel, Training

perception_app = typer.Typer(rich_markup_mode=None, no_args_is_help=True)
app.add_typer(
    perception_app, name="perception", help="Perception models: train them, and show their parameters."
)


@command(perception_app, "train")
def train(
    recordings: Annotated[
        list[Path], typer.Argument(callback=A_RECORDING, help="Recording folders with GT and SD.")
    ],
    out: Annotated[Path, typer.Option(help="Model file (JSON) to write; the model takes its name.")],
    report: Annotated[
        Path | None,
        typer.Option(help="Page (HTML) that validates the model on drives it was not trained on."),
    ] = None,
    accept: Accept = None,
) -> None:
    """Learn a perception model: latencies, biases, noise, detection, each with its confidence interval."""
    from resim.jobs import train as job
    from resim.perception.validation import FOLDS

    folds = 0 if report is None else min(FOLDS, len(recordings))
    with ProgressReporter("stages", len(recordings) + 1 + folds) as progress:
        model = job.train(recordings, out, report=report, accept=accept or [], progress=progress.step)
    add_to_json(model=out, report=None if report is None else str(report))
    print_model(model)
    say("")
    say(f"model: {out}")
    if report is not None:
        say(f"report: {report}")


@command(perception_app, "show")
def show(
    model: Annotated[Path, typer.Argument(callback=A_MODEL, help="Perception model (JSON).")],
    settings: Settings = None,
) -> None:
    """Show a perception model: its parameters, and how sure they are."""
    from resim.perception.model import read_model

    found = read_model(model, tuple(settings or ()))
    add_to_json(model=found.model_dump(mode="json"))
    print_model(found)


def print_model(model: PerceptionModel) -> None:
    """Print the parameters that do something, with their confidence intervals where they were learned."""
    from rich.table import Table

    from resim.cli.verdicts import console
    from resim.perception.parameters import parameters

    known = model.training.estimates if model.training is not None else {}
    table = Table(title=f"{model.name}: parameters")
    for column in ("parameter", "value", "unit", "95 % interval", "samples"):
        table.add_column(column, justify="right" if column in ("value", "samples") else "left")
    for name, value, unit in parameters(model):
        found = known.get(name)
        span = "" if found is None else f"{found.low:.4g} to {found.high:.4g}"
        table.add_row(name, f"{value:.4g}", unit, span, "" if found is None else str(found.samples))
    console().print(table)
    if model.provenance:
        say(model.provenance)
    spans = {name: span for name, span in model.validity.model_dump().items() if span is not None}
    if spans:
        told = (f"{name.replace('_', ' ')} {low:.4g} to {high:.4g}" for name, (low, high) in spans.items())
        say(f"valid for {', '.join(told)}")
    if model.training is not None:
        _print_fit(model.training)


def _print_fit(training: Training) -> None:
    """Say whether the model fits what it was trained on, and what was left out."""
    from resim.perception.parameters import fit_in_words

    verdict, misfits = fit_in_words(training)
    say(verdict)
    for text in misfits:
        say(f"warning: {text}")
    for part in training.left_out:
        say(f"left out: {part.count} of {part.of} {part.what}: {part.reason}")
