"""`resim sweep report` and `resim sweep repeat`: what a sweep found, and one of its runs again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from resim.cli.app import BadVerdictError, sweep_app
from resim.cli.runs import register
from resim.cli.terminal import say

if TYPE_CHECKING:
    from resim.sweeps.runs import RunTask


@sweep_app.command("report")
def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a finished sweep.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Page to write (HTML), with a JSON file beside it; DIR/report.html if not given."),
    ] = None,
) -> None:
    """Say what a sweep found: requirements, boundaries, sensitivity, responses, and the worst runs.

    Writes a page and, with all numbers, a JSON file of the same name.
    """
    from resim.core.errors import InputError
    from resim.core.files import relative
    from resim.execution.workers import in_child
    from resim.results import whole_file, write_json
    from resim.sweeps.page import boundary_lines, overview_line, requirement_lines, write_sweep_page

    page = folder / "report.html" if out is None else out
    if page.suffix.lower() not in (".html", ".htm"):
        raise InputError("--out", f"{str(page)!r} is no page", "Name an .html file.")
    found = in_child(_analysed, (folder, relative(folder, Path.cwd())))
    with whole_file(page) as path:
        write_sweep_page(found, path)
    with whole_file(page.with_suffix(".json"), (".json",)) as path:
        write_json(found, path)
    for section in found["sections"]:
        say(f"{section['recording']}, {section['build']}: {overview_line(section)}")
        told = (
            boundary_lines(section, found["parameters"])
            if "boundary" in section
            else requirement_lines(section, found["parameters"], found["demanded"])
        )
        for what, lines in told:
            say(f"  {what}")
            for line in lines:
                say(f"    {line}")
    say("")
    say(f"report: {page}")


def _analysed(results: tuple[Path, str]) -> dict[str, Any]:
    """Analyse a sweep in a child process, as its criteria bring code: its folder, and that from where commands run."""
    from resim.sweeps.analysis import analyse
    from resim.sweeps.result import read_swept

    return analyse(read_swept(results[0]), results[1])


def _task(run: tuple[Path, int, str | None]) -> RunTask:
    """Look in a child process whether all is there to do a run again."""
    from resim.sweeps.repeat import task_of
    from resim.sweeps.result import read_swept

    return task_of(read_swept(run[0]), run[1], run[2])


@sweep_app.command("repeat")
def repeat_run(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a finished sweep.")],
    run: Annotated[int, typer.Argument(min=0, help="Number of the run, as in the report and the table.")],
    out: Annotated[
        Path, typer.Option(help="Folder for its traces and report; an earlier result there is replaced.")
    ],
    vehicle: Annotated[
        str | None, typer.Option(metavar="MODEL", help="Another vehicle model of the EGO than the sweep's.")
    ] = None,
) -> None:
    """Do one run of a sweep again, compare it with its row in the table, and write what `resim run` writes of it.

    Ends with 1 where the run is not the same as in the sweep.
    """
    from resim.execution.workers import in_child
    from resim.results import check_output
    from resim.sweeps.repeat import other_versions, repeat, write_traces
    from resim.sweeps.result import read_swept

    check_output(out)
    swept = read_swept(folder)
    task = in_child(_task, (folder, run, vehicle))
    differ = repeat(swept, task)
    lost = write_traces(task, out)
    say(f"no traces: {lost}" if lost else f"report: {out / 'report.html'}")
    if not lost:
        register(out)
    if differ:
        told = "; ".join(f"{name} {was!r} in the sweep, now {now!r}" for name, (was, now) in differ.items())
        changed = "".join(f"; {name}" for name in other_versions(swept))
        raise BadVerdictError(f"run {run} is not the same: {told}{changed}")
    say(f"run {run}: the same as in the sweep")
