"""A recipe made to tracks: exact motion of all its objects, nobody in anybody else, and the table of truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.clock import regular
from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.core.overlaps import first_overlaps
from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork
from resim.scenario.generation.drive import GeneratedObject, object_motion, wrapped
from resim.scenario.generation.recipe import Recipe
from resim.scenario.generation.truth import TrueManeuver


@dataclass(frozen=True, eq=False)
class GeneratedDrive:
    """What a recipe makes.

    Attributes:
        tracks: All objects, EGO first, with exact speed, heading, acceleration and yaw rate.
        maneuvers: What they do.
    """

    tracks: Tracks
    maneuvers: tuple[TrueManeuver, ...]


def generate(recipe: Recipe, network: RoadNetwork) -> GeneratedDrive:
    """Make the drive of a recipe on its map.

    Raises ResimError that names object and field where a route or a speed is impossible, where the EGO is not there
    from beginning to end, or where two overlap that the recipe does not let overlap.
    """
    times = sample_times(recipe.duration, recipe.rate)
    specs = sorted(recipe.object, key=lambda one: one.id != recipe.ego)
    made = []
    for spec in specs:
        try:
            made.append(object_motion(network, spec, recipe.duration, times))
        except ResimError as e:
            raise ResimError(f"object {spec.id!r}: {e}") from e
    _check_presence(recipe, made, times)
    tracks = _tracks(made, times)
    _refuse_overlaps(recipe, tracks)
    return GeneratedDrive(tracks, tuple(row for one in made for row in one.maneuvers))


def sample_times(duration: float, rate: float) -> Floats:
    """Give the times (T,) [s] from 0 to the duration [s], at so many samples a second [Hz]."""
    return np.round(regular(0.0, duration, 1.0 / rate), 9)


def _check_presence(recipe: Recipe, made: list[GeneratedObject], times: Floats) -> None:
    for one in made:
        if len(one.t) < 2:
            raise ResimError(f"object {one.spec.id!r}: has {len(one.t)} sample(s), expected 2 or more")
    ego = made[0]
    if len(ego.t) < len(times):
        first, last = float(ego.t[0]), float(ego.t[-1])
        problem = (
            f"object {recipe.ego!r}: the EGO is there from {first:g} to {last:g} s of {recipe.duration:g} s"
        )
        remedy = "its route ends, or it appears late; make the route longer or the duration shorter"
        raise ResimError(f"{problem}: {remedy}")


def _tracks(made: list[GeneratedObject], times: Floats) -> Tracks:
    out = np.full((6, len(made), len(times)), np.nan)
    for n, one in enumerate(made):
        out[:, n, np.searchsorted(times, one.t - 1e-9)] = wrapped(one.states)
    x, y, heading, v, a, yaw_rate = out
    return Tracks(
        t=times, ids=np.array([one.spec.id for one in made], dtype=str),
        kind=np.array([one.spec.kind for one in made], dtype=str), x=x, y=y, heading=heading, v=v,
        length=np.array([one.spec.size[0] for one in made]), width=np.array([one.spec.size[1] for one in made]),
        valid=np.isfinite(x), yaw_rate=yaw_rate, a=a,
    )  # fmt: skip


def _refuse_overlaps(recipe: Recipe, tracks: Tracks) -> None:
    allowed = {frozenset(pair) for pair in recipe.overlaps}
    for n, m, t in sorted(first_overlaps(tracks)):
        one, two = str(tracks.ids[n]), str(tracks.ids[m])
        if frozenset((one, two)) not in allowed:
            raise ResimError(
                f"object {one!r}: overlaps {two!r} from t = {t:g} s on; move one of them, or allow it by "
                f'overlaps = [["{one}", "{two}"]]'
            )
