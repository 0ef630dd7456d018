"""Results of the catalog in the terminal, and as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from resim.cli.terminal import say, visible

if TYPE_CHECKING:
    from rich.text import Text

    from resim.results.entry import CatalogEntry, CatalogOutcome


def line(entry: CatalogEntry) -> str:
    """Give a result in a few words."""
    from resim.results.catalog import SHORT

    return f"{entry.id[:SHORT]} {entry.kind} {entry.name!r}: {_verdict(entry) or 'not judged'}"


def _verdict(entry: CatalogEntry) -> str:
    """The verdict, and how many of how many are good."""
    total = sum(entry.counts.values())
    good = next(iter(entry.counts.values()), 0)
    return f"{entry.verdict} ({good}/{total})" if total > 1 else entry.verdict


@dataclass(frozen=True)
class EntrySummary:
    """What a list as JSON says of a result; fields as in `CatalogEntry`. table: where the rows of a sweep are."""

    id: str
    kind: str
    name: str
    folder: str
    state: str
    host: str
    written: str
    resim: str
    verdict: str | None
    counts: Mapping[str, int]
    recordings: list[str]
    builds: list[str]
    against: list[str]
    table: str | None


def summary(entry: CatalogEntry) -> EntrySummary:
    """Give what a list says of a result."""
    return EntrySummary(
        id=entry.id, kind=entry.kind, name=entry.name, folder=str(entry.folder), state=entry.state(),
        host=entry.host, written=entry.written, resim=entry.resim, verdict=entry.verdict or None,
        counts=dict(entry.counts), recordings=entry.names("recording"), builds=entry.names("build"),
        against=entry.names("against"), table=_table(entry),
    )  # fmt: skip


def _table(entry: CatalogEntry) -> str | None:
    """Where the rows of a sweep are."""
    return str(entry.folder / "runs" / "*.parquet") if entry.kind == "sweep" else None


def print_list(found: list[CatalogEntry]) -> None:
    """Print a line a result."""
    from rich.table import Table

    from resim.cli.verdicts import console
    from resim.results.catalog import SHORT

    if not found:
        say("no results")
        return
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for head in ("id", "written (UTC)", "kind"):
        table.add_column(head, no_wrap=True, overflow="fold")
    for first, second in (("name", "build"), ("verdict (good/all)", "folder")):
        table.add_column(_above(first, second), overflow="fold")
    for e in found:
        state = e.state()
        of = {"there": "", "elsewhere": f" (of {e.host})"}.get(state, f" ({state})")
        builds = ", ".join(e.names("build")) + "".join(f" against {name}" for name in e.names("against"))
        written = e.written[:16].replace("T", " ")
        what, came = _above(e.name, builds), _above(_verdict(e) or "–", f"{_short(e.folder)}{of}")
        table.add_row(e.id[:SHORT], written, e.kind, what, came)
    console().print(table)


def _above(first: str, second: str) -> Text:
    """A cell of two lines."""
    from rich.text import Text

    return Text(f"{visible(first)}\n{visible(second)}")


def _short(folder: Path) -> str:
    """A folder as seen from here, where it is below."""
    here = Path.cwd()
    return str(folder.relative_to(here)) if folder.is_relative_to(here) else str(folder)


def print_entry(entry: CatalogEntry) -> None:
    """Print all that the catalog holds of a result."""
    from rich.table import Table

    from resim.cli.verdicts import console

    out = console()
    state = {
        "there": "", "gone": " (gone)", "changed": " (overwritten since)", "elsewhere": f" (of {entry.host})",
    }[entry.state()]  # fmt: skip
    told = {
        "result": line(entry), "id": entry.id,
        "written": f"{entry.written[:19].replace('T', ' ')} UTC by resim {entry.resim}, on {entry.host}",
        "folder": f"{entry.folder}{state}",
    }  # fmt: skip
    if entry.counts:
        told["counts"] = ", ".join(f"{count} {verdict}" for verdict, count in entry.counts.items())
    for page in ("report.html", "verification.html", "assessment.html", "mined.html"):
        if (entry.folder / page).is_file():
            told["page"] = str(entry.folder / page)
    if (rows := _table(entry)) is not None and not set("*?[") & set(str(entry.folder)):  # patterns to DuckDB
        query = f"select * from read_parquet({_literal(rows)}, hive_partitioning = false)"
        told["rows"] = f"duckdb.sql({json.dumps(query)}).df()"
    for name, text in told.items():
        out.print(f"{name:8} {text}", highlight=False, soft_wrap=True)
    inputs = Table("input", "name", "SHA-256", "path", title="inputs")
    for i in entry.inputs:
        inputs.add_row(i.role, i.name, i.hash[:12] or "–", i.path or "–")
    out.print(inputs)
    _print_outcomes(entry.outcomes)


def _print_outcomes(outcomes: tuple[CatalogOutcome, ...]) -> None:
    """Verdicts, in the columns that any of them has; the build where it is not the same in all."""
    from rich.table import Table

    from resim.cli.verdicts import console

    rows = [_cells(outcome) for outcome in outcomes]
    names = [n for n in rows[0] if n != "build" or len({row[n] for row in rows}) > 1] if rows else []
    held = [name for name in names if any(row[name] for row in rows)]
    table = Table(*held, title="results")
    for column in table.columns:
        column.overflow = "fold"
    for row in rows:
        table.add_row(*(row[name] or "–" for name in held))
    console().print(table)


def _cells(o: CatalogOutcome) -> dict[str, str]:
    """An outcome by column, "" for what is not told."""
    several = f"{o.runs}: {o.passes} PASS, {o.fails} FAIL, {o.invalids} INVALID, {o.failures} failed"
    return {
        "recording": o.recording,
        "build": o.build,
        "of": o.source,
        "verdict": o.verdict,
        "runs": "" if o.runs is None else several,
        "collisions": "" if o.collisions is None else str(o.collisions),
        "same decision": "" if o.same_decision is None else f"{100.0 * o.same_decision:.3g} %",
        "why": o.cause,
    }


def _literal(text: str) -> str:
    """A text as SQL has it."""
    return "'" + text.replace("'", "''") + "'"
