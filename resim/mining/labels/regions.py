"""Labels by places of the user's own, for maps that do not say what they are of (Kaefer 2022, Figs. 4.48 and 4.49)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fnmatch import fnmatch

import numpy as np
import shapely

from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import stretches
from resim.mining.samples import Ints
from resim.mining.settings import MiningSettings, RegionWaySettings


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who passes one region, and another after it."""
    samples, visits = features.samples, dict[str, tuple[Ints, Ints]]()
    wanted = samples.kinds(frozenset(settings.kinds))
    for region in settings.region:
        inside = np.zeros(len(samples), dtype=bool)
        if fnmatch(features.lanes.network.path.name, region.map):
            inside = shapely.contains_xy(shapely.Polygon(region.corners), samples.x, samples.y) & wanted
        visits[region.name] = stretches(inside, samples.owner)
    for way in settings.way:
        yield from _ways(features, way, visits[way.first], visits[way.then])


def _ways(
    features: Features, way: RegionWaySettings, first: tuple[Ints, Ints], then: tuple[Ints, Ints]
) -> Iterator[LabelledManeuver]:
    """Each visit of the second region that the last visit of the first one leads to."""
    samples = features.samples
    taken = -1
    for entered, left in zip(then[0].tolist(), then[1].tolist(), strict=True):
        before = int(np.searchsorted(first[1], entered)) - 1
        if before < 0 or before == taken or samples.owner[first[1][before]] != samples.owner[entered]:
            continue
        taken, whole = before, way.span == "whole"
        start = int(first[0][before] if whole else first[1][before])
        end = left if whole else entered
        figures = {"duration_s": float(samples.t[end] - samples.t[start])}
        yield LabelledManeuver(way.label, int(samples.owner[entered]), start, end, entered, figures=figures)


FAMILIES.add(
    LabelFamily(
        "regions", (), find, "from one place of the user's own to another", "Kaefer 2022, 4.5.6.8, 4.5.6.9"
    )
)
