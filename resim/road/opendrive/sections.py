"""Lane sections that speak of one side of the road only (singleSide)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from resim.road.opendrive.model import Cubic, Height, Lane

Record = TypeVar("Record", Cubic, Height)
SectionLanes = dict[int, Lane]


def both_sides(
    before: SectionLanes, lanes: SectionLanes, distance: float
) -> tuple[SectionLanes, SectionLanes]:
    """Give the lanes of a section and of the single-sided one `distance` [m] after it, both sides in each.

    The side on which the second has no lane goes on as in the first.
    """
    spoken = {lane > 0 for lane in lanes if lane}
    going_on = {lane for lane in before if lane and (lane > 0) not in spoken}
    first = {lane: replace(own, successor=lane) if lane in going_on else own for lane, own in before.items()}
    second = {**lanes, **{lane: _later(before[lane], distance) for lane in going_on}}
    return first, {lane: second[lane] for lane in sorted(second)}


def _later(lane: Lane, distance: float) -> Lane:
    """The lane with its records counted from `distance` further on."""
    marks = [replace(mark, s_offset=mark.s_offset - distance) for mark in lane.marks]
    return replace(
        lane, predecessor=lane.id, unread=(), widths=_shifted(lane.widths, distance),
        borders=_shifted(lane.borders, distance), heights=_shifted(lane.heights, distance),
        speeds=tuple((s - distance, speed) for s, speed in lane.speeds),
        marks=tuple(marks[max(sum(mark.s_offset <= 0.0 for mark in marks) - 1, 0):]),
    )  # fmt: skip


def _shifted(records: Sequence[Record], distance: float) -> tuple[Record, ...]:
    return tuple(record._replace(s=record.s - distance) for record in records)
