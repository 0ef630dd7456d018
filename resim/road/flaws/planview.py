"""Flaws of reference lines.

LINE_GAP: successive elements do not meet, by over 0.01 m (error over 0.5 m). KINK: their headings differ by over 0.01
rad (note; warning over 0.1 rad). ELEMENT_OVERLAP, ELEMENT_HOLE: an element begins over 0.01 m before or behind the
end of the one before, or the first one behind the road's start (the later one holds; the earlier one is drawn on;
error for a hole over 0.5 m). EMPTY_ELEMENT: an element without length, passed over. STRETCHED: the curve of a
paramPoly3 is over 1 % and 0.05 m longer or shorter than its length says, and s with it. CURVE_START: the curve of a
poly3 or paramPoly3 begins over 0.01 m from its element's x and y (error over 0.5 m), or the first of a road turns by
over 0.01 rad from its element's heading (warning). ROAD_LENGTH: the road's declared length is over 0.1 m off that of
its elements (error where over 0.5 m of the road have no element).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.polynomial.polynomial import polyval

from resim.core.geometry import wrap_angle
from resim.road.flaws.flaw import Flaw, Severity
from resim.road.opendrive import Road, RoadNetwork

JUMP, BROKEN = 0.01, 0.5
KINK, SHARP = 0.01, 0.1
LENGTH = 0.1
STRETCHED, STRETCH = 0.05, 0.01
POINTS = 129
JUST_BEFORE = 1e-9


def flaws(network: RoadNetwork) -> Iterator[Flaw]:
    """Give the flaws of all reference lines."""
    yield from _joints(network)
    yield from _stretched(network)
    for road in network.roads.values():
        yield from _distances(road)
        yield from _starts(road)


def _joints(network: RoadNetwork) -> Iterator[Flaw]:
    """Gaps and kinks where the elements of a road meet."""
    joints = [(road.id, after) for road in network.roads.values() for after in road.geometries[1:]]
    if not joints:
        return
    x, y, heading = network.reference_line(
        [road for road, _ in joints], np.array([after.s for _, after in joints]) - JUST_BEFORE
    )
    jump = np.hypot(x - [after.x for _, after in joints], y - [after.y for _, after in joints])
    own = [after.heading + np.arctan2(after.v[1], after.u[1]) for _, after in joints]
    turn = np.abs(wrap_angle(np.array(own) - heading))
    for (road, after), gap, kink in zip(joints, jump.tolist(), turn.tolist(), strict=True):
        severity: Severity
        at = f"road {road}: at s={after.s:.3f} m the reference line"
        if gap > JUMP:
            severity = "error" if gap > BROKEN else "warning"
            yield Flaw(
                severity, "LINE_GAP", road, None, None, after.s, gap, "m", f"{at} jumps by {gap:.3f} m"
            )
        if kink > KINK:
            severity = "warning" if kink > SHARP else "note"
            yield Flaw(severity, "KINK", road, None, None, after.s, kink, "rad",
                       f"{at} has a kink of {kink:.3f} rad")  # fmt: skip


def _stretched(network: RoadNetwork) -> Iterator[Flaw]:
    """Elements paramPoly3 whose curve, measured by chords, is not as long as they say."""
    for road in network.roads.values():
        for element in road.geometries:
            if element.kind != "paramPoly3":  # a poly3 ends where its length says
                continue
            p = np.linspace(0.0, 1.0 if element.normalized else element.length, POINTS)
            curve = float(np.hypot(np.diff(polyval(p, element.u)), np.diff(polyval(p, element.v))).sum())
            off = abs(curve - element.length)
            if off > max(STRETCHED, STRETCH * element.length):
                text = (
                    f"road {road.id}: the curve of the element at s={element.s:.3f} m is {curve:.3f} m long, its "
                    f"length is given as {element.length:.3f} m"
                )
                yield Flaw("warning", "STRETCHED", road.id, None, None, element.s, off, "m", text)


def _starts(road: Road) -> Iterator[Flaw]:
    """Polynomial curves that begin elsewhere, or otherwise, than their elements say.

    Of those behind another, KINK tells whether the turn is meant.
    """
    severity: Severity
    for number, element in enumerate(road.geometries):
        at = f"road {road.id}: the curve of the element at s={element.s:.3f} m"
        off = float(np.hypot(element.u[0], element.v[0]))
        turn = abs(float(np.arctan2(element.v[1], element.u[1])))
        if off > JUMP:
            severity = "error" if off > BROKEN else "warning"
            text = f"{at} begins {off:.3f} m from the element's x and y (a is not 0)"
            yield Flaw(severity, "CURVE_START", road.id, None, None, element.s, off, "m", text)
        if number == 0 and turn > KINK:
            text = f"{at} begins {turn:.3f} rad off the element's heading (b says so)"
            yield Flaw("warning", "CURVE_START", road.id, None, None, element.s, turn, "rad", text)


def _distances(road: Road) -> Iterator[Flaw]:
    """Elements that overlap in s, leave a hole or have no length, and the road's own length."""
    severity: Severity
    begin = road.geometries[0].s
    if abs(begin) > JUMP:
        severity = "error" if abs(begin) > BROKEN else "warning"
        text = f"road {road.id}: its first element begins at s={begin:.3f} m, not at 0"
        yield Flaw(severity, "ELEMENT_HOLE", road.id, None, None, begin, abs(begin), "m", text)
    for before, after in pairwise(road.geometries):
        early = before.s + before.length - after.s
        if abs(early) > JUMP:
            code, what = ("ELEMENT_OVERLAP", "before") if early > 0.0 else ("ELEMENT_HOLE", "behind")
            text = (
                f"road {road.id}: the element at s={after.s:.3f} m begins {abs(early):.3f} m {what} the end "
                f"of the one at s={before.s:.3f} m"
            )
            severity = "error" if early < -BROKEN else "warning"
            yield Flaw(severity, code, road.id, None, None, after.s, abs(early), "m", text)
    for s in road.empty:
        text = f"road {road.id}: the element at s={s:.3f} m has no length and is ignored"
        yield Flaw("note", "EMPTY_ELEMENT", road.id, None, None, s, 0.0, "m", text)
    lost = road.declared_length - road.length
    if abs(lost) > LENGTH:
        severity = "error" if lost > BROKEN else "warning"
        text = (
            f"road {road.id}: its length is declared as {road.declared_length:.3f} m, its elements end at "
            f"{road.length:.3f} m, which is used"
        )
        yield Flaw(severity, "ROAD_LENGTH", road.id, None, None, road.length, abs(lost), "m", text)
