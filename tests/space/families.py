"""Slot traces of scenarios of known kinds: families with a variation of their own within."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from resim.space.traces import SLOTS, SlotTraces

Piece = tuple[str, float, float]
"""A slot, and the metres ahead at the beginning and at the end of its part of the time."""
FAMILIES: dict[str, tuple[tuple[float, tuple[Piece, ...]], ...]] = {
    "follows": ((1.0, (("V", 30.0, 30.0),)),),
    "cut-in from the left": ((0.5, (("III", 20.0, 25.0),)), (0.5, (("V", 25.0, 28.0),))),
    "cut-in from the right": ((0.5, (("VIII", 20.0, 25.0),)), (0.5, (("V", 25.0, 28.0),))),
    "cut-out to the left": ((0.5, (("V", 25.0, 25.0),)), (0.5, (("III", 25.0, 35.0),))),
    "cut-out to the right": ((0.5, (("V", 25.0, 25.0),)), (0.5, (("VIII", 25.0, 15.0),))),
    "is overtaken": (
        (0.3, (("I", -30.0, -5.5),)), (0.2, (("II", -5.0, 5.0),)), (0.5, (("III", 5.5, 45.0),)),
    ),
    "overtakes": (
        (0.3, (("VIII", 30.0, 5.5),)), (0.2, (("VII", 5.0, -5.0),)), (0.5, (("VI", -5.5, -45.0),)),
    ),
    "is followed": ((1.0, (("IV", -20.0, -20.0),)),),
    "jam": ((1.0, (("V", 12.0, 12.0), ("IV", -12.0, -12.0), ("II", 0.0, 0.0), ("VII", 0.0, 0.0))),),
    "beside left": ((1.0, (("II", 2.0, -2.0),)),),
    "beside right": ((1.0, (("VII", 2.0, -2.0),)),),
    "follows, beside left": ((1.0, (("V", 30.0, 30.0), ("II", 2.0, -2.0))),),
    "merge behind": ((0.5, (("VI", -20.0, -20.0),)), (0.5, (("IV", -20.0, -20.0),))),
}  # fmt: skip


def drawn(kind: str, name: str, rng: np.random.Generator, spread: float = 1.0) -> SlotTraces:
    """One scenario of a kind: 6 to 9 s; metres and times of its parts vary by spread."""
    count = int(rng.integers(30, 46))
    offset = np.full((count, 8), np.nan)
    shift = {slot: rng.normal(0.0, 1.5 * spread) for slot in SLOTS}
    begin = 0.0
    for part, pieces in FAMILIES[kind]:
        end = begin + part
        late = 0.0 if end >= 1.0 else rng.normal(0.0, 0.01 * spread)
        rows = np.flatnonzero((np.arange(count) >= begin * 36) & (np.arange(count) < (end + late) * 36))
        if end >= 1.0:
            rows = np.arange(int(np.ceil(begin * 36)), count)
        offset[rows] = np.nan
        for slot, low, high in pieces:
            reach = (-4.9, 4.9) if slot in ("II", "VII") else (5.1, 99.0) if low > 0 else (-49.0, -5.1)
            values = np.linspace(low, high, len(rows)) + shift[slot] * (0.5 if slot in ("II", "VII") else 1.0)
            offset[rows, SLOTS.index(slot)] = np.clip(values, *reach)
        begin = end
    speed = np.where(np.isfinite(offset), 0.0, np.nan)
    return SlotTraces(
        np.array([name]),
        np.array([0, count], np.intp),
        offset,
        speed,
        np.ones(count, np.intp),
        np.zeros(count),
    )


def lasting(one: SlotTraces, scenes: int) -> SlotTraces:
    """A scenario that lasts for so many scenes: its last one again, or without the later ones."""
    k = np.minimum(np.arange(scenes), len(one.lane) - 1)
    first = np.array([0, scenes], np.intp)
    return replace(
        one, first=first, offset=one.offset[k], speed=one.speed[k], lane=one.lane[k], bend=one.bend[k]
    )
