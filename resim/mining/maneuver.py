"""What a label says: who did what, from when to when, with whom."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from resim.core.registry import Registry
from resim.mining.features import Features
from resim.mining.settings import MiningSettings


@dataclass(frozen=True)
class LabelledManeuver:
    """A label of one object.

    Attributes:
        label: Its name.
        object: Row of the object in the tracks.
        start: Its first sample, counted as in `Samples`.
        end: Its last sample, likewise.
        at: The sample that defines it.
        partner: Row of the object that it concerns, -1 for none.
        figures: Numbers by name, with the unit behind it: `ttc_s`.
    """

    label: str
    object: int
    start: int
    end: int
    at: int
    partner: int = -1
    figures: Mapping[str, float] = field(default_factory=dict)


FindManeuvers = Callable[[Features, MiningSettings, Sequence[LabelledManeuver]], Iterable[LabelledManeuver]]
"""Takes features, thresholds and what was found so far; gives maneuvers."""


@dataclass(frozen=True)
class LabelFamily:
    """Labels that are found together.

    Attributes:
        name: Its name.
        labels: The names of its labels.
        find: Finds them.
        meaning: What they are, in a sentence.
        source: Where the definition comes from.
    """

    name: str
    labels: tuple[str, ...]
    find: FindManeuvers
    meaning: str
    source: str


FAMILIES: Registry[LabelFamily] = Registry("family of labels")
"""All families, in the order in which they are found: later ones may need earlier ones."""


def drove(features: Features, label: str, start: int, end: int, at: int) -> LabelledManeuver:
    """Give a maneuver with its speed at the sample that defines it, and how long it lasts."""
    samples = features.samples
    figures = {"v_mps": float(samples.v[at]), "duration_s": float(samples.t[end] - samples.t[start])}
    return LabelledManeuver(label, int(samples.owner[at]), start, end, at, figures=figures)


def label_names() -> tuple[str, ...]:
    """Give the names of all labels that ship."""
    return tuple(label for family in FAMILIES for label in family.labels)
