"""An SD object beside the GT object that it is named after: pairs, and sensor objects that are nobody."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from resim.core.geometry import Floats
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.tracks import CheckedTable, Track
from resim.recordings.own_detection import misnamed_egos

MISTAKEN = 0.3
"""Part of its distance from the object that it names at which an SD object lies on another."""
APART = 10.0
"""Median distance [m] from the GT object that an SD object names, beyond which it is another."""
NEAREST = 2.5
"""Median distance [m] from a GT object at which an SD object may lie on it: usual errors, and half a box."""


@dataclass(frozen=True, eq=False)
class MatchedTrack:
    """An SD object beside its GT at K common times: t (K,) s, offset (K,) m SD less GT, in GT's own frame (x ahead,
    y left), v (K,) m/s."""

    sd: Track
    gt: Track
    t: Floats
    along: Floats
    across: Floats
    v: Floats


def pairs(gt: CheckedTable, sd: CheckedTable) -> list[MatchedTrack]:
    """Give every SD object, or piece of it, that has GT at common times."""
    named = [(k, own) for k in sd.tracks for own in gt.tracks if own.id == sd.gt_id.get(k.id, "")]
    return [pair for track, own in named if (pair := beside(track, own)) is not None]


def beside(track: Track, own: Track, shift: float = 0.0) -> MatchedTrack | None:
    """The SD track, its times shifted [s], beside its GT; None with fewer than three common times."""
    t = track.t + shift
    there = (t >= own.t[0]) & (t <= own.t[-1])
    if len(own) < 2 or there.sum() < 3:
        return None
    t = t[there]
    off = track.p[there] - np.interp(t, own.t, own.p)
    off = off * np.exp(-1j * np.interp(t, own.t, own.heading))
    return MatchedTrack(track, own, t, off.real, off.imag, np.interp(t, own.t, own.v))


def misnamed(gt: CheckedTable, known: list[MatchedTrack]) -> tuple[list[MatchedTrack], list[RankedFinding]]:
    """Give the pairs that are one object, and findings of SD objects that lie on another one than they name."""
    right, out = [], []
    for pair in known:
        far = float(np.median(np.hypot(pair.along, pair.across)))
        others = [p for k in gt.tracks if k.id != pair.gt.id and (p := beside(pair.sd, k)) is not None]
        nearest = min(others, key=lambda p: float(np.median(np.hypot(p.along, p.across))), default=None)
        near = np.inf if nearest is None else float(np.median(np.hypot(nearest.along, nearest.across)))
        if nearest is None or near > min(MISTAKEN * far, NEAREST):
            right.append(pair)
            continue
        text = (
            f"is named {pair.gt.id!r} of GT, {far:.1f} m away, and lies on {nearest.gt.id!r} ({near:.1f} m)"
        )
        span = (float(pair.t[0]), float(pair.t[-1]))
        out.append(
            found("SD_WITHOUT_GT", "sd", pair.sd.id, span, far, "m", text, limit=NEAREST, severity="error")
        )
    return right, out


def egos_misnamed(sd: pd.DataFrame, gt: pd.DataFrame, ego: str) -> Iterator[RankedFinding]:
    """Give SD objects that are named as the EGO and are of another kind or size: they are judged as road users."""
    for name, why in misnamed_egos(sd, gt, ego).items():
        t = sd.loc[sd["id"] == name, "t"]
        text = f"is named {ego!r} of the ground truth, the EGO, and is {why}: it is judged as a road user"
        span = (float(t.min()), float(t.max()))
        yield found(
            "SD_WITHOUT_GT", "sd", name, span, len(t), "samples", text, limit=1.0, severity="error", own=True
        )


def strangers(
    sd: CheckedTable, known: list[MatchedTrack], explained: set[str], parts: set[str]
) -> Iterator[RankedFinding]:
    """Give SD objects without GT, together where they are many, and those far from the GT that they name.

    explained: SD ids whose distance a clock explains; parts: ids under which broken tracks go on.
    """
    nobody = [k for k in sd.tracks if not sd.gt_id.get(k.id, "") and k.id not in parts]
    names = list(dict.fromkeys(k.id for k in nobody))
    if len(names) > 3:
        some = ", ".join(names[:5]) + ", ..."
        text = f"{len(names)} of {len({k.id for k in sd.tracks})} objects have no ground truth: {some}"
        yield found("SD_WITHOUT_GT", "sd", "", sd.span, len(names), "objects", text, limit=1.0)
    else:
        for name in names:
            own = [k for k in nobody if k.id == name]
            text = f"no ground truth is named for it ({sum(map(len, own))} samples)"
            span = (own[0].t[0], own[-1].t[-1])
            yield found("SD_WITHOUT_GT", "sd", name, span, sum(map(len, own)), "samples", text, limit=1.0)
    for pair in known:
        far = float(np.median(np.hypot(pair.along, pair.across)))
        if far > APART and pair.sd.id not in explained:
            text = f"is named {pair.gt.id!r} of the ground truth, and is {far:.1f} m from it in the median"
            yield found(
                "SD_WITHOUT_GT",
                "sd",
                pair.sd.id,
                (float(pair.t[0]), float(pair.t[-1])),
                far,
                "m",
                text,
                limit=APART,
                severity="error",
            )
