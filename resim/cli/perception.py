"""`resim perception`: learn what the vehicle sees from drives that were measured twice, and show it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import Accept, app

if TYPE_CHECKING:
    from resim.ingest import Recording
    from resim.perception.model import PerceptionModel

perception_app = typer.Typer(rich_markup_mode=None, no_args_is_help=True)
app.add_typer(
    perception_app, name="perception", help="Perception models: what the vehicle sees of what is there."
)


@perception_app.command("train")
def train(
    recordings: Annotated[list[Path], typer.Argument(help="Recording folders with GT and SD.")],
    out: Annotated[Path, typer.Option(help="File (JSON) for the model; its name names the model.")],
    report: Annotated[
        Path | None,
        typer.Option(help="Page (HTML) of how well it does on drives that it was not trained on."),
    ] = None,
    accept: Accept = None,
) -> None:
    """Learn a perception model: latencies, biases, noise, detection, each with its confidence interval."""
    from resim.perception.model import write_model
    from resim.perception.training.train import train
    from resim.pipeline import examined
    from resim.store import whole_file

    measured = [examined(folder, accept=accept or []) for folder in recordings]
    with whole_file(out, (".json",)) as file:
        model = train(measured, name=out.stem)
        write_model(model, file)
    print_model(model)
    typer.echo(f"\nmodel: {out}")
    if report is not None:
        _validate(measured, model, report)
        typer.echo(f"report: {report}")


@perception_app.command("show")
def show(
    model: Annotated[Path, typer.Argument(help="Perception model (JSON).")],
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="NAME=VALUE", help="A parameter of the model, such as latency.speed=0.4."
        ),
    ] = None,
) -> None:
    """Show a perception model: its parameters, and how sure they are."""
    from resim.perception.model import read_model

    print_model(read_model(model, tuple(settings or ())))


def _validate(measured: list[Recording], model: PerceptionModel, report: Path) -> None:
    from resim.perception.validation import cross_validate
    from resim.report import write_perception_page
    from resim.store import whole_file

    with whole_file(report) as file:
        write_perception_page(model, cross_validate(measured), file)


def print_model(model: PerceptionModel) -> None:
    """Print the parameters that do something, with their confidence intervals where they were learned."""
    from rich.table import Table

    from resim.cli.verdicts import console
    from resim.perception.parameters import parameters

    known = model.training.estimates if model.training is not None else {}
    table = Table(title=f"{model.name}: what is perceived of what is there")
    for column in ("parameter", "value", "unit", "95 % interval", "samples"):
        table.add_column(column, justify="right" if column in ("value", "samples") else "left")
    for name, value, unit in parameters(model):
        found = known.get(name)
        span = "" if found is None else f"{found.low:.4g} to {found.high:.4g}"
        table.add_row(name, f"{value:.4g}", unit, span, "" if found is None else str(found.samples))
    console().print(table)
    if model.provenance:
        typer.echo(model.provenance)
    if model.training is not None:
        typer.echo(
            f"learned from {model.training.drives} drives, {model.training.matched} pairs of perceived and true objects"
        )
