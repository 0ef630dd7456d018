"""One source's clock: rows out of order, and times that jump while the motion goes on."""

from __future__ import annotations

import numpy as np
import pandas as pd

from resim.core.finding import Source
from resim.core.geometry import Bools, Floats
from resim.core.tracks import Strings
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.tracks import Ints, runs

JUMP = 0.06
"""Time [s] by which stamps and motion must differ in one step: 1.5 m at 25 m/s."""
MOVING = 2.0
"""Speed [m/s] from which on the way tells the time; 0.1 m of noise are then 0.05 s."""
SETTLED, KEPT = 15, 0.65
"""Samples before and after a jump in which this part of it must stay: a sensor that stalled catches up."""
JITTER = 0.8
"""Part of the usual step by which stamps may jitter."""
SHARE = 0.3
"""Part of the jump by which the objects may differ in it."""


def in_order(source: Source, frame: pd.DataFrame) -> tuple[pd.DataFrame, list[RankedFinding]]:
    """Give clock jumps and rows that run back in time; and the rows with the jumps taken out, by time.

    A jump is one that all objects share, and after which the motion in the order of the file goes on; else
    the rows are in the wrong order.
    """
    correction, out = jump_corrections(source, frame)
    frame = frame.assign(t=np.round(frame["t"].to_numpy(float) + correction, 9)) if out else frame
    out += _backwards(source, frame)
    return frame.sort_values("t", kind="stable"), out


def jump_corrections(source: Source, frame: pd.DataFrame) -> tuple[Floats, list[RankedFinding]]:
    """Give what each row's time has to be moved by (K,) [s] for the clock's jumps, and the findings of them."""
    whole = np.flatnonzero(np.isfinite(frame[["x", "y", "heading", "v"]].to_numpy(float)).all(axis=1))
    steps = _steps(frame.iloc[whole])
    if steps is None:
        return np.zeros(len(frame)), []
    usual = float(np.median(steps["dt"][steps["dt"] > 0.0])) if (steps["dt"] > 0.0).any() else np.nan
    out = []
    objects = frame["id"].to_numpy(str)
    stamps = frame["t"].to_numpy(float)
    correction = np.zeros(len(frame))
    for rows, amount, after in _jumps(steps, usual):
        correction -= amount * _after(
            whole[rows], objects, stamps > after + 0.5 * usual if amount > 0.0 else None
        )
        text = f"the clock jumps by {amount:+.3f} s at {after:.2f} s, the motion does not"
        out.append(
            found(
                "CLOCK_JUMP",
                source,
                "",
                (after, after),
                amount,
                "s",
                text,
                limit=JUMP,
                details={"shift": -amount},
            )
        )
    return correction, out


def _after(rows: Ints, objects: Strings, later: Bools | None) -> Bools:
    """Which rows a jump shifts: those later, and where it goes back, each object's from its own row on."""
    if later is not None:
        return later
    out = np.zeros(len(objects), dtype=bool)
    for row in rows.tolist():
        out[row:] |= objects[row:] == objects[row]
    out[rows.max() :] |= ~np.isin(objects[rows.max() :], objects[rows])  # who comes after it
    return out


def _steps(frame: pd.DataFrame) -> dict[str, Floats] | None:
    """Every step of every object in the order of the file: dt, the time that the motion needs, the row after."""
    if len(frame) < 2:
        return None
    groups = frame.groupby("id", sort=False).indices  # rows of each, in the order of the file
    columns = [frame[c].to_numpy(float) for c in ("t", "x", "y", "heading", "v")]
    parts = []
    for number, own in enumerate(groups.values()):
        t, x, y, heading, v = (c[own] for c in columns)
        if len(t) < 2:
            continue
        # along the heading: rows in the wrong order go back in place as they do in time
        way = np.diff(x) * np.cos(heading[:-1]) + np.diff(y) * np.sin(heading[:-1])
        speed = 0.5 * (v[1:] + v[:-1])
        needs = np.divide(way, speed, out=np.full(len(way), np.nan), where=np.abs(speed) > MOVING)
        parts.append((np.diff(t), needs, own[1:], t[:-1], np.full(len(way), number)))
    if not parts:
        return None
    names = ("dt", "needs", "row", "t", "object")
    return {name: np.concatenate([p[i] for p in parts]) for i, name in enumerate(names)}


def _jumps(steps: dict[str, Floats], usual: float) -> list[tuple[Ints, float, float]]:
    """Per jump each object's row from which on times are off, by how much [s], and the stamp before."""
    out = []
    objects = steps["object"].astype(int)
    needs = steps["needs"] / _scale(steps)[objects]
    dt = steps["dt"]
    off = dt - needs
    suspect = (np.abs(off) > JUMP) & ((dt < 0.5 * usual) | (dt > 1.5 * usual))
    suspect &= np.abs(needs) < 3.0 * max(usual, JUMP)  # a hole in which the object drove on is no jump
    for stamp in np.unique(np.round(steps["t"][suspect], 6)):
        here = np.abs(steps["t"] - stamp) < 0.5 * usual
        first = here & suspect
        if set(objects[here & np.isfinite(off)]) != set(objects[first]):
            continue
        amount = float(np.median(dt[first])) - usual
        if abs(amount) < max(JUMP, JITTER * usual):
            continue
        same = here & (np.abs(dt - usual - amount) <= max(SHARE * abs(amount), 1e-6))
        if (not same[here].all() and amount > 0.0) or not same[first].all():
            continue
        rows = steps["row"][same].astype(int)
        if _stays(off, objects, np.flatnonzero(first), amount, SETTLED):
            out.append((rows, amount, float(stamp)))
    return out


def _stays(off: Floats, objects: Ints, first: Ints, amount: float, count: int) -> bool:
    """Whether no object makes up for the jump in the steps around it: one that lagged catches up."""
    left = []
    for k in first.tolist():
        own = off[max(k - count, 0) : k + count + 1][objects[max(k - count, 0) : k + count + 1] == objects[k]]
        left.append(float(np.nansum(own)))
    return KEPT < float(np.median(left)) / amount < 1.0 / KEPT


def _scale(steps: dict[str, Floats]) -> Floats:
    """Each object's usual ratio of the time that the motion needs to the time stamped: a wrong unit of speed."""
    objects = steps["object"].astype(int)
    out = np.ones(objects.max() + 1)
    for n in range(len(out)):
        own = (objects == n) & (steps["dt"] > 0.0) & np.isfinite(steps["needs"])
        if own.any():
            ratio = float(np.median(steps["needs"][own] / steps["dt"][own]))
            out[n] = ratio if ratio > 0.0 else np.nan  # it moves against its heading: it tells nothing
    return out


def _backwards(source: Source, frame: pd.DataFrame) -> list[RankedFinding]:
    """Objects whose rows run back in time; one finding where every object of several does."""
    step = frame.groupby("id", sort=False)["t"].diff().to_numpy(float)
    back: Bools = step < 0.0
    names = list(dict.fromkeys(frame["id"][back]))
    if not names:
        return []
    whole = len(names) > 1 and len(names) == frame["id"].nunique()
    groups = [("", back)] if whole else [(n, back & (frame["id"] == n).to_numpy()) for n in names]
    out = []
    for name, rows in groups:
        t = frame["t"].to_numpy(float)[rows]
        text = f"{len(runs(rows))} rows come after a later one, by up to {-step[rows].min():.3f} s"
        out.append(
            found("TIME_BACKWARDS", source, str(name), (t.min(), t.max()), len(t), "rows", text, limit=1.0)
        )
    return out
