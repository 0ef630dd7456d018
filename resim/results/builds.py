"""Builds: what came out for each over time, and two of them side by side, the worst first."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from resim.results.catalog import Catalog
from resim.results.circumstances import FACET, VERSION, comparable, differences, read_circumstances
from resim.results.entry import ItemKind
from resim.results.lake import facts_of
from resim.results.overview import CatalogOverview, OutcomeOf, UsedInput
from resim.results.tones import WORST, tone

COMPARED: tuple[ItemKind, ...] = ("verification", "sweep", "run")
"""Results by which two builds are compared, those that say most first."""
MEASURED = ("GT", "SD")
"""Sources of what was measured, which is no build's doing here."""
Change = Literal["worse", "changed", "not comparable", "not known", "same", "better"]
CHANGES: tuple[Change, ...] = get_args(Change)
"""In the order in which they are told."""


@dataclass(frozen=True)
class KnownBuild:
    """A build that results know: its label, its hash and of how many. id: 16 hex digits."""

    id: str
    label: str
    hash: str
    results: int


@dataclass(frozen=True)
class BuildPair:
    """What came out for one recording with two builds, None where there is nothing.

    kind, source: of what outcomes. differs: in which circumstances the two differ, which keeps them from being
    compared. note: what to know of two that are compared.
    """

    recording: str
    kind: ItemKind
    source: str
    one: OutcomeOf | None
    other: OutcomeOf | None
    differs: tuple[str, ...] = ()
    note: str = ""

    @property
    def change(self) -> Change:
        """How the second is against the first.

        Not comparable: they came out under other circumstances. Not known: one is missing, or not judged. Changed:
        another verdict that is neither worse nor better, or the same one for another reason, by what is said before its
        details.
        """
        if self.one is None or self.other is None:
            return "not known"
        if self.differs:
            return "not comparable"
        if not (self.one.verdict and self.other.verdict):
            return "not known"
        first, second = WORST.index(tone(self.one.verdict)), WORST.index(tone(self.other.verdict))
        if first == second:
            reasons = [(o.verdict, o.cause.partition(":")[0]) for o in (self.one, self.other)]
            return "same" if reasons[0] == reasons[1] else "changed"
        return "worse" if second < first else "better"


def known_builds(overview: CatalogOverview) -> list[KnownBuild]:
    """Give all builds of a catalog, by label."""
    return [_known(one) for one in overview.inputs("build")]


def _known(one: UsedInput) -> KnownBuild:
    return KnownBuild(build_id(one.name, one.hash), one.name, one.hash, one.results)


def build_id(label: str, digest: str) -> str:
    """Give the id of a build that results know."""
    return hashlib.sha256(f"{label}\n{digest}".encode()).hexdigest()[:16]


def pairs(catalog: Catalog, one: KnownBuild, other: KnownBuild) -> list[BuildPair]:
    """Give what came out for each recording (by content) with two builds, what got worse first.

    Two outcomes are a pair where all circumstances but the builds are equal: criteria, models, seeds, settings. Of each
    recording, kind of result and source that is the newest such pair. A newer outcome without a counterpart stands
    beside it, as not comparable. Raises InputError where the database cannot be used.
    """
    overview = CatalogOverview(catalog)
    found: dict[tuple[str, ItemKind, str], tuple[list[OutcomeOf], list[OutcomeOf]]] = {}
    for k, build in enumerate((one, other)):
        for outcome in overview.of_build(build.label, build.hash, COMPARED):
            if outcome.source not in MEASURED:
                key = (outcome.hash, outcome.kind, outcome.source)
                found.setdefault(key, ([], []))[k].append(outcome)
    ids = sorted({o.result for both in found.values() for side in both for o in side})
    made = {i: read_circumstances(told[0]) for i, told in facts_of(catalog, ids, FACET).items()}
    every = [pair for both in found.values() for pair in _pairs(*both, made)]
    return sorted(
        every, key=lambda p: (CHANGES.index(p.change), p.recording, COMPARED.index(p.kind), p.source)
    )


def _pairs(
    ones: Sequence[OutcomeOf], others: Sequence[OutcomeOf], made: Mapping[str, Mapping[str, str]]
) -> Iterator[BuildPair]:
    """The pairs of one recording, kind and source; outcomes of both builds come the newest first."""

    def pair(a: OutcomeOf | None, b: OutcomeOf | None) -> BuildPair:
        told = a or b
        assert told is not None
        if a is None or b is None:
            return BuildPair(told.recording, told.kind, told.source, a, b)
        first, second = made.get(a.result, {}), made.get(b.result, {})
        versions = first.get(VERSION, ""), second.get(VERSION, "")
        note = "" if versions[0] == versions[1] else f"made with resim {versions[0]}, {versions[1]}"
        differs = differences(told.source, first, second)
        return BuildPair(told.recording, told.kind, told.source, a, b, differs, "" if differs else note)

    if not (ones and others):
        yield pair(ones[0] if ones else None, others[0] if others else None)
        return
    newest: dict[frozenset[tuple[str, str]], OutcomeOf] = {}
    for b in others:
        newest.setdefault(_key(b, made), b)
    equal = [pair(a, newest[key]) for a in ones if (key := _key(a, made)) and key in newest]
    best = max(equal, key=_newest, default=None)
    if best is not None:
        yield best
    if best is None or (best.one, best.other) != (ones[0], others[0]):
        yield pair(ones[0], others[0])


def _key(outcome: OutcomeOf, made: Mapping[str, Mapping[str, str]]) -> frozenset[tuple[str, str]]:
    """What is equal for outcomes under equal circumstances; nothing where these are not known."""
    return frozenset(comparable(outcome.source, made.get(outcome.result, {})).items())


def _newest(pair: BuildPair) -> tuple[str, str]:
    written = sorted(o.written for o in (pair.one, pair.other) if o is not None)
    return written[-1], written[0]
