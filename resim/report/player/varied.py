"""Variations of a drive as the player shows them: a bundle around their origin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from resim.core.clock import regular
from resim.core.tracks import Tracks
from resim.report.player.colors import BUNDLE
from resim.report.player.drive import Layer, PlayedDrive
from resim.report.player.measured import of_scenario
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario


def of_variations(
    origin: Scenario, varied: Mapping[int, Scenario], objects: Sequence[str], network: RoadNetwork, name: str
) -> PlayedDrive:
    """Give the origin, and in a layer above it its varied objects, of every variation by its number.

    An object of variation 12 is called `id~12` there.
    """
    drive = of_scenario(origin, network, name)
    t = regular(origin.ego.spawn_time, origin.duration, 0.04)
    bundle = [_named(one.tracks(network, t).select(objects), number) for number, one in varied.items()]
    if not bundle:
        return drive
    layer = Layer(BUNDLE, f"{len(bundle)} variations", _together(bundle))
    (own,) = drive.layers
    own = replace(own, title="origin")
    note = f"{len(bundle)} variations of {', '.join(objects)}; the EGO is that of the origin."
    return replace(drive, layers=(own, layer), notes=(*drive.notes, note))


def _named(tracks: Tracks, number: int) -> Tracks:
    return replace(
        tracks, ids=np.array([f"{one}~{number}" for one in tracks.ids.tolist()], dtype=str), z=None
    )


def _together(parts: Sequence[Tracks]) -> Tracks:
    """All objects of tracks at the same times."""
    names = ("ids", "kind", "x", "y", "heading", "v", "length", "width", "valid")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return replace(parts[0], **joined, a=None, yaw_rate=None)
