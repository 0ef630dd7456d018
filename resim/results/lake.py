"""The lake: finds everything by what is known of it, a page at a time, and what belongs together by content.

Few or many: each condition is asked first for how many rows fit it. What few fit is gathered, and sorted; if all fit
many, an index is walked in the order of the page, and each item tried, until the page is full.
"""

from __future__ import annotations

import string
from collections.abc import Callable, Iterable, Mapping, Sequence
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
    union_all,
)

from resim.results.catalog import AT_ONCE, LEAST, Catalog, begins
from resim.results.entry import REPORT, CatalogEntry, CatalogInput, ItemKind
from resim.results.reading import VERDICTS
from resim.results.tables import FACT, INPUT, ITEM, OUTCOME, WORD
from resim.results.words import words_of

SortKey = Literal["written", "name", "risk"]
SORTS: Mapping[SortKey, bool] = {"written": True, "name": False, "risk": True}
"""By what pages are sorted, and whether the largest comes first."""
ITEM_KINDS: tuple[ItemKind, ...] = tuple(
    kind for part in get_args(ItemKind) for kind in get_args(part) or (part,)
)
WITH_MAP: tuple[ItemKind, ...] = ("recording", "scenario", "run")
"""Kinds that name their map themselves."""
FEW = 10_000
"""Rows that are gathered and sorted, for each filter."""


@dataclass(frozen=True)
class LakeQuery:
    """What is looked for; "", () or None for anything.

    Attributes:
        text: Beginnings of words of its name (of a recording that in its recording.toml, too), its path or the names
            of what it follows from; or the first digits of an id or a hash, four or more.
        kinds: Of which kind it is.
        tag: Beginning of KEY=VALUE in a recording's provenance.
        maneuver: Beginning of a label that was mined in it.
        place: Beginning of the name of its map, or of the hash: its own, that of a recording that it follows from, or
            what it is itself.
        weather: Beginning of KEY=VALUE in a recording's environment.
        finding: Beginning of a code that `resim check` finds.
        risk_above: Its accident risk is this or more.
        risk_below: Its accident risk is less.
        verdict: Over all, or of any outcome.
        build: Beginning of a build's label, or of its hash.
        hashes: It follows from any of these contents.
        verdicts: Any result tells one of these of its content.
        judged: Whether any result tells anything of its content.
        folders: It lies at one of these paths.
        host: It was entered on this machine.
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
    verdicts: tuple[str, ...] = ()
    judged: bool | None = None
    folders: tuple[str, ...] | None = None
    host: str = ""


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
    """Some of what was found. count: of all, or as far as it was looked for; capped: whether there are more."""

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
    column: ColumnElement[Any] = ITEM.c[sort]
    falling = SORTS[sort]
    with catalog.connected() as connection:
        most_few = FEW * len(conditions)  # the more filters, the less likely it is that many fit all
        few = [_count(connection, one.rows.limit(most_few + 1)) <= most_few for one in conditions]
        if any(few):
            column = func.coalesce(column, 0.0 if sort == "risk" else "")  # its index is of no use
        own = _whole(query, sort, _unindexed if any(few) else _as_it_is)
        fits = [c.gathered if is_few else c.tried for c, is_few in zip(conditions, few, strict=True)]
        orders = [o.desc() if falling else o for o in (column, ITEM.c.id)]
        found = select(ITEM.c.id).where(*own, *fits)
        if any(few):
            every = connection.scalars(found.order_by(*orders)).all()
            ids, count, more = every[first : first + most], len(every), False
        else:
            ids = connection.scalars(found.order_by(*orders).offset(first).limit(most + 1)).all()
            capped = bool(conditions) or query.judged is not None
            more = capped and len(ids) > most
            ids = ids[:most]
            count = first + len(ids) if capped else _count(connection, found)
        return LakePage(tuple(items_of(connection, ids)), count, more)


def items_of(connection: Connection, ids: Sequence[str]) -> list[LakeItem]:
    """Give what has these ids, in this order."""
    columns = [ITEM.c[f.name] for f in fields(LakeItem) if f.name in ITEM.c]
    rows: dict[str, Any] = {}
    named: dict[tuple[str, str], list[str]] = {}
    for k in range(0, len(ids), AT_ONCE):
        some = ids[k : k + AT_ONCE]
        rows |= {row.id: row for row in connection.execute(select(*columns).where(ITEM.c.id.in_(some)))}
        told = select(INPUT.c.item, INPUT.c.role, INPUT.c.name).where(INPUT.c.item.in_(some))
        for item, role, name in connection.execute(told.order_by(INPUT.c.item, INPUT.c.row)):
            named.setdefault((item, role), []).append(name)
    return [
        LakeItem(
            **{**rows[i]._mapping, "counts": c if isinstance(c := rows[i].counts, dict) else {}},
            builds=tuple(dict.fromkeys(named.get((i, "build"), named.get((i, "drove"), ())))),
            against=tuple(named.get((i, "against"), ())), maps=tuple(named.get((i, "map"), ())),
        )
        for i in ids if i in rows
    ]  # fmt: skip


def items_with(catalog: Catalog, ids: Sequence[str]) -> list[LakeItem]:
    """Give what has these ids, in this order; those that there are."""
    with catalog.connected() as connection:
        return items_of(connection, ids)


def maps_of(catalog: Catalog, ids: Sequence[str]) -> list[CatalogInput]:
    """Give the maps that things with these ids follow from, each once, by path."""
    wanted = (
        select(INPUT.c.role, INPUT.c.name, INPUT.c.path, INPUT.c.hash).where(INPUT.c.role == "map").distinct()
    )
    found: set[CatalogInput] = set()
    with catalog.connected() as connection:
        for k in range(0, len(ids), AT_ONCE):
            rows = connection.execute(wanted.where(INPUT.c.item.in_(ids[k : k + AT_ONCE])))
            found |= {CatalogInput(*row) for row in rows}
    return sorted(found, key=lambda one: (one.path, one.name, one.hash))


def items_below(catalog: Catalog, folder: str, most: int) -> list[LakeItem]:
    """Give what lies at a path or below, by path, at most so many."""
    below = or_(ITEM.c.folder == folder, and_(*begins(ITEM.c.folder, f"{folder}/")))
    with catalog.connected() as connection:
        found = select(ITEM.c.id).where(below).order_by(ITEM.c.folder, ITEM.c.id).limit(most)
        return items_of(connection, connection.scalars(found).all())


def facts_of(catalog: Catalog, ids: Sequence[str], facet: str) -> dict[str, list[str]]:
    """Give the names of the facts of one facet, by id."""
    found: dict[str, list[str]] = {}
    told = select(FACT.c.item, FACT.c.name, FACT.c.facet).order_by(FACT.c.item, FACT.c.row)
    with catalog.connected() as connection:
        for k in range(0, len(ids), AT_ONCE):
            for item, name, its in connection.execute(told.where(FACT.c.item.in_(ids[k : k + AT_ONCE]))):
                if its == facet:
                    found.setdefault(item, []).append(name)
    return found


def contents_of(entry: CatalogEntry) -> tuple[str, ...]:
    """Give the hashes by which others name something: of its content, and of a run that of its report, too."""
    return (entry.digest, *(fact.hash for fact in entry.facts if fact.facet == REPORT))


def with_content(catalog: Catalog, hashes: Iterable[str]) -> dict[str, list[LakeItem]]:
    """Give what has these contents, by hash; a run by that of its report, too."""
    wanted = sorted({h for h in hashes if h})
    found: dict[str, list[LakeItem]] = {}
    with catalog.connected() as connection:
        for k in range(0, len(wanted), AT_ONCE):
            of = ITEM.c.digest.in_(wanted[k : k + AT_ONCE])
            for item in items_of(
                connection, connection.scalars(select(ITEM.c.id).where(of).order_by(ITEM.c.id)).all()
            ):
                found.setdefault(item.digest, []).append(item)
        lost = [h for h in wanted if h not in found]
        for k in range(0, len(lost), AT_ONCE):
            some = FACT.c.hash.in_(lost[k : k + AT_ONCE]), FACT.c.facet == REPORT
            runs = connection.execute(
                select(FACT.c.hash, FACT.c.item).where(*some).order_by(FACT.c.item)
            ).all()
            items = {item.id: item for item in items_of(connection, [name for _, name in runs])}
            for digest, name in runs:
                found.setdefault(digest, []).append(items[name])
    return found


Columns = Callable[[ColumnElement[str]], ColumnElement[str]]
"""Gives a column as it stands in a condition: itself where its index is to be used, else an expression of it."""


def _as_it_is(column: ColumnElement[str]) -> ColumnElement[str]:
    return column


def _unindexed(column: ColumnElement[str]) -> ColumnElement[str]:
    return func.coalesce(column, "")


def _count(connection: Connection, rows: CompoundSelect[Any] | Select[Any]) -> int:
    return int(connection.scalar(select(func.count()).select_from(rows.subquery())) or 0)


def _whole(query: LakeQuery, sort: SortKey, of: Columns) -> list[ColumnElement[bool]]:
    """Conditions of the items alone, which an index in the order of the page answers."""
    whole: list[ColumnElement[bool]] = []
    if len(query.kinds) == 1:
        whole.append(of(ITEM.c.kind) == query.kinds[0])
    elif query.kinds:
        whole.append(of(ITEM.c.kind).in_(query.kinds))
    if query.host:
        whole.append(ITEM.c.host == query.host)
    if query.judged is not None:
        told = exists().where(OUTCOME.c.hash == ITEM.c.digest)
        whole.append(told if query.judged else ~told)
    if sort == "risk":
        whole.append(ITEM.c.risk.is_not(None))
    return whole


def _conditions(query: LakeQuery) -> list[_Condition]:
    found = [_word(word) for word in words_of(query.text)]
    if query.text.strip() and not found:
        found.append(_of_itself(ITEM.c.id == ""))  # nothing but signs: nothing is called so
    facets = ("tag", "maneuver", "weather", "finding")
    found += [_fact(f, text) for f in facets if (text := getattr(query, f).strip().lower())]
    if text := query.place.strip():
        found.append(_place(text, query.kinds))
    if text := query.build.strip():
        found.append(_named(("build", "against", "drove"), text))
    if query.risk_above is not None:
        found.append(_of_itself(ITEM.c.risk >= query.risk_above))
    if query.risk_below is not None:
        found.append(_of_itself(ITEM.c.risk < query.risk_below))
    if query.verdict:
        found.append(_verdict(query.verdict))
    if query.hashes:
        found.append(_by(INPUT.c.item, lambda of: of(INPUT.c.hash).in_(query.hashes)))
    if query.verdicts:
        found.append(_by(OUTCOME.c.hash, lambda of: of(OUTCOME.c.verdict).in_(query.verdicts), ITEM.c.digest))
    if query.folders is not None:
        found.append(_of_itself(ITEM.c.folder.in_(query.folders)))
    return found


def _by(
    key: ColumnElement[str],
    where: Callable[[Columns], ColumnElement[bool]],
    of: ColumnElement[str] = ITEM.c.id,
) -> _Condition:
    """Found by rows of another table: gathered by the index of what is looked for, tried by that of the key alone."""
    # with an offset PostgreSQL tries each, and does not join whole tables
    tried = exists(select(key).where(key == of, where(_unindexed)).offset(0))
    return _Condition(select(key).where(where(_as_it_is)), tried, of)


def _of_itself(where: ColumnElement[bool]) -> _Condition:
    return _Condition(select(ITEM.c.id).where(where), where)


def _fact(facet: str, text: str) -> _Condition:
    def where(of: Columns) -> ColumnElement[bool]:
        return and_(of(FACT.c.facet) == facet, *begins(of(FACT.c.name), text), FACT.c.hash != "")

    return _by(FACT.c.hash, where, ITEM.c.digest)


def _named(roles: tuple[str, ...], text: str) -> _Condition:
    def where(of: Columns) -> ColumnElement[bool]:
        named = or_(and_(*begins(of(INPUT.c.name), text)), _digits(of(INPUT.c.hash), text))
        return of(INPUT.c.role).in_(roles) & named

    return _by(INPUT.c.item, where)


def _place(text: str, kinds: Sequence[ItemKind]) -> _Condition:
    """On a map: of its own, or of what it follows from, such as a recording; and the map itself."""
    direct = _named(("map",), text)
    if kinds and {*kinds} <= {*WITH_MAP}:
        return direct
    there, on = ITEM.alias("there"), INPUT.alias("on")
    named = or_(and_(*begins(on.c.name, text)), _digits(on.c.hash, text))
    told = select(there.c.digest).join(on, on.c.item == there.c.id).where(on.c.role == "map", named)
    itself = and_(
        ITEM.c.kind == "map",
        or_(and_(*begins(ITEM.c.name, text)), _digits(func.coalesce(ITEM.c.digest, ""), text)),
    )
    after = _by(INPUT.c.item, lambda of: of(INPUT.c.hash).in_(told.where(there.c.digest != "")))
    rows = union_all(direct.rows, after.rows, select(ITEM.c.id).where(itself))
    return _Condition(rows, or_(direct.tried, after.tried, itself))


def _digits(column: ColumnElement[str], text: str) -> ColumnElement[bool]:
    """The first digits of a hash."""
    lower = text.lower()
    is_hex = len(lower) >= LEAST and set(lower) <= set(string.hexdigits)
    return and_(*begins(column, lower)) if is_hex else false()


def _word(word: str) -> _Condition:
    begun = _by(WORD.c.item, lambda of: and_(*begins(of(WORD.c.word), word)))
    if _digits(ITEM.c.id, word) is false():
        return begun
    own = or_(_digits(ITEM.c.id, word), _digits(ITEM.c.digest, word))
    content = _by(INPUT.c.item, lambda of: _digits(of(INPUT.c.hash), word))
    parts = (_digits(column, word) for column in (ITEM.c.id, ITEM.c.digest))
    rows = union(begun.rows, content.rows, *(select(ITEM.c.id).where(part) for part in parts))
    return _Condition(rows, or_(begun.tried, own, content.tried))


def _verdict(verdict: str) -> _Condition:
    """Over all, or of any outcome; in any case."""
    known = next((v for v in VERDICTS if v.lower() == verdict.lower()), verdict)
    its = _by(OUTCOME.c.item, lambda of: of(OUTCOME.c.verdict) == known)
    own = ITEM.c.verdict == known
    return _Condition(union_all(select(ITEM.c.id).where(own), its.rows), or_(own, its.tried))
