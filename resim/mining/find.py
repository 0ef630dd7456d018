"""All maneuvers of a drive: every family of labels in its order, then the user's own labels."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

import resim.mining.labels as labels
from resim.core.errors import FunctionError
from resim.core.geometry import sealed
from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelledManeuver
from resim.mining.rows import MANEUVER_COLUMNS
from resim.mining.settings import DEFAULT_SETTINGS, MiningSettings

OwnLabel = Callable[[Features, Sequence[LabelledManeuver]], Iterable[LabelledManeuver]]

assert labels.__all__  # imported for the labels that it adds


def find_maneuvers(
    features: Features,
    settings: MiningSettings = DEFAULT_SETTINGS,
    own: Mapping[str, OwnLabel] | None = None,
) -> list[LabelledManeuver]:
    """Give all maneuvers, by object, then by start, then as the families are ordered.

    own: the user's labels by name. Raises FunctionError for one that gives no maneuvers of that name.
    """
    found: list[LabelledManeuver] = []
    for family in FAMILIES:
        found += list(family.find(features, settings, found))
    for name, label in (own or {}).items():
        found += _own(name, label, features, found)
    order = {label: k for k, label in enumerate(dict.fromkeys(m.label for m in found))}
    return sorted(found, key=lambda m: (m.object, m.start, m.end, order[m.label], m.at))


def _own(
    name: str, label: OwnLabel, features: Features, found: Sequence[LabelledManeuver]
) -> list[LabelledManeuver]:
    """What a user's own label gives, looked at."""
    sealed(features.samples)
    sealed(features)
    try:
        told = list(label(features, tuple(found)))
    except Exception as e:  # whatever a user's function raises
        raise FunctionError(f"label {name!r}: {type(e).__name__}: {e}") from e
    for maneuver in told:
        if problem := _problem(name, maneuver, features):
            raise FunctionError(f"label {name!r}: {problem}")
    return told


def _problem(name: str, maneuver: object, features: Features) -> str:
    """What is wrong with a maneuver that a user's label gives; "" for nothing."""
    if not isinstance(maneuver, LabelledManeuver) or maneuver.label != name:
        return f"expected maneuvers of that label, got {maneuver!r}"
    count, m = len(features.samples.tracks), maneuver
    if not all(isinstance(n, (int, np.integer)) for n in (m.object, m.start, m.end, m.at, m.partner)):
        return f"expected object, start, end, at and partner as integers, got {maneuver!r}"
    if not (0 <= m.object < count and -1 <= m.partner < count):
        return (
            f"object {m.object} or partner {m.partner} is no row of the {count} tracks (partner -1: nobody)"
        )
    low, high = features.samples.first[m.object : m.object + 2]
    if not low <= m.start <= m.at <= m.end < high:
        return f"samples {m.start} to {m.end}, at {m.at}, are not of its object ({low} to {high - 1}), or in no order"
    for figure, value in m.figures.items():
        if figure in MANEUVER_COLUMNS or not re.fullmatch(r"[a-z][a-z0-9_]*", str(figure)):
            return (
                f"figure {figure!r}: expected a name of small letters that is no column of maneuvers.parquet"
            )
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
            return f"figure {figure!r}: expected a number, got {value!r}"
    return ""
