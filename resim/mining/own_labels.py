"""Labels of the user's own: functions that a file of thresholds names, loaded from its frozen copy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from resim.core.files import read_file
from resim.core.plugins.frozen import FrozenCopy, FrozenFile, load_frozen
from resim.core.plugins.loading import freeze_code, load_named
from resim.core.plugins.watchdog import Watchdog
from resim.mining.features import Features
from resim.mining.find import OwnLabel
from resim.mining.maneuver import LabelledManeuver, label_names
from resim.mining.settings import (
    DEFAULT_SETTINGS,
    EXAMPLE,
    MiningSettings,
    check_triggers,
    settings_of,
)

LIMIT = 600.0
"""s of wall clock for a user's label on one recording."""


@dataclass(frozen=True, eq=False)
class MiningRules:
    """Thresholds, and the user's own labels.

    Attributes:
        settings: The thresholds.
        own: Functions of own labels by name.
        hash: Of the file and the code that belongs to it; "" for what ships.
        frozen: The copy of both that is run.
    """

    settings: MiningSettings = DEFAULT_SETTINGS
    own: Mapping[str, OwnLabel] | None = None
    hash: str = ""
    frozen: FrozenFile | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        """All labels that may be found."""
        ways = dict.fromkeys(way.label for way in self.settings.way)
        return tuple(dict.fromkeys([*label_names(), *ways, *(self.own or {})]))


def read_rules(path: Path | None) -> MiningRules:
    """Read a file of thresholds with its own labels; None for what ships. Raises InputError."""
    return MiningRules() if path is None else rules_of(freeze_rules(path))


def rules_of(frozen: FrozenFile) -> MiningRules:
    """Give the rules that a frozen file says. Raises InputError."""
    copy = load_frozen(frozen, freeze_rules)
    settings = settings_of(copy.raw, frozen.path)
    own = {label.name: _own(frozen, copy, label.function) for label in settings.label}
    rules = MiningRules(settings, own, frozen.hash, frozen)
    check_triggers(settings, rules.labels, str(frozen.path))
    return rules


def _own(frozen: FrozenFile, copy: FrozenCopy, named: str) -> OwnLabel:
    """A user's function, run afresh and for a limited time each time, as own measures are."""
    function = load_named(frozen, copy, named, "label")

    def label(features: Features, found: Sequence[LabelledManeuver]) -> Iterable[LabelledManeuver]:
        with function.afresh(), Watchdog() as watchdog:
            told: Iterable[LabelledManeuver] = watchdog.call(
                LIMIT, lambda: list(function.load()(features, found))
            )
        return told

    return label


def freeze_rules(path: Path) -> FrozenFile:
    """Keep a copy of the file with the code that it names. Raises InputError."""
    raw = read_file(path, EXAMPLE)
    settings = settings_of(raw, path)
    return freeze_code(path, raw, [label.function for label in settings.label], list(settings.files))
