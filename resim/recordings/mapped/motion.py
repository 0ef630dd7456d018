"""What a table does not tell of motion: headings and speeds from positions, sizes by kind."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from resim.core.geometry import Floats

REACH = 0.2
"""Time [s] before and after a sample between which its chord is taken."""
STANDING = 0.5
"""Speed [m/s] below which the direction of motion says nothing: the last heading is kept."""
TURN, FOLLOWS = 6.4, 0.5
"""Radians up to which a heading is within one turn, and by which one that counts turns may leave the course."""
SIZES: Mapping[str, tuple[float, float]] = {
    "car": (4.7, 1.9), "van": (5.5, 2.0), "truck": (10.0, 2.5), "bus": (12.0, 2.55), "trailer": (8.0, 2.5),
    "motorcycle": (2.2, 0.8), "bicycle": (1.8, 0.6), "pedestrian": (0.5, 0.5), "unknown": (4.7, 1.9),
}  # fmt: skip
"""Length and width [m] that are assumed of what has none."""


def headings(ids: pd.Series, t: Floats, x: Floats, y: Floats) -> Floats:
    """Give headings (K,) [rad] along the chords of each object's positions, kept where it stands; NaN if always."""
    out = np.full(len(t), np.nan)
    for rows, vx, vy in _velocities(ids, t, x, y):
        out[rows] = _held(vx, vy)
    return out


def counts_turns(t: Floats, raw: Floats, heading: Floats, x: Floats, y: Floats) -> bool:
    """Say whether an object's headings (K,) [rad] leave one turn because it drives more than one.

    raw: as the table has them; heading: in the map, not wrapped; x, y: m. They have to be within a turn at some time,
    and to change with the course of the positions as long as it drives.
    """
    ids = pd.Series("", index=range(len(t)))
    known = np.isfinite(raw) & np.isfinite(heading)
    if not known.any() or np.abs(raw[known]).min() > TURN:
        return False
    for rows, vx, vy in _velocities(ids, t, x, y):
        drives = (np.hypot(vx, vy) > STANDING) & known[rows]
        if drives.sum() < 3:
            continue
        course = np.unwrap(np.arctan2(vy, vx)[drives])
        return bool(np.ptp(heading[rows][drives] - course) < 2.0 * FOLLOWS)
    return False


def along_velocity(ids: pd.Series, t: Floats, vx: Floats, vy: Floats) -> Floats:
    """Give headings (K,) [rad] of velocities [m/s], kept where the object stands; NaN if always."""
    out = np.full(len(t), np.nan)
    for own in _groups(ids):
        rows = own[np.argsort(t[own], kind="stable")]
        out[rows] = _held(vx[rows], vy[rows])
    return out


def speeds(ids: pd.Series, t: Floats, x: Floats, y: Floats, heading: Floats) -> Floats:
    """Give speeds (K,) [m/s] along the heading, of the chords of each object's positions."""
    out = np.full(len(t), np.nan)
    for rows, vx, vy in _velocities(ids, t, x, y):
        out[rows] = vx * np.cos(heading[rows]) + vy * np.sin(heading[rows])
    return out


def sized(frame: pd.DataFrame) -> tuple[pd.DataFrame, str]:
    """Give the table without missing sizes: an object's median, else what its kind is assumed to have; and what was.

    A size that none can have, such as 0, is not missing: it stays, and is refused by whoever reads the table.
    """
    assumed: dict[str, set[str]] = {}
    out = {}
    for n, side in enumerate(("length", "width")):
        given = frame[side]
        usual = given.where(given > 0.0).groupby(frame["id"], sort=False).transform("median")
        own = given.fillna(usual)
        for name, kind in frame.loc[own.isna(), ["id", "kind"]].drop_duplicates().itertuples(index=False):
            assumed.setdefault(kind, set()).add(name)
        out[side] = own.fillna(frame["kind"].map({kind: size[n] for kind, size in SIZES.items()}))
    words = [
        "{} {:g} x {:g} m ({} of {} objects)".format(
            kind, *SIZES[kind], len(names), frame.loc[frame["kind"] == kind, "id"].nunique()
        )
        for kind, names in sorted(assumed.items())
    ]
    return frame.assign(**out), ", ".join(words)


def _held(vx: Floats, vy: Floats) -> Floats:
    drives = np.hypot(vx, vy) > STANDING
    known = pd.Series(np.where(drives, np.arctan2(vy, vx), np.nan))
    return np.asarray(known.ffill().bfill(), dtype=float)


def _groups(ids: pd.Series) -> Iterator[np.ndarray]:
    for rows in pd.Series(ids.to_numpy()).groupby(ids.to_numpy(), sort=False).indices.values():
        yield np.asarray(rows)


def _velocities(
    ids: pd.Series, t: Floats, x: Floats, y: Floats
) -> Iterator[tuple[np.ndarray, Floats, Floats]]:
    """Rows of each object in order of time, with a position, and their velocity [m/s] over the chord."""
    for own in _groups(ids):
        rows = own[np.isfinite(x[own]) & np.isfinite(y[own])]
        rows = rows[np.argsort(t[rows], kind="stable")]
        _, first = np.unique(t[rows], return_index=True)
        if len(first) < 2:
            continue
        times, p = t[rows][first], (x[rows] + 1j * y[rows])[first]
        reach = max(REACH, float(np.median(np.diff(times))))
        early, late = (np.clip(t[rows] + by, times[0], times[-1]) for by in (-reach, reach))
        way = np.interp(late, times, p) - np.interp(early, times, p)
        velocity = way / (late - early)
        yield rows, velocity.real, velocity.imag
