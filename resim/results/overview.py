"""What pages show of a catalog: pages of results, recordings with what was made of them, builds over time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, and_, func, or_, select

from resim.results.catalog import Catalog
from resim.results.entry import ItemKind
from resim.results.tables import INPUT, ITEM, OUTCOME

MOST_HASHES = 500
"""Values in one query: databases take a limited number."""


@dataclass(frozen=True)
class ResultQuery:
    """What results are looked for. text: part of a name, of an input's or of a folder, or the first digits of an id or
    of a hash. kind, verdict: "" for any.
    """

    text: str = ""
    kind: ItemKind | None = None
    verdict: str = ""


@dataclass(frozen=True)
class ListedResult:
    """A result as a list shows it. counts: of outcomes by verdict. builds, against: labels."""

    id: str
    kind: ItemKind
    name: str
    written: str
    verdict: str
    counts: Mapping[str, int]
    builds: tuple[str, ...]
    against: tuple[str, ...]


@dataclass(frozen=True)
class UsedInput:
    """Something that results follow from: its name, path ("" where no result tells it) and hash, and of how many."""

    name: str
    path: str
    hash: str
    results: int


@dataclass(frozen=True)
class OutcomeOf:
    """An outcome with the result that it stands in. hash: of the recording's content."""

    result: str
    kind: ItemKind
    written: str
    recording: str
    hash: str
    build: str
    source: str
    verdict: str
    cause: str


class CatalogOverview:
    """Reads a catalog for pages. Every method raises InputError where the database cannot be used."""

    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog

    def version(self) -> tuple[int, str]:
        """Give what is another one once a result was put in."""
        with self._catalog.connected() as connection:
            count, latest = connection.execute(select(func.count(), func.max(ITEM.c.written))).one()
        return int(count), str(latest or "")

    def page(self, query: ResultQuery, first: int, most: int) -> tuple[list[ListedResult], int]:
        """Give at most so many of the results that match, the newest first, from number `first` on; and how many do."""
        wanted = _wanted(query)
        rows = select(*_LISTED).where(*wanted).order_by(ITEM.c.written.desc(), ITEM.c.id)
        with self._catalog.connected() as connection:
            count = connection.scalar(select(func.count()).select_from(ITEM).where(*wanted)) or 0
            return _listed(connection, rows.offset(first).limit(most)), int(count)

    def verdicts(self) -> list[str]:
        """Give all verdicts that results have."""
        with self._catalog.connected() as connection:
            return sorted(v for v in connection.scalars(select(ITEM.c.verdict).distinct()).all() if v)

    def inputs(self, role: str) -> list[UsedInput]:
        """Give all inputs of a role, each content under each name once, by name."""
        told = (INPUT.c.name, INPUT.c.hash)
        rows = (
            select(*told, func.max(INPUT.c.path), func.count(INPUT.c.item.distinct()))
            .where(INPUT.c.role == role)
            .group_by(*told)
            .order_by(*told)
        )
        with self._catalog.connected() as connection:
            return [UsedInput(name, path, digest, n) for name, digest, path, n in connection.execute(rows)]

    def of_recordings(self, hashes: Iterable[str]) -> list[OutcomeOf]:
        """Give the outcomes of recordings with these contents, the newest first."""
        found: list[OutcomeOf] = []
        wanted = sorted({h for h in hashes if h})
        for k in range(0, len(wanted), MOST_HASHES):
            found += self._outcomes(INPUT.c.hash.in_(wanted[k : k + MOST_HASHES]))
        return sorted(found, key=lambda o: o.written, reverse=True)

    def of_build(self, name: str, digest: str, kinds: Sequence[ItemKind]) -> list[OutcomeOf]:
        """Give the outcomes of a build in results of some kinds, the newest first."""
        its = (INPUT.c.role == "build") & (INPUT.c.name == name) & (INPUT.c.hash == digest)
        results = select(INPUT.c.item).where(its)
        return self._outcomes(
            and_(OUTCOME.c.item.in_(results), OUTCOME.c.build == name, ITEM.c.kind.in_(kinds))
        )

    def results_of_build(self, name: str, digest: str, most: int) -> list[ListedResult]:
        """Give the newest results of a build, at most so many."""
        its = (INPUT.c.role == "build") & (INPUT.c.name == name) & (INPUT.c.hash == digest)
        rows = select(*_LISTED).where(ITEM.c.id.in_(select(INPUT.c.item).where(its)))
        with self._catalog.connected() as connection:
            return _listed(connection, rows.order_by(ITEM.c.written.desc(), ITEM.c.id).limit(most))

    def _outcomes(self, condition: ColumnElement[bool]) -> list[OutcomeOf]:
        of = and_(INPUT.c.item == ITEM.c.id, INPUT.c.role == "recording", INPUT.c.name == OUTCOME.c.recording)
        rows = (
            select(
                ITEM.c.id, ITEM.c.kind, ITEM.c.written, OUTCOME.c.recording, INPUT.c.hash, OUTCOME.c.build,
                OUTCOME.c.source, OUTCOME.c.verdict, OUTCOME.c.cause,
            )
            .join(OUTCOME, OUTCOME.c.item == ITEM.c.id)
            .join(INPUT, of)
            .where(condition)
            .order_by(ITEM.c.written.desc(), ITEM.c.id, OUTCOME.c.row)
        )  # fmt: skip
        with self._catalog.connected() as connection:
            return [OutcomeOf(*row) for row in connection.execute(rows)]


_LISTED = tuple(ITEM.c[name] for name in ("id", "kind", "name", "written", "verdict", "counts"))


def _listed(connection: Connection, rows: Select[Any]) -> list[ListedResult]:
    """Results as rows of a list, with the builds of each: nothing else of them is read."""
    found = connection.execute(rows).all()
    of = INPUT.c.item.in_([row.id for row in found]) & INPUT.c.role.in_(("build", "against"))
    builds: dict[tuple[str, str], list[str]] = {}
    told = select(INPUT.c.item, INPUT.c.role, INPUT.c.name).where(of).order_by(INPUT.c.row)
    for result, role, name in connection.execute(told):
        builds.setdefault((result, role), []).append(name)
    return [
        ListedResult(
            row.id, row.kind, row.name, row.written, row.verdict, row.counts if isinstance(row.counts, dict) else {},
            tuple(dict.fromkeys(builds.get((row.id, "build"), ()))), tuple(builds.get((row.id, "against"), ())),
        )
        for row in found
    ]  # fmt: skip


def _wanted(query: ResultQuery) -> list[ColumnElement[bool]]:
    wanted: list[ColumnElement[bool]] = []
    if query.kind is not None:
        wanted.append(ITEM.c.kind == query.kind)
    if query.verdict:
        wanted.append(ITEM.c.verdict == query.verdict)
    for word in query.text.split():
        inputs = select(INPUT.c.item).where(
            or_(
                INPUT.c.name.icontains(word, autoescape=True), INPUT.c.hash.istartswith(word, autoescape=True)
            )
        )
        wanted.append(
            or_(
                ITEM.c.name.icontains(word, autoescape=True),
                ITEM.c.folder.icontains(word, autoescape=True),
                ITEM.c.id.istartswith(word, autoescape=True),
                ITEM.c.id.in_(inputs),
            )
        )
    return wanted
