"""`resim runs`: the catalog of results, in which sweeps, builds, recordings and verdicts are found again."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import app, command
from resim.cli.entries import line, print_entry, print_list, summary
from resim.cli.terminal import add_to_json, say
from resim.core.errors import InputError, ResimError

if TYPE_CHECKING:
    from resim.results.catalog import Catalog
    from resim.results.entry import CatalogEntry

runs = typer.Typer(
    help="Past results: find, show, add and remove them in the catalog (RESIM_CATALOG).",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(runs, name="runs")


PRELOADED = ("resim.recordings", "resim.results.catalog", "resim.results.reading")
"""What a child imports when it registers results, and has before it starts."""


class KindChoice(StrEnum):
    """Kinds of results."""

    run = "run"
    assessment = "assessment"
    verification = "verification"
    sweep = "sweep"
    mining = "mining"
    space = "space"


def register(folder: Path) -> None:
    """Put finished results into the user's catalog; where that fails, one line says so and the job stays as it is."""
    from resim.execution.workers import in_fresh_child

    try:
        in_fresh_child(_registered, folder)
    except ResimError as e:
        say(f"resim: warning: the results are complete, but could not be added to the catalog: {e}", err=True)


def _registered(folder: Path) -> None:
    """Put the results in a folder into the catalog, in a child process, which has loaded what it takes."""
    from resim.results.catalog import user_catalog
    from resim.results.reading import clusters_of, read_entry

    if (catalog := user_catalog()) is not None:
        entry = read_entry(folder)
        clusters = clusters_of(entry) if entry.kind == "space" else []
        known = {one.id for one in clusters}
        old = [e for e in catalog.of_folder(entry.folder) if e.kind == "cluster" and e.id not in known]
        catalog.add(entry, *clusters)
        catalog.forget(*old)


@command(runs, "list")
def list_results(
    kind: Annotated[KindChoice | None, typer.Option(help="Results of this kind only.")] = None,
    build: Annotated[
        str | None,
        typer.Option(metavar="TEXT", help="Part of a build's label, or the first digits of its hash."),
    ] = None,
    recording: Annotated[
        str | None,
        typer.Option(metavar="TEXT", help="Part of a recording's name, or the first digits of its hash."),
    ] = None,
    verdict: Annotated[
        str | None,
        typer.Option(
            help="Verdict over all recordings, or of any: PASS, FAIL, INVALID, failed, verified, 'not verified', ..."
        ),
    ] = None,
) -> None:
    """List results, the newest first, and say which folders are missing or have changed."""
    from resim.results.reading import VERDICTS

    if verdict is not None and verdict.lower() not in {v.lower() for v in VERDICTS}:
        raise InputError("--verdict", f"there is no {verdict!r}", f"There are: {', '.join(VERDICTS)}.")
    found = _catalog().find(
        kind=None if kind is None else kind.value, build=build, recording=recording, verdict=verdict
    )
    add_to_json(results=[summary(e) for e in found])
    print_list(found)


@command(runs)
def show(
    result: Annotated[
        str, typer.Argument(metavar="ID|FOLDER", help="Id of the result, or its first four or more digits.")
    ],
) -> None:
    """Show all that the catalog holds of a result: what went in, verdicts, where its files lie."""
    entry = _catalog().get(result)
    add_to_json(**asdict(summary(entry)), inputs=entry.inputs, outcomes=entry.outcomes)
    print_entry(entry)


@command(runs)
def add(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="FOLDER...", help="Folders of results, for example from a cluster."),
    ],
) -> None:
    """Put results that were made elsewhere, or before, into the catalog: all of them, or none."""
    from resim.results.reading import read_entry

    catalog = _catalog()
    entries = [read_entry(folder) for folder in folders]
    for entry in entries:
        catalog.add(entry)
        say(line(entry))


@command(runs)
def rm(
    results: Annotated[list[str], typer.Argument(metavar="ID...", help="Ids or folders.")],
    files: Annotated[
        bool, typer.Option("--files", help="Also delete their folders, if they hold nothing but results.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before folders are deleted.")] = False,
) -> None:
    """Remove results from the catalog; their folders stay, unless --files is given."""
    catalog = _catalog()
    entries = {entry.id: entry for entry in map(catalog.get, results)}.values()
    doomed = [entry for entry in entries if _is_deletable(entry)] if files else []
    if doomed and not yes and not _confirmed(doomed):
        say("nothing was removed")
        return
    for entry in entries:
        if entry in doomed:
            _delete(entry)
        catalog.forget(entry)
        say(f"{'deleted' if entry in doomed else 'forgotten'}: {line(entry)}, {entry.folder}")


def _catalog() -> Catalog:
    from resim.results.catalog import user_catalog
    from resim.results.database import VARIABLE

    if (catalog := user_catalog()) is None:
        raise InputError(VARIABLE, "switches the catalog off", "Unset it, or name a file or database.")
    return catalog


def _is_deletable(entry: CatalogEntry) -> bool:
    """Whether the folder is there to delete. Raises InputError where it is not what the catalog holds."""
    state, remedy = entry.state(), "Leave out --files to forget it only."
    if state == "changed":
        raise InputError(entry.folder, "was overwritten after it was added to the catalog", remedy)
    if state == "elsewhere":
        raise InputError(
            entry.folder, f"is of the machine {entry.host!r}, and cannot be reached from this one", remedy
        )
    return state == "there"


def _confirmed(doomed: list[CatalogEntry]) -> bool:
    for entry in doomed:
        say(f"{line(entry)}, {entry.folder}")
    try:
        return typer.confirm(f"Delete {'these folders' if len(doomed) > 1 else 'this folder'}?")
    except typer.Abort:
        raise InputError("--files", "asks before it deletes, but there was no answer", "Say --yes.") from None


def _delete(entry: CatalogEntry) -> None:
    from resim.results import remove_results
    from resim.results.entry import KINDS

    remove_results(entry.folder, KINDS[entry.kind][1])
