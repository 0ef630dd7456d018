"""All maneuvers of a drive: every family of labels in its order, then the user's own labels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import resim.mining.labels as labels
from resim.core.errors import FunctionError
from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelledManeuver
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
    try:
        told = list(label(features, tuple(found)))
    except Exception as e:  # whatever a user's function raises
        raise FunctionError(f"label {name!r}: {type(e).__name__}: {e}") from e
    for maneuver in told:
        if not isinstance(maneuver, LabelledManeuver) or maneuver.label != name:
            raise FunctionError(f"label {name!r}: expected maneuvers of that label, got {maneuver!r}")
        low, high = features.samples.first[maneuver.object], features.samples.first[maneuver.object + 1]
        if not low <= maneuver.start <= maneuver.end < high:
            raise FunctionError(
                f"label {name!r}: samples {maneuver.start} to {maneuver.end} are not of its object"
            )
    return told
