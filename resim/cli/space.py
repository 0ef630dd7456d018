"""`resim space`: which kinds of scenario there are, how much of them was seen, and how risky they are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import app, command
from resim.cli.terminal import add_to_json, say
from resim.core.spelling import counted

if TYPE_CHECKING:
    from resim.jobs.space import SpaceResult
    from resim.space.report import CoverageEntry

space_app = typer.Typer(rich_markup_mode=None, no_args_is_help=True)
app.add_typer(
    space_app, name="space", help="The scenario space: kinds of scenarios, coverage, risk, release."
)

Workers = Annotated[int | None, typer.Option(min=1, help="Threads; default: all cores.", show_default=False)]


@command(space_app, "build")
def build(
    mined: Annotated[list[Path], typer.Argument(help="Folders that `resim mine` wrote.")],
    out: Annotated[Path, typer.Option(help="Folder to write; an earlier space there is replaced.")],
    settings: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Distance, linkage, threshold, buckets (TOML); default: as published."
        ),
    ] = None,
    workers: Workers = None,
) -> None:
    """Build a space: distances between scenarios, clusters in each bucket, and how much was seen.

    Writes space.json, clusters.parquet, distances.parquet, scenarios.parquet, slots.parquet and space.html.
    """
    from resim.jobs import space as job

    how = job.DEFAULT_SETTINGS if settings is None else job.read_space_settings(settings)
    _tell(job.build(mined, out, how, workers=workers))


@command(space_app, "grow")
def grow(
    space: Annotated[Path, typer.Argument(help="Folder of the space.")],
    mined: Annotated[list[Path], typer.Argument(help="Folders that `resim mine` wrote of new drives.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder to write; default: the space's own.", show_default=False)
    ] = None,
    workers: Workers = None,
) -> None:
    """Put new drives into a space: what is new, how kinds grow, and whether anything new still comes.

    Clusters keep their names, members and test cases; the order in which drives come does not matter.
    """
    from resim.jobs import space as job

    before = job.read_result(space).report
    grown = job.grow(space, mined, out, workers=workers)
    known = before.clusters()
    new = [name for name in grown.report.clusters() if name not in known]
    say(
        f"{counted(grown.report.scenarios - before.scenarios, 'new scenario')}, "
        f"{counted(len(new), 'cluster')} that the space did not have"
    )
    add_to_json(new_clusters=new)
    _tell(grown)


def _tell(found: SpaceResult) -> None:
    told = found.report
    clusters = told.clusters()
    say(
        f"{counted(told.scenarios, 'scenario')} in {counted(len(told.buckets), 'bucket')}: "
        f"{counted(len(clusters), 'cluster')}, {sum(one.members == 1 for one in clusters.values())} with one member"
    )
    _tell_coverage(told.coverage)
    for note in told.notes:
        say(f"note: {note}")
    say(f"{found.folder}: space.html, space.json, clusters.parquet, distances.parquet")
    add_to_json(
        scenarios=told.scenarios, buckets=len(told.buckets), clusters=len(clusters), coverage=told.coverage,
        notes=told.notes,
    )  # fmt: skip


def _tell_coverage(found: CoverageEntry) -> None:
    from resim.space.page.words import number, percent

    state = found.convergence
    say(f"the next scenario is of a kind not seen with {percent(state.unseen)} (95 %)")
    say(f"kinds: {found.kinds.seen} seen, {number(found.kinds.at_least)} at least (Chao's lower bound)")
    if state.converged:
        say("discovery and expansion have stopped")
    else:
        say(
            f"not converged: at least {number(state.missing)} more scenarios, {number(state.missing_hours)} h"
        )
