"""What pages show of a catalog besides lists: what was made of each recording, builds over time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from sqlalchemy import ColumnElement, and_, exists, func, select

from resim.results.catalog import AT_ONCE, Catalog, following_from
from resim.results.entry import ItemKind
from resim.results.tables import INPUT, ITEM, OUTCOME


@dataclass(frozen=True)
class UsedInput:
    """Something that results follow from: its name and hash, and of how many."""

    name: str
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

    def inputs(self, role: str) -> list[UsedInput]:
        """Give all inputs of a role, each content under each name once, by name."""
        told = (INPUT.c.name, INPUT.c.hash)
        every = select(*told, func.count()).where(INPUT.c.role == role).group_by(*told).order_by(*told)
        plans = INPUT.c.item.in_(select(ITEM.c.id).where(ITEM.c.kind == "sweep-file"))
        with self._catalog.connected() as connection:
            only_named = Counter((name, digest) for its, name, digest in connection.execute(
                select(INPUT.c.role, *told).where(plans)) if its == role)  # fmt: skip
            counts = [
                (name, digest, n - only_named[name, digest]) for name, digest, n in connection.execute(every)
            ]
        return [UsedInput(name, digest, n) for name, digest, n in counts if n]

    def newest_of(self, hashes: Iterable[str]) -> list[OutcomeOf]:
        """Give the newest outcome of each recording with these contents, by kind of result and source, the newest that
        was judged and the newest that was not; a comparison of builds is another kind than a verification."""
        wanted = sorted({h for h in hashes if h})
        compared = exists().where(INPUT.c.item == ITEM.c.id, INPUT.c.role == "against")
        of = (OUTCOME.c.hash, ITEM.c.kind, OUTCOME.c.source, compared, OUTCOME.c.verdict != "")
        number = (
            func.row_number()
            .over(partition_by=of, order_by=(ITEM.c.written.desc(), ITEM.c.id))
            .label("number")
        )
        found: list[OutcomeOf] = []
        with self._catalog.connected() as connection:
            for k in range(0, len(wanted), AT_ONCE):
                its = OUTCOME.c.hash.in_(wanted[k : k + AT_ONCE])
                rows = (
                    select(*_OUTCOME_OF, number).join(ITEM, OUTCOME.c.item == ITEM.c.id).where(its).subquery()
                )
                columns = [c for c in rows.columns if c.name != "number"]
                newest = select(*columns).where(rows.c.number == 1).order_by(rows.c.written.desc(), rows.c.id)
                found += [OutcomeOf(*row) for row in connection.execute(newest)]
        return found

    def of_build(self, name: str, digest: str, kinds: Sequence[ItemKind]) -> list[OutcomeOf]:
        """Give the outcomes of a build in results of some kinds, the newest first."""
        its = following_from(("build",), INPUT.c.name == name, INPUT.c.hash == digest)
        of = and_(its, OUTCOME.c.build == name, OUTCOME.c.hash != "")
        return self._outcomes(of & ITEM.c.kind.in_(kinds))

    def _outcomes(self, condition: ColumnElement[bool]) -> list[OutcomeOf]:
        rows = select(*_OUTCOME_OF).join(ITEM, OUTCOME.c.item == ITEM.c.id).where(condition)
        with self._catalog.connected() as connection:
            ordered = rows.order_by(ITEM.c.written.desc(), ITEM.c.id, OUTCOME.c.row)
            return [OutcomeOf(*row) for row in connection.execute(ordered)]


_OUTCOME_OF = (
    ITEM.c.id, ITEM.c.kind, ITEM.c.written, OUTCOME.c.recording, OUTCOME.c.hash, OUTCOME.c.build, OUTCOME.c.source,
    OUTCOME.c.verdict, OUTCOME.c.cause,
)  # fmt: skip
