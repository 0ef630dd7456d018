"""The lake: finds everything by what is known of it, a page at a time, and what belongs together by content.

Few or many: each condition is asked first for how many rows fit it. If the rarest fits few, these are gathered, and
tried by the others; if all fit many, an index is walked in the order of the page, until that is full.
"""

from __future__ import annotations

import string
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from sqlalchemy import (
    ColumnElement,
    CompoundSelect,
    Connection,
    Select,
    and_,
    exists,
    false,
    func,
    or_,
    select,
    union,
)

from resim.results.catalog import AT_ONCE, LEAST, Catalog, begins
from resim.results.entry import ItemKind
from resim.results.reading import VERDICTS
from resim.results.tables import FACT, INPUT, ITEM, OUTCOME, WORD
from resim.results.words import words_of

SortKey = Literal["written", "name", "risk"]
SORTS: Mapping[SortKey, bool] = {"written": True, "name": False, "risk": True}
"""By what pages are sorted, and whether the largest comes first."""
ITEM_KINDS: tuple[ItemKind, ...] = tuple(
    kind for part in get_args(ItemKind) for kind in get_args(part) or (part,)
)
FEW = 20_000
"""Rows that are gathered and sorted; counts of what is filtered go no further."""


@dataclass(frozen=True)
class LakeQuery:
    """What is looked for; "", () or None for anything.

    Attributes:
        text: Beginnings of words of its name, its path or the names of what it follows from; or the first digits of
            an id or a hash, four or more.
        kinds: Of which kind it is.
        tag: Beginning of KEY=VALUE in a recording's provenance.
        maneuver: Beginning of a label that was mined in it.
        place: Beginning of the name of its map, or of the hash.
        weather: Beginning of KEY=VALUE in a recording's environment.
        finding: Beginning of a code that `resim check` finds.
        risk_above: Its accident risk is this or more.
        risk_below: Its accident risk is less.
        verdict: Over all, or of any outcome.
        build: Beginning of a build's label, or of its hash.
        hashes: It is about any of these contents: a recording itself, or what follows from one.
    """

    text: str = ""
    kinds: tuple[ItemKind, ...] = ()
    tag: str = ""
    maneuver: str = ""
    place: str = ""
    weather: str = ""
    finding: str = ""
    risk_above: float | None = None
    risk_below: float | None = None
    verdict: str = ""
    build: str = ""
    hashes: tuple[str, ...] = ()


@dataclass(frozen=True)
class LakeItem:
    """Something that the lake knows, as lists show it.

    Attributes:
        id: 16 hex digits, of kind, path and content.
        kind: Of what kind.
        name: What it is called.
        folder: Where it lies, on its host.
        host: The machine.
        written: When, ISO 8601 in UTC.
        digest: SHA-256 of its content, "" where that cannot be told.
        verdict: Over all, "" where nothing was judged.
        counts: Of outcomes by verdict.
        risk: The highest accident risk that is known, of what was measured or came out.
        fault: Why it cannot be used.
        builds: Labels.
        against: Labels of builds that these were compared with.
        maps: Names.
    """

    id: str
    kind: ItemKind
    name: str
    folder: str
    host: str
    written: str
    digest: str
    verdict: str
    counts: Mapping[str, int]
    risk: float | None
    fault: str
    builds: tuple[str, ...] = ()
    against: tuple[str, ...] = ()
    maps: tuple[str, ...] = ()


@dataclass(frozen=True)
class LakePage:
    """Some of what was found. count: of all; capped: whether there are more than that."""

    items: tuple[LakeItem, ...]
    count: int
    capped: bool


@dataclass(frozen=True)
class _Condition:
    """One condition, in two forms.

    rows: what few fit is gathered by these ids (or contents: `of`). tried: each item is tried, of those that many fit.
    """

    rows: CompoundSelect[Any] | Select[Any]
    tried: ColumnElement[bool]
    of: ColumnElement[str] = ITEM.c.id

    @property
    def gathered(self) -> ColumnElement[bool]:
        return self.of.in_(self.rows)


def find_page(
    catalog: Catalog, query: LakeQuery, *, sort: SortKey = "written", first: int = 0, most: int = 50
) -> LakePage:
    """Give some of what fits, from number `first` on. Sorted by risk, only that of which it is known.

    Raises InputError where the database cannot be used.
    """
    conditions = _conditions(query)
    whole = _whole(query, sort)
    column, falling = ITEM.c[sort], SORTS[sort]
    with catalog.connected() as connection:
        sizes = [_size(connection, one) for one in conditions]
        few = conditions and min(sizes) <= FEW
        rarest = sizes.index(min(sizes)) if few else -1
        tried = [c.gathered if k == rarest else c.tried for k, c in enumerate(conditions)]
        found = select(ITEM.c.id).where(*whole, *tried)
        counted = select(func.count()).select_from(
            found.limit(FEW + 1).subquery() if tried else found.subquery()
        )
        count = int(connection.scalar(counted) or 0)
        order = (
            func.coalesce(column, 0.0 if sort == "risk" else "") if few else column
        )  # no index of this order
        orders = [o.desc() if falling else o for o in (order, ITEM.c.id)]
        ids = connection.scalars(found.order_by(*orders).offset(first).limit(most)).all()
        items = items_of(connection, ids)
    capped = bool(tried) and count > FEW
    return LakePage(tuple(items), min(count, FEW) if capped else count, capped)


def items_of(connection: Connection, ids: Sequence[str]) -> list[LakeItem]:
    """Give what has these ids, in this order."""
    columns = [ITEM.c[f.name] for f in fields(LakeItem) if f.name in ITEM.c]
    rows: dict[str, Any] = {}
    named: dict[tuple[str, str], list[str]] = {}
    for k in range(0, len(ids), AT_ONCE):
        some = ids[k : k + AT_ONCE]
        rows |= {row.id: row for row in connection.execute(select(*columns).where(ITEM.c.id.in_(some)))}
        told = select(INPUT.c.item, INPUT.c.role, INPUT.c.name).where(
            INPUT.c.item.in_(some), INPUT.c.role.in_(("build", "against", "map"))
        )
        for item, role, name in connection.execute(told.order_by(INPUT.c.item, INPUT.c.row)):
            named.setdefault((item, role), []).append(name)
    return [
        LakeItem(
            **{**rows[i]._mapping, "counts": c if isinstance(c := rows[i].counts, dict) else {}},
            builds=tuple(dict.fromkeys(named.get((i, "build"), ()))), against=tuple(named.get((i, "against"), ())),
            maps=tuple(named.get((i, "map"), ())),
        )
        for i in ids if i in rows
    ]  # fmt: skip


def with_content(catalog: Catalog, hashes: Iterable[str]) -> dict[str, list[LakeItem]]:
    """Give what has these contents, by hash."""
    wanted = sorted({h for h in hashes if h})
    found: dict[str, list[LakeItem]] = {}
    with catalog.connected() as connection:
        for k in range(0, len(wanted), AT_ONCE):
            of = ITEM.c.digest.in_(wanted[k : k + AT_ONCE])
            for item in items_of(
                connection, connection.scalars(select(ITEM.c.id).where(of).order_by(ITEM.c.id)).all()
            ):
                found.setdefault(item.digest, []).append(item)
    return found


def _size(connection: Connection, one: _Condition) -> int:
    return int(connection.scalar(select(func.count()).select_from(one.rows.limit(FEW + 1).subquery())) or 0)


def _whole(query: LakeQuery, sort: SortKey) -> list[ColumnElement[bool]]:
    """Conditions that an index in the order of the page answers."""
    whole: list[ColumnElement[bool]] = []
    if len(query.kinds) == 1:
        whole.append(ITEM.c.kind == query.kinds[0])
    elif query.kinds:
        whole.append(ITEM.c.kind.in_(query.kinds))
    if sort == "risk":
        whole.append(ITEM.c.risk.is_not(None))
    return whole


def _conditions(query: LakeQuery) -> list[_Condition]:
    found = [_word(word) for word in words_of(query.text)]
    if query.text.strip() and not found:
        found.append(_of_itself(ITEM.c.id == ""))  # nothing but signs: nothing is called so
    for facet in ("tag", "maneuver", "weather", "finding"):
        if text := getattr(query, facet).strip().lower():
            its = and_(FACT.c.facet == facet, *begins(FACT.c.name, text), FACT.c.hash != "")
            found.append(
                _Condition(
                    select(FACT.c.hash).where(its), _has(FACT.c.hash, its, ITEM.c.digest), ITEM.c.digest
                )
            )
    for roles, text in ((("map",), query.place.strip()), (("build", "against"), query.build.strip())):
        if text:
            named = or_(and_(*begins(INPUT.c.name, text)), _digits(INPUT.c.hash, text))
            found.append(_by_input(INPUT.c.role.in_(roles) & named))
    if query.risk_above is not None:
        found.append(_of_itself(ITEM.c.risk >= query.risk_above))
    if query.risk_below is not None:
        found.append(_of_itself(ITEM.c.risk < query.risk_below))
    if query.verdict:
        found.append(_verdict(query.verdict))
    if query.hashes:
        found.append(_by_input(INPUT.c.hash.in_(query.hashes)))
    return found


def _has(key: ColumnElement[Any], where: ColumnElement[bool], of: ColumnElement[Any]) -> ColumnElement[bool]:
    return exists().where(key == of, where)


def _of_itself(where: ColumnElement[bool]) -> _Condition:
    return _Condition(select(ITEM.c.id).where(where), where)


def _by_input(where: ColumnElement[bool]) -> _Condition:
    return _Condition(select(INPUT.c.item).where(where), _has(INPUT.c.item, where, ITEM.c.id))


def _digits(column: ColumnElement[str], text: str) -> ColumnElement[bool]:
    """The first digits of a hash."""
    lower = text.lower()
    is_hex = len(lower) >= LEAST and set(lower) <= set(string.hexdigits)
    return and_(*begins(column, lower)) if is_hex else false()


def _word(word: str) -> _Condition:
    begun, own, of = and_(*begins(WORD.c.word, word)), _digits(ITEM.c.id, word), _digits(INPUT.c.hash, word)
    content = _digits(ITEM.c.digest, word)
    every = union(
        select(WORD.c.item).where(begun), select(ITEM.c.id).where(own), select(ITEM.c.id).where(content),
        select(INPUT.c.item).where(of),
    )  # fmt: skip
    rows = every if of is not false() else select(WORD.c.item).where(begun)
    return _Condition(
        rows, or_(_has(WORD.c.item, begun, ITEM.c.id), own, content, _has(INPUT.c.item, of, ITEM.c.id))
    )


def _verdict(verdict: str) -> _Condition:
    """Over all, or of any outcome; in any case."""
    known = next((v for v in VERDICTS if v.lower() == verdict.lower()), verdict)
    own, its = ITEM.c.verdict == known, OUTCOME.c.verdict == known
    rows = union(select(ITEM.c.id).where(own), select(OUTCOME.c.item).where(its))
    return _Condition(rows, or_(own, _has(OUTCOME.c.item, its, ITEM.c.id)))
