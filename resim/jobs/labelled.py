"""Maneuvers of a drive that is exported, by the labels that ship or by one's own, which run in a child."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from resim.core.errors import InputError
from resim.core.plugins.frozen import FrozenFile
from resim.execution.child import Failure
from resim.execution.workers import run_all
from resim.mining.features import features
from resim.mining.find import find_maneuvers
from resim.mining.own_labels import LIMIT, MiningRules, read_rules, rules_of
from resim.mining.rows import maneuver_frame
from resim.report.player import PlayedDrive
from resim.report.player.drive import Layer
from resim.road.opendrive import RoadNetwork, load


def with_maneuvers(played: PlayedDrive, labels: Path | None) -> PlayedDrive:
    """Give a drive with the maneuvers that `resim mine` finds in it; of what sensors perceived nothing is looked for.

    Args:
        played: The drive.
        labels: Thresholds and own labels, as `mine` takes them; None for what ships.

    Returns:
        The drive with them.

    Raises:
        InputError: The file of labels is wrong, or its code failed.
    """
    rules = read_rules(labels)
    if rules.frozen is None or not rules.own:
        layers = tuple(_with_maneuvers(layer, played.network, rules) for layer in played.layers)
        return replace(played, layers=layers)
    task = played.layers, played.network.path, rules.frozen
    limit = LIMIT * (1 + len(rules.own)) * len(played.layers)
    ((_, found),) = run_all(_label_layers, [task], workers=1, time_limit=limit)
    if isinstance(found, Failure):
        raise InputError(rules.frozen.path, f"its labels could not be found: {found.reason}")
    return replace(played, layers=found)


def _label_layers(task: tuple[tuple[Layer, ...], Path, FrozenFile]) -> tuple[Layer, ...]:
    """Find maneuvers in a child, by labels of the user's own from their frozen copy."""
    layers, road, frozen = task
    network, rules = load(road), rules_of(frozen)
    return tuple(_with_maneuvers(layer, network, rules) for layer in layers)


def _with_maneuvers(layer: Layer, network: RoadNetwork, rules: MiningRules) -> Layer:
    if layer.is_sensed:
        return layer
    found = features(layer.tracks, network)
    maneuvers = find_maneuvers(found, rules.settings, rules.own)
    return replace(layer, maneuvers=maneuver_frame(layer.name, found, maneuvers))
