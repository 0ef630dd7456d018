"""What numbers of a table tell by themselves: units of time, motion, conventions of headings, separators, zones."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.geometry import Bools, Floats, wrap_angle
from resim.recordings.mapped.motion import REACH, TURN
from resim.recordings.mapped.rows import LONGEST
from resim.recordings.mapped.units import FACTORS, TIMES
from resim.road.opendrive import RoadNetwork

MOVES = 2.0
"""Speed [m/s] from which on the direction of motion, and its ratio to the speed, says something."""
FITS = 0.1
"""Median misfit of headings [rad], and of speeds [of 1], at which a unit or a convention is the right one."""
CLEAR = 2.0
"""Times by which another convention has to fit worse to be none."""
STEPS = (("s", 1e-3, 2.1), ("ms", 4.9, 2100.0), ("us", 4900.0, 2.1e6), ("ns", 4.9e6, 2.1e9))
"""Time steps that are plausible in each unit."""
UNIX = (("ns", 1e17), ("us", 1e14), ("ms", 1e11), ("s", 1e8))
"""From which number on a time is one of a calendar, in each unit."""
SIZES = {"length": (("m", 1.0, 40.0), ("cm", 100.0, 4000.0), ("mm", 1000.0, 4e4)),
         "width": (("m", 0.3, 5.0), ("cm", 30.0, 500.0), ("mm", 300.0, 5000.0))}  # fmt: skip
"""Median sizes that are plausible in each unit."""


def motion(ids: pd.Series, t: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Give course [rad] and speed [m/s] of positions (K,) [m], NaN where there are fewer than three."""
    course, speed = np.full(len(t), np.nan), np.full(len(t), np.nan)
    for indices in pd.Series(ids.to_numpy()).groupby(ids.to_numpy()).indices.values():
        rows = np.asarray(indices)
        own = rows[np.isfinite(x[rows]) & np.isfinite(y[rows])]
        own = own[np.argsort(t[own], kind="stable")]
        _, first = np.unique(t[own], return_index=True)
        own = own[first]
        if len(own) < 3:
            continue
        times, p = t[own], x[own] + 1j * y[own]
        reach = max(REACH, float(np.median(np.diff(times))))
        early, late = (np.clip(times + by, times[0], times[-1]) for by in (-reach, reach))
        velocity = (np.interp(late, times, p) - np.interp(early, times, p)) / (late - early)
        course[own], speed[own] = np.angle(velocity), np.abs(velocity)
    return course, speed


def ranked(raw: Floats, course: Floats, drives: Bools, unit: str) -> list[tuple[float, str, str, bool]]:
    """Give median misfit [rad], unit, zero and direction of each convention of headings, the best first.

    raw, course: (K,) as they stand, and rad; drives: (K,) whether the course says something. Numbers beyond TURN are no
    radians; of a name that has a unit, that unit alone counts.
    """
    return sorted(_misfits(raw[drives], course[drives], units_of(raw, unit)), key=lambda one: one[0])


def units_of(raw: Floats, unit: str) -> tuple[str, ...]:
    """Give the units in which headings (K,) can be; unit: that of the column's name, "" where it has none."""
    if unit in ("rad", "deg", "mrad"):
        return (unit,)
    return ("deg",) if np.nanmax(np.abs(raw)) > TURN else ("rad", "deg")


def _misfits(raw: Floats, course: Floats, units: tuple[str, ...]) -> Iterator[tuple[float, str, str, bool]]:
    for turns in units:
        factor = FACTORS[turns]
        for zero, offset in (("x", 0.0), ("north", 0.5 * np.pi)):
            for clockwise in (False, True):
                heading = (-1.0 if clockwise else 1.0) * raw * factor + offset
                yield float(np.median(np.abs(wrap_angle(heading - course)))), turns, zero, clockwise


def dialect(path: Path) -> tuple[str, str]:
    """Give what stands between values, and before decimals."""
    if path.suffix == ".parquet" or not path.is_file():
        return ",", "."
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        lines = [line for _ in range(20) if (line := file.readline(LONGEST))]
    head = lines[0] if lines else ""
    separator = max(",;\t|", key=head.count)
    body = "".join(lines[1:])
    return separator, "," if separator != "," and body.count(",") > body.count(".") else "."


def usual_step(ids: pd.Series, t: Floats) -> float:
    """Give the usual step of an object's times."""
    steps = pd.Series(t).groupby(ids.to_numpy(), sort=False).diff().to_numpy(float)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else 0.0


def time_unit(raw: Floats, step: float, told: str) -> tuple[str, str]:
    """Give the unit of times, "" where nothing tells; and why."""
    if told in TIMES:
        return told, f"by its name; steps of {step:g}"
    first = abs(float(np.nanmin(raw)))
    for unit, least in UNIX:
        if first > least:
            return unit, f"{first:.10g} is a Unix time in {unit}"
    fitting = [unit for unit, low, high in STEPS if low <= step <= high]
    whole = bool((raw == np.round(raw)).all())
    if len(fitting) != 1 or (whole and step < 2.0):
        return "", ""
    return fitting[0], f"steps of {step:g}"


def utm_zone(network: RoadNetwork | None) -> str:
    """Give the EPSG code of the UTM zone that the map lies in, "" where it does not tell."""
    from pyproj import Transformer

    from resim.recordings.mapped.frames import map_crs

    if network is None or network.geo_reference is None:
        return ""
    first = next(iter(network.roads.values())).geometries[0]
    to_degrees = Transformer.from_crs(map_crs(network), "EPSG:4326", always_xy=True)
    lon, lat = to_degrees.transform(first.x + network.header.offset[0], first.y + network.header.offset[1])
    return f"{326 if lat >= 0.0 else 327}{int((lon + 180.0) // 6.0) + 1:02d}"
