"""The objects of a stage as traffic that reacts: their ways, their drivers, whom they followed; kept for other runs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from resim.simulation.guide import Guide
from resim.simulation.reactive.drivers import GRID, Following, TrafficDriver, driver_of, fitted
from resim.simulation.reactive.settings import ReactiveSettings
from resim.simulation.reactive.ways import Boxed, Way
from resim.simulation.traffic import Stage


def boxed(stage: Stage, plan: Guide, k: int) -> Boxed:
    """Give all of them, EGO first, where a plan has them at step k."""
    z = np.full(len(stage.members), np.nan) if plan.z is None else plan.z[:, k]
    place = plan.x[:, k] + 1j * plan.y[:, k]
    return Boxed(place, plan.heading[:, k], plan.v[:, k], stage.length, stage.width, z)


@lru_cache(maxsize=8)
def _known(stage: Stage) -> tuple[dict[int, Way], dict[tuple[int, ReactiveSettings], TrafficDriver | None]]:
    """Ways and drivers of a stage that were asked for."""
    return {}, {}


def way_of(stage: Stage, row: int) -> Way:
    """Give the way of an object of a stage."""
    ways, _ = _known(stage)
    if row not in ways:
        ways[row] = Way(stage.plan, row, stage.members[row].length, stage.members[row].width)
    return ways[row]


def traffic_driver(stage: Stage, settings: ReactiveSettings, row: int) -> TrafficDriver | None:
    """Give the driver of an object; None for who has none: a pedestrian, who reverses, who is there for a step."""
    _, drivers = _known(stage)
    if (row, settings) not in drivers:
        kind, way = settings.of(stage.members[row].kind), way_of(stage, row)
        driver = None
        if kind is not None and way.forwards and way.count > 1:
            driver = driver_of(kind, way.v)
            driver = fitted(driver, [*followings(stage, row)]) if settings.calibrated else driver
        drivers[row, settings] = driver
    return drivers[row, settings]


def usual_driver(stage: Stage, settings: ReactiveSettings, row: int) -> TrafficDriver:
    """Give the usual driver of an object's kind, who wants to go as fast as it did; a car's where a kind has none."""
    return driver_of(settings.of(stage.members[row].kind) or settings.car, way_of(stage, row).v)


def followings(stage: Stage, row: int) -> Iterator[Following]:
    """Give the stretches over which an object followed one leader in the measured drive, from its start on."""
    plan, way = stage.plan, way_of(stage, row)
    others = [m for m in range(len(stage.members)) if m != row]
    dt = float(plan.t[1] - plan.t[0])
    every = max(round(GRID / dt), 1)
    places = np.arange(max(plan.begin - way.first, 0), way.count, every)
    who, gap, lead_v = np.full(len(places), -1), np.full(len(places), np.nan), np.full(len(places), np.nan)
    for k, at in enumerate(places.tolist() if others else ()):
        there = way.others(float(way.s[at]), boxed(stage, plan, way.first + at).of(others))
        first = int(np.argmin(there.gap))
        if 0.0 < there.gap[first] < math.inf:
            who[k], gap[k], lead_v[k] = others[first], there.gap[first], there.v[first]
    for part in np.split(np.arange(len(places)), np.flatnonzero(np.diff(who)) + 1):
        if len(part) and who[part[0]] >= 0:
            among = places[part]
            yield Following(way.s[among], way.v[among], gap[part], lead_v[part], every * dt)
