"""`resim lake`: everything found again: recordings, maps, builds, results, and how they belong together."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from resim.cli.app import app, command
from resim.cli.terminal import add_to_json, say, visible
from resim.core.errors import InputError

if TYPE_CHECKING:
    from resim.jobs.lake import LakeLinks
    from resim.results.lake import LakeItem
    from resim.results.scanning import ScanCounts

lake = typer.Typer(
    help="The lake: recordings, maps, builds, results, ... registered, found again and linked by content.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(lake, name="lake")
SHORT = 12
"""Digits of a hash that are shown."""


class SortChoice(StrEnum):
    """What is listed first."""

    written = "written"
    name = "name"
    risk = "risk"


class TableFormat(StrEnum):
    """How a table is printed."""

    table = "table"
    csv = "csv"


def _option(help: str, metavar: str = "TEXT") -> Any:
    return typer.Option(metavar=metavar, help=help)


@command(lake)
def add(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="PATH...", help="Recordings, maps, builds, models, suites, results, or folders of them."
        ),
    ],
) -> None:
    """Register files and folders; nothing is copied. The content says what lies in a folder."""
    from resim.jobs.lake import lake_add

    _told(lake_add(paths, noted=_noted))


@command(lake)
def scan(
    roots: Annotated[
        list[Path] | None,
        typer.Argument(metavar="PATH...", help="Where to look; default: all that is registered."),
    ] = None,
) -> None:
    """Look what is new, changed and gone; a lost index is made again so, and is the same."""
    from resim.jobs.lake import lake_scan

    _told(lake_scan(roots or (), noted=_noted))


@command(lake)
def rm(
    paths: Annotated[list[Path], typer.Argument(metavar="PATH...", help="Registered files and folders.")],
) -> None:
    """Forget registered paths and all that is known below them; the files stay."""
    from resim.jobs.lake import lake_rm

    count = lake_rm(paths)
    add_to_json(forgotten=count)
    say(f"forgotten: {count}")


def _noted(what: str, path: str) -> None:
    say(f"{what}: {visible(path)}", err=True)


def _told(counts: ScanCounts) -> None:
    add_to_json(**asdict(counts))
    for path in counts.absent:
        say(f"resim: warning: {path} is not there; what is known of it stays", err=True)
    say(f"{counts.seen} there: {counts.new} new, {counts.changed} changed; {counts.gone} gone")


@command(lake)
def find(
    text: Annotated[
        str,
        typer.Argument(help="Beginnings of words of name, path or inputs, or the first digits of a hash."),
    ] = "",
    kind: Annotated[
        list[str] | None, _option("Recording, map, build, run, ...; may be given several times.", "KIND")
    ] = None,
    tag: Annotated[str, _option("Beginning of KEY=VALUE in a recording's provenance.")] = "",
    maneuver: Annotated[str, _option("Beginning of a label that was mined in a recording.")] = "",
    place: Annotated[str, _option("Beginning of a map's name or hash.")] = "",
    weather: Annotated[str, _option("Beginning of KEY=VALUE in a recording's environment.")] = "",
    finding: Annotated[str, _option("Beginning of a code that `resim check` finds.")] = "",
    risk_above: Annotated[float | None, _option("Accident risk of this or more.", "RISK")] = None,
    risk_below: Annotated[float | None, _option("Accident risk below this.", "RISK")] = None,
    verdict: Annotated[str, _option("Verdict over all, or of any recording.")] = "",
    build: Annotated[str, _option("Beginning of a build's label or hash.")] = "",
    sort: Annotated[
        SortChoice, typer.Option(help="The newest first, by name, or the highest known risk.")
    ] = SortChoice.written,
    limit: Annotated[int, typer.Option(min=1, max=1_000_000, help="Rows at most.")] = 50,
    format: Annotated[TableFormat, typer.Option(help="How rows are printed.")] = TableFormat.table,
) -> None:
    """Find anything by what is known of it."""
    from resim.jobs.lake import SHOWN, the_catalog
    from resim.results.lake import ITEM_KINDS, LakeQuery, find_page

    if strange := [name for name in kind or () if name not in ITEM_KINDS]:
        raise InputError("--kind", f"there is no {strange[0]!r}", f"There are: {', '.join(ITEM_KINDS)}.")
    query = LakeQuery(
        text, tuple(kind or ()), tag, maneuver, place, weather, finding, risk_above, risk_below, verdict,  # type: ignore[arg-type]
        build,
    )  # fmt: skip
    page = find_page(the_catalog(), query, sort=sort.value, most=limit)
    add_to_json(
        found=[{name: getattr(item, name) for name in SHOWN} for item in page.items],
        count=page.count,
        capped=page.capped,
    )
    if format is TableFormat.csv:
        _print_csv(page.items)
        return
    if not page.items:
        say("nothing was found")
        return
    _print_items(page.items)
    if page.count > len(page.items):
        say(f"{len(page.items)} of {'more than ' if page.capped else ''}{page.count}", err=True)


@command(lake)
def show(
    thing: Annotated[
        str, typer.Argument(metavar="ID|PATH", help="Id, its first four or more digits, or the path.")
    ],
) -> None:
    """Show what something is, what it came from, what came of it, and the command that makes it again."""
    from resim.jobs.lake import lake_show

    links = lake_show(thing)
    entry = links.entry
    add_to_json(
        id=entry.id, kind=entry.kind, name=entry.name, path=str(entry.folder), host=entry.host,
        state=entry.state(), digest=entry.digest, fault=entry.fault, command=links.command, facts=entry.facts,
        settings=links.origin.settings, versions=links.origin.versions,
        origins=[{**asdict(i), "known": [item.id for item in items]} for i, items in links.origins],
        followers=[item.id for item in links.followers], count=links.count,
    )  # fmt: skip
    _print_links(links)


@command(lake)
def crate(
    thing: Annotated[
        str, typer.Argument(metavar="ID|PATH", help="Id, its first four or more digits, or the path.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the crate; an earlier export there is replaced.")],
) -> None:
    """Write something with all that it came from as one RO-Crate: files, seeds, versions, and how to run it again."""
    from resim.jobs.chain import export_chain

    found = export_chain(thing, out)
    add_to_json(out=out, files=len(found.files), notes=found.notes)
    for note in found.notes:
        say(f"note: not in the crate: {note}")
    say(f"{found.drive}: {found.format}: {len(found.files)} files: {out}")


@command(lake)
def builds() -> None:
    """List the builds that results name, with the id of each."""
    from resim.jobs.builds import list_builds
    from resim.jobs.lake import the_catalog

    found = list_builds(the_catalog())
    add_to_json(builds=found)
    for one in found:
        say(visible(f"{one.id[:SHORT]} {one.label} {one.hash[:SHORT] or '–'}: {one.results} results"))


@command(lake)
def compare(
    one: Annotated[
        str, typer.Argument(help="Label of the older build, or the first digits of its id or hash.")
    ],
    other: Annotated[str, typer.Argument(help="The same of the newer build.")],
) -> None:
    """Compare what came out for two builds, recording by recording, what got worse first; nothing is simulated.

    Outcomes are compared under equal circumstances alone: criteria, models, seeds, settings. `resim verify --against`
    runs both in the same scenarios.
    """
    from resim.jobs.builds import compare_builds
    from resim.jobs.lake import the_catalog

    found = compare_builds(the_catalog(), one, other)
    add_to_json(pairs=[{**asdict(pair), "change": pair.change} for pair in found])
    for pair in found:
        both = " and ".join((o.verdict or "not judged") if o else "nothing" for o in (pair.one, pair.other))
        why = "; ".join(pair.differs) or pair.note
        of = f"{pair.recording}, {pair.kind} {pair.source}".strip()
        say(visible(f"{pair.change}: {of}: {both}{f' ({why})' if why else ''}"))
    if not found:
        say("there is no outcome of either")


@command(lake)
def mirror(
    store: Annotated[
        str, typer.Argument(help="Tracking store of MLflow, such as sqlite:///mlflow.db or http://HOST:5000.")
    ],
    experiment: Annotated[str, typer.Option(help="Its experiment; made where there is none.")] = "resim",
) -> None:
    """Mirror all results that are not there yet to MLflow: parameters, metrics, verdicts, hashes."""
    from resim.jobs.mirror import mirror as job

    counts = job(store, experiment=experiment, noted=lambda name: _noted("mirrored", name))
    add_to_json(**asdict(counts))
    say(f"{counts.new} mirrored, {counts.known} were there")


@command(lake)
def backup(
    file: Annotated[Path, typer.Argument(help="A new file, which you alone may read.")],
) -> None:
    """Keep what follows from no files: tasks, registered paths, where other results lie, audit trail, key of tokens."""
    from resim.jobs.lake import lake_backup

    _counted("kept", lake_backup(file))


@command(lake)
def restore(
    file: Annotated[Path, typer.Argument(help="What `resim lake backup` wrote.")],
) -> None:
    """Put back what a backup holds and is not there; then `resim lake scan` makes the index again.

    Results that lie below no registered path are entered at once. Tasks that waited or ran wait again: the next
    `resim serve` does them.
    """
    from resim.jobs.lake import lake_restore
    from resim.results.tables import TASK

    counts = lake_restore(file)
    _counted("put back", counts)
    if counts[TASK.name]:
        say("tasks among these that waited or ran begin with the next `resim serve`", err=True)


def _counted(what: str, counts: dict[str, int]) -> None:
    add_to_json(**{name.replace(".", "_"): count for name, count in counts.items()})
    say(f"{what}: " + ", ".join(f"{count} {name}" for name, count in counts.items()))


def _print_csv(items: tuple[LakeItem, ...]) -> None:
    import csv
    import io

    from resim.jobs.lake import SHOWN

    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(SHOWN)
    for item in items:
        told = (getattr(item, name) for name in SHOWN)
        rows.writerow(" ".join(value) if isinstance(value, tuple) else value for value in told)
    for line in out.getvalue().splitlines():
        say(line)


def _print_items(items: tuple[LakeItem, ...]) -> None:
    from rich.table import Table

    from resim.cli.verdicts import console
    from resim.results.catalog import SHORT as DIGITS

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for head in ("id", "kind"):
        table.add_column(head, no_wrap=True)
    for head in ("name", "verdict", "risk", "build", "path"):
        table.add_column(head, overflow="fold")
    for item in items:
        risk = "" if item.risk is None else f"{item.risk:.3g}"
        table.add_row(
            item.id[:DIGITS], item.kind, visible(item.name), item.verdict or ("unusable" if item.fault else ""),
            risk, visible(", ".join(item.builds)), visible(item.folder),
        )  # fmt: skip
    console().print(table)


def _print_links(links: LakeLinks) -> None:
    from rich.table import Table

    from resim.cli.verdicts import console
    from resim.results.circumstances import FACET

    entry, out = links.entry, console()
    told = {
        "what": f"{entry.kind} {entry.name!r}", "id": entry.id, "path": f"{entry.folder} ({entry.state()})",
        "host": entry.host, "written": f"{entry.written[:19].replace('T', ' ')} UTC",
        "content": entry.digest or "not known", "fault": entry.fault, "verdict": entry.verdict,
        "again": links.command,
        "made with": ", ".join(f"{name} {value}" for name, value in links.origin.settings.items()),
        "versions": ", ".join(f"{name} {version}" for name, version in links.origin.versions.items()),
    }  # fmt: skip
    for name, text in told.items():
        if text:
            out.print(f"{name:9} {visible(text)}", highlight=False, soft_wrap=True)
    if entry.facts:
        facts = Table("fact", "which", "how much", title="known of it")
        for fact in (f for f in entry.facts if f.facet != FACET):
            facts.add_row(fact.facet, visible(fact.name), "" if fact.value is None else f"{fact.value:.4g}")
        out.print(facts)
    came = Table("came from", "name", "content", "path", title="what it came from")
    for i, items in links.origins:
        came.add_row(
            i.role,
            visible(i.name),
            i.hash[:SHORT] or "–",
            visible(items[0].folder if items else i.path or "–"),
        )
    if links.origins:
        out.print(came)
    if links.followers:
        say(f"what came of it: {links.count}")
        _print_items(links.followers)
