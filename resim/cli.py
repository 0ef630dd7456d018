"""The command line. Results go to standard output, progress and errors to standard error.

Exit code 0: done; 1: done, and the verdict is bad; 2: the input or the call is wrong.
"""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim import __version__
from resim.core.errors import ResimError

if TYPE_CHECKING:
    from resim.ingest import Recording
    from resim.pipeline import Options, Resimulation
    from resim.sim.adfunction import Build
    from resim.sim.dynamics import VehicleModel

app = typer.Typer(
    help="Put a measured test drive back into simulation, with the same AD function at the wheel, "
    "and see what every step did to it.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
imports = typer.Typer(
    help="Turn a recording of another format into a recording folder.", no_args_is_help=True
)
app.add_typer(imports, name="import")


class BasisChoice(StrEnum):
    """Which measurement the scenarios are made of."""

    gt = "gt"
    sd = "sd"
    both = "both"


class VehicleChoice(StrEnum):
    """Which vehicle model moves the EGO."""

    kinematic = "kinematic"
    single_track = "single-track"


@app.callback(invoke_without_command=True)
def _top(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        typer.echo(f"resim {__version__}")
        raise typer.Exit


@app.command()
def run(
    recording: Annotated[Path, typer.Argument(help="Recording folder (recording.toml, gt, sd).")],
    build: Annotated[Path, typer.Option(help="Build file (TOML) of the AD function.")],
    out: Annotated[Path, typer.Option(help="Folder for the results; an earlier result there is replaced.")],
    basis: Annotated[
        BasisChoice, typer.Option(help="Re-simulate ground truth, sensor data, or both.")
    ] = BasisChoice.both,
    vehicle: Annotated[
        VehicleChoice, typer.Option(help="Vehicle model of the EGO.")
    ] = VehicleChoice.kinematic,
    step: Annotated[float, typer.Option(min=0.001, help="Simulation step [s], whole milliseconds.")] = 0.04,
    relaxation: Annotated[
        float, typer.Option(min=0.0, help="Lead-in before the scenario's start [s].")
    ] = 3.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of every random draw.")] = 0,
    stop_at_collision: Annotated[
        bool, typer.Option(help="Whether a collision of the EGO ends the run.")
    ] = True,
    gui: Annotated[bool, typer.Option("--gui", help="Show the simulation in sumo-gui.")] = False,
) -> None:
    """Re-simulate a recording with a build, and report the errors of every step."""
    from resim.ingest import read_recording
    from resim.pipeline import Basis, Options
    from resim.report import write_report
    from resim.sim.adfunction import load_build
    from resim.sim.dynamics import Kinematic, SingleTrack
    from resim.store import check_output, whole_folder, write_resimulation

    check_output(out)
    measured, pinned = read_recording(recording), load_build(build)
    if basis is BasisChoice.sd and measured.sd is None:
        raise ResimError(
            f"{recording}: has no sensor data (sd.csv or sd.parquet), so --basis sd has nothing to run"
        )
    bases: dict[str, tuple[Basis, ...]] = {"gt": ("GT",), "sd": ("SD",), "both": ("GT", "SD")}
    options = Options(
        bases=bases[basis.value],
        step=step,
        relaxation=relaxation,
        seed=seed,
        stop_at_collision=stop_at_collision,
        gui=gui,
    )
    model = SingleTrack() if vehicle is VehicleChoice.single_track else Kinematic()
    result = _with_progress(measured, pinned, options, model)
    with whole_folder(out) as folder:
        write_resimulation(result, folder)
        write_report(result, folder / "report.html")
    _print_table(result)
    typer.echo(f"\nreport: {out / 'report.html'}")
    if result.failure:
        raise BadVerdictError(result.failure)


class BadVerdictError(Exception):
    """The job is done and its verdict is bad: exit code 1."""


def _with_progress(recording: Recording, build: Build, options: Options, model: VehicleModel) -> Resimulation:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from resim.pipeline import STAGES, resimulate

    bases = [b for b in options.bases if b == "GT" or recording.sd is not None]
    stages = [s for s in STAGES if not s.endswith(("GT", "SD")) or s == "fit GT" or s[-2:] in bases]
    console = Console(stderr=True)
    bar = Progress(
        TextColumn("{task.description:10}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        console=console, transient=True, disable=not console.is_terminal,
    )  # fmt: skip
    with bar:
        task = bar.add_task("start", total=len(stages))

        def tell(stage: str) -> None:
            bar.update(task, description=stage, completed=stages.index(stage))

        return resimulate(recording, build, options, model=model, progress=tell)


def _print_table(result: Resimulation) -> None:
    from rich.console import Console
    from rich.table import Table

    report = result.report()
    table = Table(title=f"{result.recording.name}: {result.build.label}, mean ± standard deviation")
    table.add_column("step")
    for who in ("EGO", "TO"):
        for quantity, unit in (("d", "m"), ("Δv", "m/s"), ("Δheading", "rad")):
            table.add_column(f"{who} {quantity} \\[{unit}]", justify="right")
    for name, errors in report["errors"].items():
        cells = [errors[who][q] for who in ("ego", "to") for q in ("d", "v", "heading")]
        if any(cell is not None for cell in cells):
            table.add_row(name, *(_mean_and_std(c) for c in cells))
    console = Console(width=None if sys.stdout.isatty() else 120)
    console.print(table)
    for base in ("GT", "rGT", "rSD"):
        if (did := report["decision"][base]) is not None:
            at = report["reaction"][base]
            when = "no braking" if at is None else f"first braking at {at:.2f} s"
            end = report["end"].get(base, "")
            console.print(
                f"{base:>4}: {', '.join(did) or 'no decision'}; {when}{f'; ended by {end}' if end else ''}"
            )
    for warning in report["warnings"]:
        console.print(f"note: {warning}", highlight=False)


def _mean_and_std(cell: dict[str, float] | None) -> str:
    return "–" if cell is None else f"{round(cell['mean'], 3) + 0.0:.3f} ± {cell['std']:.3f}"


Map = Annotated[Path, typer.Option("--map", help="OpenDRIVE map of the recording.")]
Ego = Annotated[str, typer.Option(help="Id of the object that becomes the EGO.")]
Start = Annotated[float | None, typer.Option(help="First time [s]; from the EGO's first, if not given.")]
End = Annotated[float | None, typer.Option(help="Last time [s]; to the EGO's last, if not given.")]
Out = Annotated[Path, typer.Option(help="Recording folder to write.")]


@imports.command("highd")
def import_highd(
    tracks: Annotated[
        Path, typer.Argument(help="XX_tracks.csv of highD, exiD, inD or rounD; its meta files beside it.")
    ],
    map_file: Map,
    ego: Ego,
    out: Out,
    start: Start = None,
    end: End = None,
    alignment: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y HEADING", help="Pose of the data's frame in the map [m m rad], if it is another."
        ),
    ] = None,
) -> None:
    """Import from CSV of the highD family (highD, exiD, inD, rounD)."""
    from resim.ingest import Alignment, read_highd

    pose = Alignment(*alignment) if alignment else None
    _write(read_highd(tracks, map=map_file, ego=ego, start=start, end=end, alignment=pose), out)


@imports.command("commonroad")
def import_commonroad(
    scenario: Annotated[Path, typer.Argument(help="CommonRoad scenario, XML of 2018a or 2020a.")],
    map_file: Map,
    ego: Ego,
    out: Out,
    start: Start = None,
    end: End = None,
) -> None:
    """Import from a CommonRoad scenario."""
    from resim.ingest import read_commonroad

    _write(read_commonroad(scenario, map=map_file, ego=ego, start=start, end=end), out)


def _write(recording: Recording, out: Path) -> None:
    from resim.ingest import write_recording
    from resim.road.opendrive import load

    load(recording.map)  # a file that is no OpenDRIVE is told of now, not when the recording is run
    write_recording(recording, out)
    span = recording.gt.t[-1] - recording.gt.t[0]
    typer.echo(f"{out}: {len(recording.gt)} objects over {span:.2f} s, EGO {recording.ego}")


def main() -> None:
    """Run the command line."""
    try:
        app(standalone_mode=True)
    except BadVerdictError as e:
        typer.echo(f"resim: {e}", err=True)
        sys.exit(1)
    except ResimError as e:
        typer.echo(f"resim: {e}", err=True)
        sys.exit(2)
