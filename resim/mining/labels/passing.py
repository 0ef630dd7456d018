"""Passing on the next lane: to the left of somebody (`pass`), or to the right (`overtaking_right`).

Rows of Kaefer's catalogs. The moment is that at which the one's centre is no longer behind the other's, along the lane;
it lasts as long as both are near each other on neighbouring lanes. Both must drive on for overtaking on the right.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.samples import Ints
from resim.mining.settings import MiningSettings

PASS, RIGHT = "pass", "overtaking_right"
SIDES = ((PASS, (5, 6, 7)), (RIGHT, (0, 1, 2)))
"""Labels, and the slots of who is passed: to the right of who passes it, or to the left."""


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who passes whom."""
    samples, rules = features.samples, settings.passing
    wanted = samples.kinds(frozenset(settings.kinds)) & (samples.v >= rules.slowest)
    for label, slots in SIDES:
        for before, other in zip(*_passed(features, slots), strict=True):
            now = before + 1
            v_other = float(samples.v[other])
            if not wanted[now] or not features.with_lane[other] or v_other >= samples.v[now]:
                continue
            if label == RIGHT and v_other < rules.slowest:
                continue
            partner = int(samples.owner[other])
            start, end = _near(features, now, partner, slots, rules.near)
            figures = {
                "v_mps": float(samples.v[now]), "v_passed_mps": v_other,
                "duration_s": float(samples.t[end] - samples.t[start]),
            }  # fmt: skip
            yield LabelledManeuver(label, int(samples.owner[now]), start, end, now, partner, figures)


def _passed(features: Features, slots: tuple[int, int, int]) -> tuple[list[int], list[int]]:
    """The samples after which somebody in these slots is no longer ahead, and the samples of who that is then."""
    around, samples = features.around, features.samples
    rear, beside, front = slots
    before, other = [np.zeros(0, np.intp)], [np.zeros(0, np.intp)]
    same = np.flatnonzero(np.diff(samples.piece_of) == 0)
    for ahead in (beside, front):
        for behind in (rear, beside):
            one, two = around.held[same, ahead], around.held[same + 1, behind]
            of = (one >= 0) & (two >= 0)
            of &= (around.offset[same, ahead] > 0.0) & (around.offset[same + 1, behind] <= 0.0)
            k = np.flatnonzero(of)
            k = k[samples.owner[one[k]] == samples.owner[two[k]]]
            before.append(same[k])
            other.append(two[k].astype(np.intp))
    points, others = np.concatenate(before), np.concatenate(other)
    order = np.lexsort((others, points))
    return points[order].tolist(), others[order].tolist()


def _near(
    features: Features, k: int, partner: int, slots: tuple[int, int, int], near: float
) -> tuple[int, int]:
    """The first and last sample around k with the partner in these slots, up to `near` [m] ahead or behind."""
    samples, around = features.samples, features.around
    piece = samples.piece_of[k]
    low, high = int(samples.piece[piece]), int(samples.piece[piece + 1])
    held, offset = around.held[low:high, list(slots)], around.offset[low:high, list(slots)]
    who: Ints = np.where(held >= 0, samples.owner[held], -1)
    there = ((who == partner) & (np.abs(offset) <= near)).any(axis=1)
    there[k - low] = True
    gone_before, gone_after = np.flatnonzero(~there[: k - low]), np.flatnonzero(~there[k - low :])
    start = low + int(gone_before[-1]) + 1 if len(gone_before) else low
    return start, k + int(gone_after[0]) - 1 if len(gone_after) else high - 1


FAMILIES.add(
    LabelFamily(
        "passing", (PASS, RIGHT), find, "going by somebody on the next lane", "Kaefer 2022, Appendix 1"
    )
)
