"""`resim assess`: how dangerous was a drive, when, and because of whom."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import Accept, BadVerdictError, assess_app
from resim.cli.runs import register
from resim.core.errors import InputError

if TYPE_CHECKING:
    from resim.assess.criteria import Criteria
    from resim.pipeline import Assessed

CriteriaFile = Annotated[
    Path | None,
    typer.Option(
        "--criteria",
        metavar="FILE",
        help="Criteria (TOML) to judge by, such as scenarios/criteria/highway.toml.",
    ),
]


class ModeChoice(StrEnum):
    """How the accident risk is computed."""

    continuous = "continuous"
    published = "published"


class PathChoice(StrEnum):
    """What the EGO is taken to do next."""

    plan = "plan"
    state = "state"
    driven = "driven"


@assess_app.command("drive", epilog="Also: resim assess fit-prediction --help")
def assess(
    drive: Annotated[Path, typer.Argument(help="Recording folder, or the folder that `resim run` wrote.")],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for assessment.json, kpis.parquet and a page; an earlier one there is replaced."
        ),
    ] = None,
    criteria: CriteriaFile = None,
    mode: Annotated[
        ModeChoice, typer.Option(help="Accident risk: without missed contact, or as published.")
    ] = ModeChoice.continuous,
    path: Annotated[
        PathChoice,
        typer.Option(help="The EGO's path: its plan (else its state, kept), its state, or where it drove."),
    ] = PathChoice.plan,
    prediction: Annotated[
        str,
        typer.Option(
            metavar="SET|FILE", help="How objects may go on: a set that ships, or a file of fit-prediction."
        ),
    ] = "published",
    road_aware: Annotated[
        bool, typer.Option("--road-aware", help="Predict objects along their lanes, and none off the road.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the samples.")] = 0,
    accept: Accept = None,
) -> None:
    """Compute criticality measures and the accident risk of a drive, ten times a second, and judge it by criteria.

    Ends with 1 where a criterion fails, or cannot be judged.
    """
    from resim.assess.risk import Parameters
    from resim.assess.risk.prediction import named_prediction
    from resim.cli.verdicts import print_notes, print_verdicts, print_worst
    from resim.pipeline import How, assess_folder
    from resim.report import write_assessment_page
    from resim.store import ASSESSMENT, check_output, whole_folder, write_assessment

    if out is not None:
        check_output(out, ASSESSMENT)
    if road_aware and mode is ModeChoice.published:
        raise InputError("--road-aware", "the published mode knows no road", "Leave out one of both.")
    how = How(
        parameters=Parameters(mode=mode.value, seed=seed), path=path.value, prediction=named_prediction(prediction),
        road_aware=road_aware, criteria=wanted(criteria),
    )  # fmt: skip
    found = assess_folder(drive, how, accept or [])
    if out is not None:
        with whole_folder(out, ASSESSMENT) as folder:
            write_assessment(found, folder, drive)
            write_assessment_page(found, folder / "assessment.html")
    print_worst(found)
    print_verdicts(found)
    print_notes(found)
    if out is not None:
        typer.echo(f"\nassessment: {out / 'assessment.html'}")
        register(out)
    refuse_bad(found)


def wanted(path: Path | None) -> Criteria | None:
    """Give the criteria that the user asks for, if any."""
    from resim.assess.criteria import read_criteria

    return None if path is None else read_criteria(path)


def refuse_bad(found: Assessed) -> None:
    """Raise BadVerdictError where a run failed, or a criterion fails or cannot be judged."""
    if found.failures:
        raise BadVerdictError("; ".join(f"{name}: {why}" for name, why in found.failures.items()))
    bad = {name: a.verdict for name, a in found.blocks.items() if a.verdict not in (None, "PASS")}
    if bad and found.criteria is not None:
        told = ", ".join(f"{name} {verdict}" for name, verdict in bad.items())
        raise BadVerdictError(f"{found.name}: does not pass the criteria {found.criteria.name!r}: {told}")
