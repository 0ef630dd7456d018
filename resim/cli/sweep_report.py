"""`resim sweep report` and `resim sweep repeat`: what a sweep found, and one of its runs again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from resim.cli.app import BadVerdictError, command, sweep_app, vehicle_option
from resim.cli.inputs import A_SWEPT
from resim.cli.runs import register
from resim.cli.terminal import add_to_json, say


@command(sweep_app, "report")
def report(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", callback=A_SWEPT, help="Folder of a finished sweep.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Page to write (HTML), with a JSON file beside it; default: DIR/report.html."),
    ] = None,
) -> None:
    """Say what a sweep found: requirements, boundaries, sensitivity, responses, and the worst runs.

    Writes a page and, with all numbers, a JSON file of the same name.
    """
    from pydantic import MISSING

    from resim.core.spec import to_json
    from resim.jobs.sweep import report_sweep
    from resim.sweeps.page import boundary_lines, demanded_of, engine_line, overview_line, requirement_lines
    from resim.sweeps.report import traffic_notes, variation_notes

    page = folder / "report.html" if out is None else out
    found = report_sweep(folder, page)
    add_to_json(page=page, report=to_json(found))
    say(f"engine: {engine_line(found)}")
    for note in (*found.unpinned, *traffic_notes(found), *variation_notes(found)):
        say(f"note: {note}")
    for section in found.sections:
        say(f"{section.recording}, {section.build}: {overview_line(section)}")
        told = (
            requirement_lines(section, found.parameters, demanded_of(found), variation_notes(found))
            if section.boundary is MISSING
            else boundary_lines(section.boundary, found.parameters)
        )
        for what, lines in told:
            say(f"  {what}")
            for line in lines:
                say(f"    {line}")
    say("")
    say(f"report: {page}")


@command(sweep_app, "repeat")
def repeat_run(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", callback=A_SWEPT, help="Folder of a finished sweep.")
    ],
    run: Annotated[int, typer.Argument(min=0, help="Number of the run, as in the report and the table.")],
    out: Annotated[
        Path, typer.Option(help="Folder for its traces and report; an earlier result there is replaced.")
    ],
    vehicle: Annotated[str | None, vehicle_option("Vehicle model of the EGO; default: the sweep's.")] = None,
) -> None:
    """Do one run of a sweep again, compare it with its row in the table, and write the same files as `resim run`.

    Ends with 1 where the run is not the same as in the sweep.
    """
    from resim.jobs.sweep import repeat

    found = repeat(folder, run, out, vehicle=vehicle)
    add_to_json(out=out, untraced=found.untraced, versions=found.versions,
         differ={name: {"sweep": was, "now": now} for name, (was, now) in found.differ.items()})  # fmt: skip
    say(f"no traces: {found.untraced}" if found.untraced else f"report: {out / 'report.html'}")
    if not found.untraced:
        register(out)
    if found.differ:
        differ = found.differ.items()
        told = "; ".join(f"{name} {was!r} in the sweep, now {now!r}" for name, (was, now) in differ)
        changed = "".join(f"; {version}" for version in found.versions)
        raise BadVerdictError(f"run {run} differs from the sweep: {told}{changed}")
    say(f"run {run}: the same as in the sweep")
