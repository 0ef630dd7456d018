"""One variation: a point in the box around the original's components, and the drive that it gives (Wagner 2021, 6.1.3).

Readings taken: the box reaches box * (c_max - c_min) to either side of each component (Fig. 6.5), and is not cut at
c_min and c_max.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.scenario.fit import refit_trace
from resim.scenario.scenario import RoadPosition, Scenario, ScenarioObject, fit_height
from resim.scenario.variation import moved_heights, moved_tracks
from resim.variations.joining import ManeuverChange, joined_motion
from resim.variations.lane_motion import LaneMotion
from resim.variations.origin import VariedOrigin, object_of


@dataclass(frozen=True, eq=False)
class VariedDrive:
    """A variation of a drive.

    Attributes:
        scenario: The drive.
        components: (D,) of all maneuvers, one after the other.
        offset: (D,) by how much they are away from the original's.
        distance: From the original, in standard deviations of the data over all components (Mahalanobis).
        motions: The varied objects, in their lanes, by id.
        off: m, the largest distance of a varied object's trace from where the variation is.
    """

    scenario: Scenario
    components: Floats
    offset: Floats
    distance: float
    motions: dict[str, LaneMotion]
    off: float


def offsets(origin: VariedOrigin, points: Floats, box: float) -> Floats:
    """Give the offsets (K, D) of components for points (K, D) of the unit cube."""
    widths = np.concatenate([one.kernel.box for one in origin.maneuvers])
    return np.asarray((2.0 * points - 1.0) * box * widths)


def distance(origin: VariedOrigin, offset: Floats) -> float:
    """Give how far an offset (D,) of components is from the original, in standard deviations of the data.

    A component without spread in the data counts only where it is changed: then the distance is infinite.
    """
    sd = np.concatenate([one.kernel.sd for one in origin.maneuvers])
    ratio = np.divide(offset, sd, out=np.where(offset == 0.0, 0.0, np.inf), where=sd > 0.0)
    return float(np.sqrt(np.square(ratio).sum()))


def varied_drive(origin: VariedOrigin, offset: Floats) -> VariedDrive:
    """Give the variation with an offset (D,) of components. Raises ResimError where time would turn back in it."""
    parts = np.split(offset, np.cumsum([one.kernel.count for one in origin.maneuvers])[:-1])
    motions = dict(origin.motions)
    changes = [*zip(origin.maneuvers, parts, strict=True)]
    for maneuver, part in sorted(
        changes, key=lambda pair: -pair[0].of.start
    ):  # what follows one moves along with it
        change = ManeuverChange(maneuver.of.start, maneuver.of.end, part @ maneuver.kernel.axes)
        try:
            motions[maneuver.of.object] = joined_motion(motions[maneuver.of.object], change)
        except ValueError as e:
            raise ResimError(str(e)) from e
    made, off = {}, 0.0
    for name, motion in motions.items():
        made[name], own = _object(origin, name, motion)
        off = max(off, own)
    objects = tuple(made.get(one.id, one) for one in origin.scenario.objects)
    components = np.concatenate([one.components for one in origin.maneuvers]) + offset
    return VariedDrive(
        replace(origin.scenario, objects=objects), components, offset, distance(origin, offset), motions, off
    )


def _object(origin: VariedOrigin, name: str, motion: LaneMotion) -> tuple[ScenarioObject, float]:
    """An object that moves otherwise, fitted again from its own trace; and how far [m] the fit is off."""
    one, network = object_of(origin.scenario, name), origin.network
    trace = origin.scenario.traces(network)[1 + origin.scenario.objects.index(one)]
    x, y = motion.path.xy(motion.s, motion.d)
    whole = origin.scenario.tracks(network, motion.t).select([name])
    moved = moved_tracks(whole, motion.t, x, y)
    fit = refit_trace(trace, motion.t, x, y, moved.heading[0], moved.v[0])
    height = None
    if whole.z is not None:
        height = fit_height(replace(moved, z=moved_heights(network, whole, moved)), 0)
    z0 = None if height is None else height(height.x[:1])
    at = network.to_road([fit.trace.x0], [fit.trace.y0], heading=moved.heading[0, :1], z=z0)
    start = RoadPosition(str(at.road[0]), int(at.lane[0]), float(at.s[0]), float(at.t[0]))
    made = replace(one, start=start, v=fit.trace.v, heading=fit.trace.heading, z=height)
    return made, float(fit.distance.max())


def with_sizes(scenario: Scenario, sizes: Sequence[tuple[str, str, float, float]]) -> Scenario:
    """Give the scenario with other kinds and sizes: id, kind, length, width [m] of each object that has others."""
    told = {name: (kind, length, width) for name, kind, length, width in sizes}
    objects = []
    for one in scenario.objects:
        kind, length, width = told.get(one.id, (one.kind, one.length, one.width))
        objects.append(replace(one, kind=kind, length=length, width=width))
    return replace(scenario, objects=tuple(objects))
