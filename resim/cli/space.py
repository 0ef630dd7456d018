"""`resim space`: which kinds of scenario there are, how much of them was seen, and how risky they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import app, command
from resim.cli.progress import ProgressReporter
from resim.cli.runs import register
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

    Writes space.json, clusters.parquet, distances.parquet, scenarios.parquet, slots.parquet, moments.parquet and
    space.html.
    """
    from resim.jobs import space as job
    from resim.space.settings import DEFAULT_SETTINGS

    how = DEFAULT_SETTINGS if settings is None else job.read_space_settings(settings)
    with _progress() as done:
        built = job.build(mined, out, how, workers=workers, done=done)
    _tell(built)
    register(built.folder)


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
    with _progress() as done:
        grown = job.grow(space, mined, out, workers=workers, done=done)
    known = before.clusters()
    new = [name for name in grown.report.clusters() if name not in known]
    say(
        f"{counted(grown.report.scenarios - before.scenarios, 'new scenario')}, "
        f"{counted(len(new), 'cluster')} that the space did not have"
    )
    add_to_json(new_clusters=new)
    _tell(grown)
    register(grown.folder)


@contextmanager
def _progress() -> Iterator[Callable[[str, int, int], None]]:
    """Counts scenarios, bucket by bucket."""
    with ProgressReporter("scenarios") as progress:
        yield lambda bucket, scenarios, clusters: progress.step(
            f"{bucket}: {counted(clusters, 'cluster')}", by=scenarios
        )


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
        say(f"not converged: about {number(state.missing)} more scenarios, {number(state.missing_hours)} h")


@command(space_app, "cover")
def cover(
    space: Annotated[Path, typer.Argument(help="Folder of the space.")],
    sweep: Annotated[
        list[Path],
        typer.Option(
            "--sweep", metavar="FOLDER",
            help="Folder of `resim sweep` or `resim verify` with simulated drives; may be given several times.",
        ),
    ],
    held_out: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FOLDER",
            help="Other simulated drives, whose collisions calibrate predicted risk; may be given several times.",
        ),
    ] = None,
    within: Annotated[
        float | None,
        typer.Option(
            min=0.0, help="Slot distance to a verified test drive up to which a member counts; default: the threshold.",
            show_default=False,
        ),
    ] = None,
) -> None:  # fmt: skip
    """Fill a space with simulated drives, and rate the risk of each cluster.

    A simulated member counts where a test drive near it is verified for its build and perception. Writes cover.json,
    members.parquet and cover.html into the space's folder.
    """
    from resim.jobs import space as job

    found = job.cover(space, sweep, job.CoverOptions(within, tuple(held_out or ())))
    members = sum(one.counted for one in found.clusters)
    known = sum(bool(one.drives) for one in found.clusters)
    drives = counted(found.drives, "verified test drive")
    say(f"{found.label}: {drives}, {counted(members, 'simulated member')} that count{'s' * (members == 1)}")
    say(f"{known} of {len(found.clusters)} clusters have a member that counts")
    say(f"predicted risk: {'not shown' if found.calibration is None else found.calibration.verdict}")
    for note in found.notes:
        say(f"note: {note}")
    add_to_json(counted=members, clusters_with_members=known, drives=found.drives, notes=found.notes)


@command(space_app, "release")
def release(
    space: Annotated[Path, typer.Argument(help="Folder of the space.")],
    limits: Annotated[Path, typer.Option(metavar="FILE", help="What a release asks for (TOML).")],
    out: Annotated[Path, typer.Option(help="Folder to write: release.json, release.html.")],
) -> None:
    """Decide whether the function may be released; what forbids it, and what to test next.

    Ends with 0 only where all limits are met with their confidence; `bad` and `not shown` end with 1.
    """
    from resim.jobs import space as job

    found = job.release(space, limits, out)
    say(f"{found.verdict}: {found.statement}")
    left = found.remaining
    if found.forbidding:
        enough = "within the limits" if left.enough else "not enough either"
        forbid, them = ("forbids", "it") if len(found.forbidding) == 1 else ("forbid", "them")
        many = counted(len(found.forbidding), "cluster")
        say(f"{many} {forbid} it; without {them} {left.clusters} are left: {enough}")
    for one in found.plan[:3]:
        first = f" (first {one.first})" if one.first else ""
        say(
            f"next: {one.task}: at most {one.after:.3g} accidents an hour in place of {one.before:.3g}{first}"
        )
    for note in found.notes:
        say(f"note: {note}")
    say(f"{out}: release.html, release.json")
    add_to_json(verdict=found.verdict, checks=found.checks, forbidding=len(found.forbidding))
    if found.verdict != "good":
        raise typer.Exit(1)


@command(space_app, "compare")
def compare(
    one: Annotated[Path, typer.Argument(help="Folder of a space.")],
    other: Annotated[Path, typer.Argument(help="Folder of another space, built with the same settings.")],
    out: Annotated[Path, typer.Option(help="Folder to write: comparison.json, comparison.html.")],
    workers: Workers = None,
) -> None:
    """Compare two spaces: what is in one only, and how far apart the shares of kinds are."""
    from resim.jobs import space as job
    from resim.space.page.words import interval, percent

    found = job.compare(one, other, out, workers=workers)
    say(
        f"{counted(found.only_one, 'kind')} only in {found.one}: {percent(found.only_one_share)} of it (95 %)"
    )
    say(f"{counted(found.only_other, 'kind')} only in {found.other}: {percent(found.only_other_share)} of it")
    say(f"apart (total variation): {interval(found.apart)}")
    for note in found.notes:
        say(f"note: {note}")
    say(f"{out}: comparison.html, comparison.json")
    add_to_json(apart=found.apart, only_one=found.only_one, only_other=found.only_other)
