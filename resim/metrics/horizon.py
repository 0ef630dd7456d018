"""How far ahead a criterion looks: as far as its limit needs, and what is left open beyond.

Measures look 4 s (`Parameters.horizon`) or 150 m ahead. That nothing is met until then shows that a time is not below
4 s, and nothing more. For a limit that needs more, TTC, THW, WTTC, DRAC and the gap ahead are computed again as far
ahead as it needs, up to LONGEST or FARTHEST. What cannot be looked for, as a plan ends after 4 s, stays open.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Floats
from resim.metrics.criticality import Pairs
from resim.metrics.criticality.following import KMH, RANGE
from resim.metrics.criticality.measure import Bad
from resim.metrics.risk import Parameters

LONGEST, FARTHEST = 30.0, 500.0
"""Time [s] and way [m] that are looked ahead at most."""


@dataclass(frozen=True)
class LookAhead:
    """How far is looked ahead. horizon: s; reach: m along the EGO's path."""

    horizon: float
    reach: float = RANGE


def ahead(name: str, side: str, limit: float, bad: Bad, pairs: Pairs) -> LookAhead:
    """Give how far a measure has to look ahead for a limit on this side; no less than it always does."""
    usual = LookAhead(pairs.span)
    if (side == "below") != (bad == "low"):
        return usual
    v = float(np.max(np.abs(pairs.plan[:, 0, 3]), initial=0.0, where=np.isfinite(pairs.plan[:, 0, 3])))
    if name in ("TTC", "THW", "WTTC"):
        return LookAhead(min(max(limit, pairs.span), LONGEST))
    if name == "DRAC":
        need = 0.5 * v / limit if limit > 0.0 else np.inf
        return LookAhead(min(max(need, pairs.span), LONGEST))
    if name in ("gap ahead", "half speedometer"):
        need = limit + (0.5 * KMH * v if name == "half speedometer" else 0.0)
        return LookAhead(pairs.span, min(max(need, RANGE), FARTHEST))
    return usual


def open_beyond(name: str, seen: LookAhead, pairs: Pairs, limits: Parameters) -> Floats | None:
    """Give how bad (S, 1) a measure can still be where it finds no conflict so far ahead; None: not at all.

    Who follows and would touch in more than H s, closing in at no more than its speed v, needs less than v / (2 H) to
    avoid it (DRAC), and v / (2 b) s of full braking before the contact (TTB, and TTR, which is no less).
    """
    v = np.abs(pairs.plan[..., 3])
    now, most = v[:, :1], v.max(axis=1, keepdims=True)
    braked = seen.horizon - 0.5 * most / limits.braking
    bounds: Mapping[str, Callable[[], Floats]] = {
        **dict.fromkeys(("TTC", "THW", "ETTC", "WTTC", "PET", "TTK", "TTS"), lambda: seen.horizon + 0.0 * now),
        **dict.fromkeys(("TTB", "TTR"), lambda: np.maximum(braked, 0.0)),
        "WTTR": lambda: np.maximum(braked - limits.step, 0.0),
        "DRAC": lambda: 0.5 * now / seen.horizon,
        "gap ahead": lambda: seen.reach + 0.0 * now,
        "half speedometer": lambda: seen.reach - 0.5 * KMH * now,
    }  # fmt: skip
    return bounds[name]() if name in bounds else None
