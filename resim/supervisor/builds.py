"""Builds: what came out for each over time, and two of them side by side, the worst first."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

from resim.results.entry import ItemKind
from resim.results.overview import CatalogOverview, OutcomeOf, UsedInput
from resim.supervisor.words import WORST, tone

COMPARED: tuple[ItemKind, ...] = ("verification", "sweep", "run")
"""Results by which two builds are compared, those that say most first."""


@dataclass(frozen=True)
class KnownBuild:
    """A build that results know: its label, its hash and of how many. id: 16 hex digits."""

    id: str
    label: str
    hash: str
    results: int


@dataclass(frozen=True)
class BuildPair:
    """What came out for one recording with two builds, None where there is nothing. kind, source: of what outcomes."""

    recording: str
    kind: ItemKind
    source: str
    one: OutcomeOf | None
    other: OutcomeOf | None

    @property
    def change(self) -> str:
        """How the second is against the first: worse, better, same, changed, or not known where one is not judged.

        Changed: another verdict that is neither worse nor better, or the same one for another reason, by what is said
        before its details.
        """
        if self.one is None or self.other is None or not (self.one.verdict and self.other.verdict):
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


def pairs(overview: CatalogOverview, one: KnownBuild, other: KnownBuild) -> list[BuildPair]:
    """Give what came out for each recording (by content) with two builds, what got worse first."""
    found: dict[tuple[str, str, ItemKind, str], list[OutcomeOf | None]] = {}
    for k, build in enumerate((one, other)):
        for outcome in overview.of_build(build.label, build.hash, COMPARED):
            key = (outcome.recording, outcome.hash, outcome.kind, outcome.source)
            pair = found.setdefault(key, [None, None])
            if pair[k] is None and outcome.source not in (
                "GT",
                "SD",
            ):  # what was measured is no build's doing here
                pair[k] = outcome
    made = [BuildPair(name, kind, source, *_two(both)) for (name, _, kind, source), both in found.items()]
    order = ("worse", "changed", "not known", "same", "better")
    told = [pair for pair in made if pair.one is not None or pair.other is not None]
    return sorted(told, key=lambda p: (order.index(p.change), p.recording, COMPARED.index(p.kind), p.source))


def _two(both: Sequence[OutcomeOf | None]) -> tuple[OutcomeOf | None, OutcomeOf | None]:
    return both[0], both[1]
