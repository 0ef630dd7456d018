"""A whole drive varied: motion of everybody, their types and colours, time of day and weather."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

import numpy as np

from resim.core.distribution import RandomNumber
from resim.core.geometry import Floats, wrap_angle
from resim.core.overlaps import first_overlaps
from resim.core.tracks import Tracks
from resim.scenario.augmentation.motion import VariedMotion, vary_motion
from resim.scenario.augmentation.settings import (
    AugmentationSettings,
    PathNoise,
    SpeedNoise,
    VehicleType,
    Weather,
)
from resim.scenario.fit import fit_trace
from resim.scenario.trace import Trace

TRIES = 30
"""Draws of one variation before it is given up; each fifth varies half as much."""
VEHICLES = ("car", "van", "truck", "bus")


@dataclass(frozen=True, eq=False)
class AugmentedDrive:
    """A variation of a drive.

    Attributes:
        tracks: Everybody.
        colors: By id, as in JSCEN.
        types: By id the type drawn, where one was.
        environment: In JSCEN's terms.
        weather: In OpenSCENARIO's terms, "" where none is drawn.
        moments: By id (2, M) times [s] of the origin, and when the object is at the same place here.
    """

    tracks: Tracks
    colors: Mapping[str, str]
    types: Mapping[str, str]
    environment: Mapping[str, str]
    weather: str
    moments: Mapping[str, Floats]


def augmentations(
    tracks: Tracks, ego: str, settings: AugmentationSettings, seed: int, number: int
) -> Iterator[AugmentedDrive]:
    """Give draws of one variation after the other, without overlaps that the origin has not; `TRIES` at most.

    number: of the variation; the same seed and number give the same draws. A sample is that of a smooth trace fitted to
    the origin's, so that noise of measurement does not add to the variation's.
    """
    rng = np.random.default_rng([seed, number])
    allowed = {frozenset((n, m)) for n, m, _ in first_overlaps(tracks)}
    traces = [_trace(tracks, n) for n in range(len(tracks))]
    for attempt in range(TRIES):
        path, speed = _weaker(settings, 0.5 ** (attempt // 5))
        moved: list[VariedMotion | None] = []
        moments: dict[str, Floats] = {}
        for n, name in enumerate(tracks.ids.tolist()):
            trace = None if name == ego and not settings.ego else traces[n]
            one = None if trace is None else vary_motion(trace, tracks.t[tracks.valid[n]], path, speed, rng)
            moved.append(one)
            if one is not None:
                moments[name] = one.moments
        made, types = _typed(_varied(tracks, moved), settings, rng)
        colors = {name: _color(rng) for name in tracks.ids.tolist()} if settings.colors else {}
        environment, weather = _environment(settings, rng)
        new = {frozenset((n, m)) for n, m, _ in first_overlaps(made)}
        if new <= allowed and made.valid.any(axis=1).all():
            yield AugmentedDrive(made, colors, types, environment, weather, moments)


def _trace(tracks: Tracks, n: int) -> Trace | None:
    own = tracks.valid[n]
    if own.sum() < 4 or not _whole(own):
        return None
    return fit_trace(
        tracks.t[own], tracks.x[n, own], tracks.y[n, own], tracks.heading[n, own], tracks.v[n, own]
    ).trace


def _whole(own: np.ndarray) -> bool:
    """Whether an object is there without a gap; who has one stays as it is."""
    known = np.flatnonzero(own)
    return bool(len(known) == known[-1] - known[0] + 1)


def _weaker(settings: AugmentationSettings, share: float) -> tuple[PathNoise | None, SpeedNoise | None]:
    """The settings with this share of their noise."""
    path, speed = settings.path, settings.speed
    if path is not None:
        path = path.model_copy(
            update={name: _scaled(getattr(path, name), share) for name in ("offset", "noise")}
        )
    if speed is not None:
        speed = speed.model_copy(update={"noise": _scaled(speed.noise, share)})
    return path, speed


def _scaled(one: RandomNumber, share: float) -> RandomNumber:
    told = {
        name: value * share
        for name in ("mean", "sd", "min", "max")
        if (value := getattr(one, name)) is not None
    }
    return one.model_copy(update=told)


def _varied(tracks: Tracks, moved: Sequence[VariedMotion | None]) -> Tracks:
    x, y, heading, v = (c.copy() for c in (tracks.x, tracks.y, tracks.heading, tracks.v))
    valid = tracks.valid.copy()
    for n, one in enumerate(moved):
        if one is None:
            continue
        for column in (x, y, heading, v):
            column[n] = np.nan
        k = np.searchsorted(tracks.t, one.t - 1e-9)
        x[n, k], y[n, k], turned, v[n, k] = one.states
        heading[n, k] = wrap_angle(turned)
        valid[n] = np.isfinite(x[n])
    return replace(tracks, x=x, y=y, heading=heading, v=v, valid=valid, a=None, yaw_rate=None, z=None)


def _typed(
    tracks: Tracks, settings: AugmentationSettings, rng: np.random.Generator
) -> tuple[Tracks, dict[str, str]]:
    """Vehicles with types that can drive as they do."""
    kind, length, width = tracks.kind.tolist(), tracks.length.copy(), tracks.width.copy()
    types: dict[str, str] = {}
    for n, name in enumerate(tracks.ids.tolist()):
        wanted = rng.random() < settings.change_type
        fits = [one for one in settings.type if _can(one, tracks, n)]
        shares = np.array([one.weight for one in fits])
        chosen = rng.random()  # drawn for everybody, so that one object does not change the draws of the next
        if wanted and fits and str(tracks.kind[n]) in VEHICLES:
            drawn = fits[
                int(np.searchsorted(np.cumsum(shares / shares.sum()), chosen).clip(0, len(fits) - 1))
            ]
            kind[n], length[n], width[n], types[name] = drawn.kind, drawn.length, drawn.width, drawn.name
    return replace(tracks, kind=np.array(kind, dtype=str), length=length, width=width), types


def _can(one: VehicleType, tracks: Tracks, n: int) -> bool:
    own = tracks.valid[n]
    v = np.abs(tracks.v[n, own])
    if not len(v) or v.max() > one.top_speed:
        return False
    hardest = np.max(np.diff(v) / np.diff(tracks.t[own]), initial=0.0)
    return bool(hardest <= one.acceleration)


def _color(rng: np.random.Generator) -> str:
    return "#{:02x}{:02x}{:02x}".format(*rng.integers(0, 256, 3).tolist())


def _environment(settings: AugmentationSettings, rng: np.random.Generator) -> tuple[dict[str, str], str]:
    out, words = {}, ""
    if settings.day is not None:
        first, last = settings.day
        whole = int((last - first).total_seconds())
        moment: datetime = first + timedelta(seconds=int(rng.integers(0, whole + 1)))
        out["dateTime"] = moment.isoformat()
    if settings.weather:
        shares = np.array([one.weight for one in settings.weather])
        drawn: Weather = settings.weather[int(rng.choice(len(shares), p=shares / shares.sum()))]
        out |= environment_of(drawn)
        words = (
            f"cloudState {drawn.cloud_state}, precipitation {drawn.precipitation} {drawn.intensity:g} mm/h, "
        )
        words += f"fog visualRange {drawn.visual_range:g} m"
    return out, words


def environment_of(weather: Weather) -> dict[str, str]:
    """Give what JSCEN's environment says of a weather."""
    dry, clear = weather.precipitation == "dry", weather.visual_range >= 100_000.0
    return {
        "precipitationDensity": "None" if dry else f"{weather.precipitation} {weather.intensity:g} mm/h",
        "fogDensity": "None" if clear else f"visualRange {weather.visual_range:g} m",
    }
