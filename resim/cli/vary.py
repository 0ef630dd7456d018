"""`resim vary`: neighbours of a measured drive, and the kernels that they are made with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import Accept, Workers, command, vary_app
from resim.cli.inputs import A_RECORDING
from resim.cli.progress import ProgressReporter
from resim.cli.terminal import add_to_json, say
from resim.core.errors import InputError
from resim.core.spelling import counted

if TYPE_CHECKING:
    from resim.variations.kernels import KernelFile
    from resim.variations.report import VariationReport


Objects = Annotated[
    list[str] | None,
    typer.Option(
        "--object", metavar="ID",
        help="Object to vary; may be given several times. Default: the most critical one, as of `resim verify --vary`.",
    ),
]  # fmt: skip
Maneuvers = Annotated[
    list[str] | None,
    typer.Option(
        "--maneuver", metavar="LABEL",
        help="Only its maneuvers of this label, such as lane_change_right; may be given several times. Default: all "
        "that there is a kernel of.",
    ),
]  # fmt: skip
Box = Annotated[
    float | None,
    typer.Option(
        help="Share of each component's range by which it is varied to either side, such as 0.005; takes the place of "
        "the settings'.", show_default=False,
    ),
]  # fmt: skip
SettingsFile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Box, types of vehicles, weathers and limits (TOML).", show_default=False
    ),
]
Verified = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="verification.json of `resim verify --vary`, by which trust is judged.",
        show_default=False,
    ),
]  # fmt: skip


@command(vary_app, "drive")
def vary(
    recording: Annotated[
        Path, typer.Argument(metavar="RECORDING", callback=A_RECORDING, help="Recording folder.")
    ],
    kernels: Annotated[Path, typer.Option(help="Kernels (JSON) of `resim vary train`.")],
    out: Annotated[Path, typer.Option(help="Folder for the variations.")],
    count: Annotated[
        int, typer.Option(min=1, help="How many; the first ones are the same for any count.")
    ] = 100,
    objects: Objects = None,
    maneuvers: Maneuvers = None,
    box: Box = None,
    settings: SettingsFile = None,
    verified: Verified = None,
    overlap: Annotated[bool, typer.Option("--overlap", help="Let varied objects overlap others.")] = False,
    rows: Annotated[bool, typer.Option("--rows", help="Write the tables alone, no scenarios.")] = False,
    workers: Workers = None,
    accept: Accept = None,
) -> None:
    """Make variations of a drive that a human could have driven, near what was measured.

    Writes variations.parquet, rejected.parquet, scenarios/ with a JSCEN file each, and variations.html.
    """
    from resim.jobs import vary as job
    from resim.variations.settings import VariationSettings, WhatVaries, read_variation_settings
    from resim.variations.swept import WIDEST

    if box is not None and not 0.0 < box <= WIDEST:
        raise InputError("--box", f"expected a share above 0, up to {WIDEST:g}, found {box:g}")
    told = VariationSettings() if settings is None else read_variation_settings(settings)
    given = ({} if box is None else {"box": box}) | ({"overlap": True} if overlap else {})
    told = VariationSettings.model_validate({**told.model_dump(), **given})
    what = WhatVaries(tuple(objects or ()), tuple(maneuvers or ()), tuple(accept or ()))
    options = job.VaryOptions(what, told, verified, not rows, workers)
    with ProgressReporter("variations", count) as progress:
        made = job.vary(
            recording, kernels, out, count=count, options=options,
            progress=lambda kept: progress.step("", by=kept - progress.done),
        )  # fmt: skip
    _tell(made.report, out)


def _tell(report: VariationReport, out: Path) -> None:
    """Print what was made."""
    add_to_json(
        out=out, variations=report.variations, looked=report.looked, rejected=dict(report.rejected),
        trust=dict(report.trust), notes=list(report.notes),
    )  # fmt: skip
    say(f"varied: {', '.join(report.inputs.maneuvers)}")
    for note in report.notes:
        say(f"note: {note}")
    rejected = "; ".join(f"{n} {why}" for why, n in report.rejected.items())
    counts = f"{counted(report.variations, 'variation')} of {counted(report.looked, 'point')}"
    say(f"{counts}{f', rejected: {rejected}' if rejected else ''}")
    say(f"trust: {', '.join(f'{n} {level}' for level, n in report.trust.items())}")
    say(f"{out}: variations.html, variations.parquet")


@command(vary_app, "train")
def train(
    mined: Annotated[Path, typer.Argument(help="Folder that `resim mine` wrote.")],
    out: Annotated[Path, typer.Option(help="File (JSON) for the kernels.")],
    report: Annotated[
        Path | None, typer.Option(help="Page (HTML) of how good they are.", show_default=False)
    ] = None,
    error: Annotated[
        float | None,
        typer.Option(
            help="Take as few components as reconstruct the traces to this mean relative error, such as 0.001; "
            "default: 20 components.", show_default=False,
        ),
    ] = None,
    least: Annotated[int, typer.Option(min=2, help="Traces from which on a maneuver gets a kernel.")] = 30,
    real: Annotated[
        bool, typer.Option("--real", help="You vouch that people drove; refused for what resim made.")
    ] = False,
) -> None:  # fmt: skip
    """Train maneuver kernels: principal components of the traces of lane changes, of following a lane, ..."""
    from resim.jobs import kernels as job
    from resim.variations.evaluation import not_shown

    options = job.TrainOptions(error=error, least=least, real=real)
    with ProgressReporter("recordings") as progress:
        found = job.train_kernels(mined, out, options, report=report, progress=progress.step)
    missing = {name: told for name, kernel in found.kernels.items() if (told := not_shown(kernel))}
    add_to_json(out=out, report=None if report is None else str(report), data=found.data,
                kernels={name: kernel.traces for name, kernel in found.kernels.items()},
                not_made=dict(found.not_made), not_shown=missing)  # fmt: skip
    _print(found, missing)
    say(f"{out}: from {found.data} drives")
    if report is not None:
        say(f"report: {report}")


def _print(found: KernelFile, missing: Mapping[str, str]) -> None:
    """Print each kernel in a line. missing: what is not shown, by maneuver."""
    for name, one in found.kernels.items():
        error = (
            "" if one.held_out == 0 else f", of those held out {100.0 * one.reconstruction_held_out:.3f} %"
        )
        told = f"; {missing[name]}" if name in missing else ""
        say(f"{name}: {counted(one.traces, 'trace')} and {one.held_out} held out, "
            f"{counted(one.count, 'component')}, error {100.0 * one.reconstruction:.3f} %{error}{told}")  # fmt: skip
    for name, why in found.not_made.items():
        say(f"{name}: no kernel: {why}")
