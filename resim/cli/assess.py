"""`resim assess`: how dangerous was each moment of a drive, and because of which object."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from resim.cli.app import Accept, BadVerdictError, Deciding, assess_app, command
from resim.cli.inputs import A_DRIVE, CriteriaFile
from resim.cli.runs import register
from resim.cli.terminal import OutputSettings, add_to_json, output_as, output_settings, say, show
from resim.core.errors import FunctionError, InputError

if TYPE_CHECKING:
    from resim.core.plugins.frozen import FrozenFile


PRELOADED = ("resim.cli.verdicts", "resim.jobs.assess", "resim.resimulation.run")
"""What a child imports when it works, and has before it starts."""


class ModeChoice(StrEnum):
    """How the accident risk is computed."""

    continuous = "continuous"
    published = "published"


class PathChoice(StrEnum):
    """What the EGO is taken to do next."""

    plan = "plan"
    state = "state"
    driven = "driven"


@command(assess_app, "drive", epilog="Also: resim assess fit-prediction --help")
def assess(
    drive: Annotated[
        Path, typer.Argument(callback=A_DRIVE, help="Recording folder, or the folder that `resim run` wrote.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for assessment.json, kpis.parquet (read by DuckDB: docs/formats/results.md) and a page; "
            "an earlier one there is replaced."
        ),
    ] = None,
    criteria: CriteriaFile = None,
    mode: Annotated[
        ModeChoice, typer.Option(help="Accident risk: misses no contact, or computed as published.")
    ] = ModeChoice.continuous,
    path: Annotated[
        PathChoice,
        typer.Option(
            help="The EGO's predicted path: its plan (or, without one, its state), its state, or the path it drove."
        ),
    ] = PathChoice.plan,
    prediction: Annotated[
        str,
        typer.Option(
            metavar="SET|FILE",
            help="Motion prediction of objects: a set that ships with resim, or a file from fit-prediction.",
        ),
    ] = "published",
    road_aware: Annotated[
        bool,
        typer.Option("--road-aware", help="Predict objects along their lanes, and no object off the road."),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the samples.")] = 0,
    accept: Accept = None,
    verdict_of: Deciding = None,
) -> None:
    """Compute criticality measures and the accident risk of a drive, ten times a second, and judge it by criteria.

    Ends with 1 where a criterion fails, or cannot be judged: in what was simulated, of a recording in GT or SD, or in
    what --verdict-of says. Ends with 3 where the function failed.
    """
    from resim.core.plugins.frozen import files_of
    from resim.execution.workers import in_child
    from resim.results import ASSESSMENT, whole_folder

    _refuse_to_replace(out, drive, criteria, Path(prediction))
    _refuse_without_effect(drive, accept, road_aware and mode is ModeChoice.published)
    asked = _AssessOptions(
        drive, None if criteria is None else in_child(_frozen, criteria), mode, path, prediction, road_aware, seed,
        tuple(accept or ()), deciding(verdict_of, criteria), out, sys.stdout.isatty(), output_settings(),
    )  # fmt: skip
    with (
        contextlib.nullcontext()
        if out is None
        else whole_folder(out, ASSESSMENT, files_of(asked.criteria)) as folder
    ):
        done = in_child(_assess, (asked, folder))
    done.tell("assessment", out)
    add_to_json(out=out, assessment=done.document, problem=done.bad)
    done.end()


def _refuse_to_replace(out: Path | None, *inputs: Path | None) -> None:
    """Raise InputError for a folder that must not be replaced, or in which an input lies."""
    from resim.results import ASSESSMENT, check_output

    if out is not None:
        check_output(out, ASSESSMENT, [one for one in inputs if one is not None])


def _refuse_without_effect(drive: Path, accept: Sequence[str] | None, road_unused: bool) -> None:
    """Raise InputError for what would have no effect."""
    if accept and (drive / "run.json").is_file():
        problem = f"{accept[0]} has no effect on a run, of which `resim run` has accepted the findings"
        raise InputError("--accept", problem, "Leave it out.")
    if road_unused:
        raise InputError(
            "--road-aware", "the published mode does not use the road", "Leave out one of the two."
        )


@dataclass(frozen=True)
class _AssessOptions:
    """What the user asks for, as on the command line. terminal: whether a terminal shows what is printed; how: it is
    told.
    """

    drive: Path
    criteria: FrozenFile | None
    mode: ModeChoice
    path: PathChoice
    prediction: str
    road_aware: bool
    seed: int
    accept: tuple[str, ...]
    verdict_of: tuple[str, ...]
    out: Path | None
    terminal: bool
    how: OutputSettings


@dataclass(frozen=True)
class ChildReport:
    """What a child process did: what to print, why it is bad ("" where it is not), and whether the function failed.

    document: what `--json` prints, if it is not in a file.
    """

    text: str
    bad: str
    failed: bool
    document: dict[str, Any] | None = None

    def tell(self, name: str, out: Path | None) -> None:
        """Print it, name the page in the folder of results, if there is one, and put these into the catalog."""
        show(self.text)
        if out is not None:
            say("")
            say(f"{name}: {out / name}.html")
            register(out)

    def end(self) -> None:
        """Leave with the exit code of what was done, and say why."""
        if self.bad:
            raise (FunctionError if self.failed else BadVerdictError)(self.bad)


def _assess(task: tuple[_AssessOptions, Path | None]) -> ChildReport:
    """Do what is asked for in a child process, and write the results into the folder, if there is one."""
    from resim.cli.verdicts import captured, print_findings, print_notes, print_verdicts, print_worst
    from resim.jobs.assess import assess
    from resim.jobs.given import the_criteria
    from resim.metrics.risk import RiskParameters
    from resim.metrics.risk.prediction import named_prediction
    from resim.resimulation import AssessmentOptions
    from resim.results import assessment_document

    a, folder = task
    how = AssessmentOptions(
        parameters=RiskParameters(mode=a.mode.value, seed=a.seed), path=a.path.value,
        prediction=named_prediction(a.prediction), road_aware=a.road_aware, criteria=the_criteria(a.criteria),
        decides=a.verdict_of or None,
    )  # fmt: skip
    result = assess(a.drive, how, accept=a.accept)
    found = result.assessment
    if folder is not None and a.out is not None:
        result.write_files(folder, a.out)
    with output_as(a.how), captured(a.terminal) as screen:
        print_worst(found)
        print_findings(found)
        print_verdicts(found)
        print_notes(found)
    document = assessment_document(found, a.drive) if a.how.json else None
    return ChildReport(screen.getvalue(), result.problem, bool(found.failures), document)


def deciding(sources: Sequence[str] | None, criteria: Path | None) -> tuple[str, ...]:
    """Give the sources that the user wants the verdict of. Raises InputError where nothing is judged."""
    if sources and criteria is None:
        raise InputError("--verdict-of", f"{sources[0]} without criteria has no effect", "Give --criteria.")
    return tuple(map(str, sources or ()))


def _frozen(criteria: Path) -> FrozenFile:
    """Freeze the criteria, in a child process, which has loaded what it takes."""
    from resim.metrics.criteria import freeze_criteria

    return freeze_criteria(criteria)
