"""The sensor's own detection of the EGO, that nobody told to be it: the EGO seems to collide with it throughout."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from resim.core.geometry import Bools, Boxes, boxes_overlap
from resim.core.levels import over
from resim.recordings.checks.bodies import DEEP, LONG
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.matching import beside
from resim.recordings.checks.tracks import CheckedTable, Track
from resim.recordings.own_detection import elsewhere, other_shape

THROUGHOUT = 0.9
"""Share of an object's samples in which its box is in the EGO's."""
ITSELF, STEADY = 2.5, 0.7
"""Median distance [m] from the EGO, and spread of it [m, scaled median deviation], at which it certainly is the EGO:
usual errors, and half a box."""
LASTS = 0.5
"""Part of the EGO's time for which it certainly is the EGO: who has hit it stays shorter."""


def ego_detections(gt: CheckedTable, sd: CheckedTable, ego: str) -> Iterator[RankedFinding]:
    """Give SD objects without GT that lie on the EGO throughout; the repair only where they can be nobody else."""
    own = [k for k in gt.tracks if k.id == ego]
    if len(own) != 1 or len(own[0]) < 2:
        return
    for name in dict.fromkeys(k.id for k in sd.tracks if not sd.gt_id.get(k.id, "")):
        pieces = [k for k in sd.tracks if k.id == name]
        if len(pieces) != 1 or (pair := beside(pieces[0], own[0])) is None:
            continue
        lasts = float(pair.t[-1] - pair.t[0])
        if lasts < LONG or float(_inside(pieces[0], own[0]).mean()) < THROUGHOUT:
            continue
        apart = np.hypot(pair.along, pair.across)
        far = float(np.median(apart))
        steady = 1.4826 * float(np.median(np.abs(apart - far))) < STEADY
        sure = far < ITSELF and steady and lasts > LASTS * float(own[0].t[-1] - own[0].t[0])
        sizes = [(k.length, k.width) for k in (pieces[0], own[0])]
        off = pair.along + 1j * pair.across
        sure = sure and not (other_shape(*map(_row, (pieces[0], own[0]))) or elsewhere(pair.t, off, *sizes))
        text = f"lies on the EGO {ego!r} throughout, {far:.2f} m off in the median, and names no GT object"
        text += ": it is the EGO's own detection" if sure else ": own detection, or a colliding object?"
        yield found(
            "EGO_DETECTION", "sd", name, (float(pair.t[0]), float(pair.t[-1])), lasts, "s", text, limit=LONG,
            repair=None if sure else "", own=True, other=ego, details={"other": ego},
        )  # fmt: skip


def _row(track: Track) -> pd.DataFrame:
    """Kind and size of a track, as `other_shape` takes them."""
    return pd.DataFrame({"kind": [track.kind], "length": [track.length], "width": [track.width]})


def _inside(track: Track, ego: Track) -> Bools:
    """Whether the object's box is in the EGO's by more than DEEP, at its samples within the EGO's time."""
    there = (track.t >= ego.t[0]) & (track.t <= ego.t[-1])
    t, p = track.t[there], track.p[there]
    q, heading = np.interp(t, ego.t, ego.p), np.interp(t, ego.t, ego.heading)
    sides = [max(side - DEEP, 0.01) for side in (track.length, track.width, ego.length, ego.width)]
    hit = boxes_overlap(
        Boxes(p.real, p.imag, track.heading[there], sides[0], sides[1]),
        Boxes(q.real, q.imag, heading, sides[2], sides[3]),
    )
    if track.z is not None and ego.z is not None:
        hit &= ~over(track.z[there], np.interp(t, ego.t, ego.z))
    return hit
