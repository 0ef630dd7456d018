"""Conventions of headings: degrees, turned by pi, from north, clockwise. They are put right for the checks after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.finding import Severity
from resim.core.geometry import Floats, wrap_angle
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.tracks import PEDESTRIAN, CheckedTable, Track
from resim.recordings.checks.units import MOVING

DEGREES = 180.0 / np.pi
FITS, MISFITS = 0.1, 0.3
"""A convention fits the course [rad, median] when converted, and by a third of that at most of what the heading does
as it stands."""
TURNED = 0.01
"""Misfit of the heading [rad] from which on its unit is asked for: smaller does no harm."""
OFF = 0.5
"""Misfit [rad] from which on a heading may be turned, or counted from elsewhere: less is a wrong alignment."""
BETTER = 0.7
"""Part of another convention's misfit at which one fits better; else the simpler one is taken."""
RIVALS = 3.0
"""Times its misfit up to which another convention may be the right one as well."""
LIVELY, OFTEN, STILL = 4.0, (0.5, 0.8), 0.004
"""Times by which the heading's changes over 0.4 s exceed the course's when it is in degrees, at one of these
quantiles; changes [rad] that are noise of a heading in radians."""
NOISE = 0.5
"""Misfit [rad] of a whole table's headings as they stand that no noise of headings in radians gives."""
SLOPE, EXPLAINS = (0.6, 1.4), 0.7
"""Change of the converted heading with that of the course, and share of it that the course explains, when it is in
degrees: of a car that skids the heading turns and the course does not."""
VARIED = 0.005
"""Spread of the course [rad, standard deviation] from which on it tells that."""
MOSTLY, THROUGHOUT = 0.9, 0.25
"""Share of one object's samples, and misfit [rad] of the converted heading, that tell another convention: who skids
began otherwise."""
REVERSES = 8.0
"""Speed [m/s] from which on nobody drives backwards: a single object that is slower may do so with a speed above 0."""


@dataclass(frozen=True)
class Convention:
    """A convention of headings: heading [rad] = sign raw / factor + offset."""

    code: str
    words: str
    factor: float = 1.0
    sign: float = 1.0
    offset: float = 0.0

    def __call__(self, raw: Floats) -> Floats:
        """Give headings [rad], anticlockwise from +x."""
        return self.sign * raw / self.factor + self.offset


NORTH = 0.5 * np.pi
CONVENTIONS = tuple(
    Convention(code or ("HEADING_UNIT" if unit else ""), f"{words}{unit}", factor, sign, offset)
    for factor, unit in ((1.0, ""), (DEGREES, " in degrees"))
    for code, words, sign, offset in (
        ("", "anticlockwise from +x", 1.0, 0.0),
        ("HEADING_TURNED", "turned by pi", 1.0, np.pi),
        ("HEADING_CONVENTION", "clockwise from north", -1.0, NORTH),
        ("HEADING_CONVENTION", "anticlockwise from north", 1.0, NORTH),
        ("HEADING_CONVENTION", "clockwise from +x (or y is mirrored)", -1.0, 0.0),
    )
)
"""As it should be first, then from simple to strange."""
PLAIN = CONVENTIONS[0]


def headings(table: CheckedTable) -> tuple[CheckedTable, list[RankedFinding]]:
    """Give objects whose heading fits their course in another convention, and the table in radians, unwrapped."""
    misfits = {k.id: m for k in table.tracks if (m := _misfits(k, table.step)) is not None}
    if not misfits:
        return _finding(table, {}, {})
    if len(misfits) > 1:
        mean = np.mean(list(misfits.values()), axis=0)
        of_all = _best(mean, list(table.tracks), table.step)
        k = CONVENTIONS.index(of_all)
        if of_all is not PLAIN and all(m[k] < min(FITS, MISFITS * m[0]) for m in misfits.values()):
            return _finding(table, {"": of_all}, {"": mean})
    found = {}
    for track in table.tracks:
        if track.id in misfits:
            best = _best(misfits[track.id], [track], table.step)
            fast = float(np.median(np.abs(track.v))) > REVERSES
            if best.code == "HEADING_UNIT" or (best is not PLAIN and fast):
                found[track.id] = best
    return _finding(table, found, misfits)


def _best(misfit: Floats, tracks: list[Track], step: float) -> Convention:
    """The simplest convention than which none fits much better; the plain one where none fits, or it does no harm."""
    as_is, best = float(misfit[0]), PLAIN
    if as_is <= TURNED:
        return PLAIN
    least = np.inf
    for convention, off in zip(CONVENTIONS[1:], misfit[1:].tolist(), strict=True):
        if off >= min(FITS, MISFITS * as_is) or (convention.code != "HEADING_UNIT" and as_is < OFF):
            continue
        if convention.factor != 1.0 and not any(_lively(k, step) for k in tracks):
            continue
        if off < BETTER * least - TURNED:
            best, least = convention, off
    return best


def _finding(
    table: CheckedTable, fitting: dict[str, Convention], misfits: dict[str, Floats]
) -> tuple[CheckedTable, list[RankedFinding]]:
    """The findings, and the table converted and unwrapped; who may skid instead is told so and left as it is."""
    out, sure = [], {}
    for name, convention in fitting.items():
        as_is, converted = misfits[name][[0, CONVENTIONS.index(convention)]].tolist()
        text = (
            f"headings are {as_is:.3g} rad off the course as they stand and {converted:.3g} rad as "
            f"{convention.words}"
        )
        details = {"factor": convention.factor, "sign": convention.sign, "offset": convention.offset}
        own = [k for k in table.tracks if not name or k.id == name]
        together = not name and (convention.factor == 1.0 or as_is > NOISE)  # not all of a table skid
        repair: str | None = None
        severity: Severity | None = None
        if rivals := _rivals(convention, misfits[name]):
            text += f"; as {' or '.join(rivals)} they fit as well, so which it is has to be said where it is imported"
            repair = ""
        elif together or _is_sure(convention, own, table.step):
            sure[name] = convention
        else:
            text += "; or they are correct (noisy, or the vehicle skids); the course cannot decide"
            repair, severity = "", "warning"
        out.append(
            found(
                convention.code, table.source, name, table.span_of(name), as_is, "rad", text, limit=TURNED,
                details=details, repair=repair, severity=severity,
            )
        )  # fmt: skip
    whole = sure.get("")

    def converted_heading(track: Track) -> Floats:
        return np.unwrap((whole or sure.get(track.id, PLAIN))(track.heading))

    return table.shaped(heading=converted_heading), out


def _rivals(convention: Convention, misfit: Floats) -> list[str]:
    """Other conventions that the course cannot tell from this one, with how far off each is [rad].

    A map's north is not true north away from its meridian, so the right one may be off by some hundredths of a rad. On
    a straight road to the north, clockwise and anticlockwise differ by little more.
    """
    own = float(misfit[CONVENTIONS.index(convention)])
    return [
        f"{other.words} ({off:.3g} rad)"
        for other, off in zip(CONVENTIONS[1:], misfit[1:].tolist(), strict=True)
        if other is not convention
        and other.code == convention.code == "HEADING_CONVENTION"
        and other.factor == convention.factor
        and off < max(TURNED, own) * RIVALS
    ]


def _lively(track: Track, step: float) -> bool:
    """Whether the heading changes far more than the course: noise and turns are 57 times as large in degrees.

    A heading that is only turned by an amount changes as the course does.
    """
    if np.abs(track.heading).max() > 2.1 * np.pi:
        return True
    lag, base = max(round(0.4 / step), 1), max(round(1.6 / step), 1)
    course = np.unwrap(np.angle(track.p[base:] - track.p[:-base]))
    if len(course) <= lag:
        return False
    of_heading, of_course = (np.quantile(np.abs(h[lag:] - h[:-lag]), OFTEN) for h in (track.heading, course))
    return bool((of_heading > LIVELY * of_course + STILL).any())


def _misfits(track: Track, step: float) -> Floats | None:
    """How far [rad, median] the heading is off the course in each convention (C,); None where it does not drive."""
    if (driven := _driven(track, step)) is None:
        return None
    return np.array([np.median(_off(c, *driven)) for c in CONVENTIONS])


def _off(convention: Convention, course: Floats, raw: Floats, reverse: Floats) -> Floats:
    return np.abs(wrap_angle(convention(raw) + reverse - course))


def _is_sure(convention: Convention, tracks: list[Track], step: float) -> bool:
    """Whether nothing else explains the headings, as that somebody skids.

    Degrees are sure beyond a whole turn, and where the heading follows the course in degrees; another convention
    where it holds throughout.
    """
    if convention.factor == 1.0:
        return all(
            float(np.quantile(_off(convention, *driven), MOSTLY)) < THROUGHOUT
            for k in tracks
            if (driven := _driven(k, step)) is not None
        )
    if any(np.abs(k.heading).max() > 2.1 * np.pi for k in tracks):
        return True
    courses, headings = [np.zeros(0)], [np.zeros(0)]
    for k in tracks:
        if (driven := _driven(k, step)) is not None:
            turned = [np.unwrap(driven[0]), convention.sign * np.unwrap(driven[1] / convention.factor)]
            for every, angle in zip((courses, headings), turned, strict=True):
                every.append(angle - angle.mean())
    course, heading = np.concatenate(courses), np.concatenate(headings)
    if not len(course) or float(np.std(course)) < VARIED:
        return False
    slope = float((course * heading).sum() / (course**2).sum())
    left = float(((heading - slope * course) ** 2).sum() / max(float((heading**2).sum()), 1e-12))
    return SLOPE[0] < slope < SLOPE[1] and left < 1.0 - EXPLAINS


def _driven(track: Track, step: float) -> tuple[Floats, Floats, Floats] | None:
    """Course [rad], heading as it stands, and pi where it reverses (K,), of the samples in which it drives."""
    if track.kind == PEDESTRIAN or len(track) < 5:
        return None
    far = max(round(0.4 / step), 1)
    if len(track) <= 2 * far:
        return None
    way = track.p[2 * far :] - track.p[: -2 * far]
    drives = np.abs(way) > max(4.0 * MOVING * far * step, 0.5)
    if not drives.any():
        return None
    course = np.angle(way[drives])
    raw = track.heading[far:-far][drives]
    reverse = np.where(track.v[far:-far][drives] < 0.0, np.pi, 0.0)
    return course, raw, reverse
