"""`resim run`: one recording, one build."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from resim.cli.app import Accept, Deciding, Settings, Vehicle, app, command
from resim.cli.assess import ChildReport, deciding
from resim.cli.inputs import A_MODEL, BuildFile, CriteriaFile, RecordingFolder
from resim.cli.progress import ProgressReporter
from resim.cli.terminal import OutputSettings, add_to_json, output_as, output_settings
from resim.core.errors import InputError, ResimError

if TYPE_CHECKING:
    from rich.console import Console

    from resim.core.plugins.frozen import FrozenFile
    from resim.resimulation import PerceptionSetup, Resimulation, ResimulationAssessment, ResimulationOptions
    from resim.resimulation.report import PerceptionReport, RunReport
    from resim.simulation.reactive.settings import ReactiveSettings


PRELOADED = ("resim.cli.verdicts", "resim.jobs.resimulate", "resim.resimulation.run")
"""What a child imports when it works, and has before it starts."""


class BasisChoice(StrEnum):
    """Which measurement the scenarios are made of."""

    gt = "gt"
    sd = "sd"
    both = "both"


SEEDS = 20
"""Runs with a perception model, where nobody says how many."""


Traffic = Annotated[
    str,
    typer.Option(
        metavar="HOW", help="How traffic moves: on its measured `traces`, `reactive`, or as a TOML file says."
    ),
]
Seeds = Annotated[
    int | None,
    typer.Option(min=1, max=1000, help="Runs with the perception model; default: 20.", show_default=False),
]
Record = Annotated[
    bool,
    typer.Option("--record", help="Keep what a process is asked and answers, as a build (recorded.toml)."),
]


@command(app)
def run(
    recording: RecordingFolder,
    build: BuildFile,
    out: Annotated[Path, typer.Option(help="Folder for the results; an earlier result there is replaced.")],
    basis: Annotated[
        BasisChoice, typer.Option(help="Re-simulate ground truth, sensor data, or both.")
    ] = BasisChoice.both,
    vehicle: Vehicle = "kinematic",
    step: Annotated[float, typer.Option(min=0.001, help="Simulation step [s], whole milliseconds.")] = 0.04,
    lead_in: Annotated[float, typer.Option(min=0.0, help="Lead-in before the scenario's start [s].")] = 3.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of every random draw.")] = 0,
    traffic: Traffic = "traces",
    stop_at_collision: Annotated[
        bool, typer.Option(help="Whether a collision of the EGO ends the run.")
    ] = True,
    criteria: CriteriaFile = None,
    perception: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL",
            callback=A_MODEL,
            help="Perception model (JSON): also re-simulates GT as perceived by this model.",
        ),
    ] = None,
    settings: Settings = None,
    seeds: Seeds = None,
    accept: Accept = None,
    verdict_of: Deciding = None,
    record: Record = False,
    gui: Annotated[bool, typer.Option("--gui", help="Show the simulation in sumo-gui.")] = False,
) -> None:
    """Re-simulate a recording with a build, report the errors of every step, and assess all of GT, SD, rGT, rSD.

    With --criteria it ends with 1 where one fails or cannot be judged: in rGT or rSD, in any seed of --perception,
    or in what --verdict-of says; measured verdicts are reported only. Ends with 3 where the function failed.
    """
    from resim.core.plugins.frozen import files_of
    from resim.execution.workers import in_child
    from resim.results import check_output, whole_folder
    from resim.simulation.reactive.settings import traffic_of

    named = (recording, build, criteria, perception)
    check_output(out, inputs=[one for one in named if one is not None])
    moves = traffic_of(traffic)
    if seeds is not None and perception is None:
        raise InputError("--seeds", f"{seeds} without a model has no effect", "Name one with --perception.")
    asked = _RunOptions(
        recording, build, basis, vehicle, step, lead_in, seed, moves, stop_at_collision, criteria, perception,
        tuple(settings or ()), seeds or SEEDS, tuple(accept or ()), deciding(verdict_of, criteria), record, gui, out,
        sys.stdout.isatty(), output_settings(),
    )  # fmt: skip
    files = in_child(_frozen, asked)
    with whole_folder(out, inputs=files_of(*files)) as folder, _terminal_restored():
        done = in_child(_resimulate, (asked, files, folder))
        add_to_json(report=folder / "report.json", assessment=folder / "assessment.json")
    done.tell("report", out)
    add_to_json(out=out, problem=done.bad)
    done.end()


@contextlib.contextmanager
def _terminal_restored() -> Iterator[None]:
    """Take away the bar of a child process that was killed, and show the cursor that it hides."""
    try:
        yield
    finally:
        if sys.stderr.isatty():
            sys.stderr.write("\r\x1b[2K\x1b[?25h")
            sys.stderr.flush()


@dataclass(frozen=True)
class _RunOptions:
    """What the user asks for, as on the command line. terminal: whether a terminal shows what is printed; how: it is
    told.
    """

    recording: Path
    build: Path
    basis: BasisChoice
    vehicle: str
    step: float
    lead_in: float
    seed: int
    traffic: ReactiveSettings | None
    stop_at_collision: bool
    criteria: Path | None
    perception: Path | None
    settings: tuple[str, ...]
    seeds: int
    accept: tuple[str, ...]
    verdict_of: tuple[str, ...]
    record: bool
    gui: bool
    out: Path
    terminal: bool
    how: OutputSettings


class _Files(NamedTuple):
    """Frozen copies of what the user names."""

    build: FrozenFile
    criteria: FrozenFile | None
    perception: FrozenFile | None


def _frozen(asked: _RunOptions) -> _Files:
    """Freeze the files that are asked for, in a child process, which has loaded what it takes."""
    from resim.metrics.criteria import freeze_criteria
    from resim.perception.model import freeze_model
    from resim.simulation.function.interface import freeze_build

    return _Files(
        freeze_build(asked.build),
        None if asked.criteria is None else freeze_criteria(asked.criteria),
        None if asked.perception is None else freeze_model(asked.perception),
    )


def _resimulate(task: tuple[_RunOptions, _Files, Path]) -> ChildReport:
    """Do what is asked for in a child process, and write the results into the folder."""
    from resim.cli.verdicts import captured
    from resim.jobs.given import the_build, the_criteria, the_recording
    from resim.jobs.resimulate import resimulate, stages
    from resim.results import check_output
    from resim.simulation.function.program import refuse_unrecordable

    a, files, folder = task
    options = _options(a)
    build, criteria = the_build(files.build), the_criteria(files.criteria)
    if a.record:
        refuse_unrecordable(build.path, build.program)
    measured = the_recording(a.recording, a.accept)
    check_output(a.out, inputs=(measured.map,))
    if a.basis is BasisChoice.sd and measured.sd is None:
        raise ResimError(
            f"{a.recording}: has no sensor data (sd.csv or sd.parquet), so --basis sd has nothing to run"
        )
    seen = _perceiving(files.perception, a.settings, range(a.seed, a.seed + a.seeds), options.bases)
    each = stages(measured, options, perceiving=seen is not None)
    with output_as(a.how), ProgressReporter("stages", len(each)) as progress:

        def tell(stage: str) -> None:
            progress.step(stage, by=each.index(stage) - progress.done)

        result = resimulate(
            measured,
            build,
            options,
            criteria=criteria,
            perception=seen,
            accept=a.accept,
            verdict_of=a.verdict_of or None,
            progress=tell,
        )
    result.write_files(folder, a.out)
    with output_as(a.how), captured(a.terminal) as screen:
        _print(result.resimulation, result.assessment)
    return ChildReport(screen.getvalue(), result.problem, bool(result.resimulation.failure))


def _options(a: _RunOptions) -> ResimulationOptions:
    from resim.resimulation import Basis, ResimulationOptions

    bases: dict[str, tuple[Basis, ...]] = {"gt": ("GT",), "sd": ("SD",), "both": ("GT", "SD")}
    return ResimulationOptions(
        bases=bases[a.basis.value], vehicle=a.vehicle, step=a.step, lead_in=a.lead_in, seed=a.seed,
        stop_at_collision=a.stop_at_collision, record=a.record, gui=a.gui, traffic=a.traffic,
    )  # fmt: skip


def _print(result: Resimulation, assessed: ResimulationAssessment) -> None:
    from resim.cli.verdicts import print_notes, print_verdicts

    _print_table(result)
    _print_risk(assessed)
    print_verdicts(assessed)
    print_notes(assessed, result.warnings)


def _perceiving(
    frozen: FrozenFile | None, settings: Sequence[str], seeds: range, bases: tuple[str, ...]
) -> PerceptionSetup | None:
    """The perception model that the user asks for, if any."""
    from resim.perception.model import read_model
    from resim.resimulation import PerceptionSetup

    if frozen is None:
        if settings:
            raise InputError("--set", f"{settings[0]!r} without a model", "Name one with --perception.")
        return None
    if "GT" not in bases:
        raise InputError("--perception", "needs the re-simulation of GT", "Leave out --basis sd.")
    return PerceptionSetup(read_model(frozen, tuple(settings)), tuple(seeds), tuple(settings), frozen.hash)


def _print_table(result: Resimulation) -> None:
    from rich.table import Table

    from resim.cli.verdicts import console

    report = result.report
    table = Table(title=f"{result.recording.name}: {result.build.label}, mean ± standard deviation")
    table.add_column("step")
    for who in ("EGO", "TO"):
        for quantity, unit in (("d", "m"), ("Δv", "m/s"), ("Δheading", "rad")):
            table.add_column(f"{who} {quantity} [{unit}]", justify="right")
    for name, errors in report.errors.items():
        cells = [errors[who][q] for who in ("ego", "to") for q in ("d", "v", "heading")]
        if any(cell is not None for cell in cells):
            table.add_row(name, *(_mean_and_std(c) for c in cells))
    out = console()
    out.print(table)
    for base in ("GT", "rGT", "rSD"):
        if (did := report.decision[base]) is not None:
            at = report.reaction[base]
            when = "no braking" if at is None else f"first braking at {at:.2f} s{_later(report, base)}"
            end = report.end.get(base, "")
            out.print(
                f"{base:>4}: {', '.join(did) or 'no decision'}; {when}{f'; ended by {end}' if end else ''}"
            )
    if report.perception is not None:
        _print_perception(report, report.perception, out)
    for warning in report.warnings:
        out.print(f"note: {warning}", highlight=False)


def _later(report: RunReport, base: str) -> str:
    """The difference from the measured first braking, and its spread."""
    off = report.reaction_spread
    if base == "GT":
        return "" if off is None else f" ± {off:.2f} s"
    late = report.reaction_difference[base]
    return "" if late is None or off is None else f" ({late:+.2f} ± {off:.2f} s)"


def _print_perception(report: RunReport, seen: PerceptionReport, out: Console) -> None:
    """How often the runs with the model decide as the measured drive, and how far they are from it."""
    import numpy as np

    seeds, same = seen.seeds, seen.same_decision
    late = [s.reaction_difference for s in seeds if s.reaction_difference is not None]
    off = [s.end_position_error for s in seeds if s.end_position_error is not None]
    told = f"rGT with {seen.model.name}: {same} of {len(seeds)} seeds make the measured decisions"
    told += (
        f"; first braking {np.median(late):+.2f} s against GT (median)" if late else "; no braking to compare"
    )
    told += f"; at the end {np.median(off):.2f} m off" if off else ""
    without = report.end_position_error.get("rGT")
    out.print(told + (f" (without {without:.2f} m)" if without is not None and off else ""), highlight=False)


def _print_risk(found: ResimulationAssessment) -> None:
    from resim.cli.verdicts import console

    peaks = [(name, w) for name, a in found.blocks.items() for w in a.worst() if w.name == "risk"]
    told = (f"{name} {w.value:.3g} at {w.t:.1f} s" for name, w in peaks)
    console().print(f"largest accident risk: {', '.join(told)}", highlight=False)


def _mean_and_std(cell: dict[str, float] | None) -> str:
    return "–" if cell is None else f"{round(cell['mean'], 3) + 0.0:.3f} ± {cell['std']:.3f}"
