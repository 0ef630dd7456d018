"""Identity: tracks that jump, singly, for good, to another's place; and tracks that go on under another id."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from resim.core.finding import Severity
from resim.core.geometry import Floats
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.tracks import PEDESTRIAN, CheckedTable, Complex, Track, medians

REACH = 0.6
"""Distance [m] by which a step may miss what speed or the steps around it say, besides noise."""
NOISE = 6.0
"""Times the usual miss of its own steps that a jump has to be."""
RAYLEIGH = 1.18
"""Median of the length of a vector whose two components have the standard deviation 1."""
STRONGEST = 10.0
"""Acceleration [m/s²] that a vehicle may have inside a hole."""
GRAVE = 2.0
"""Jump [m] that spoils a result; a tracker's smaller corrections qualify it."""
BRIEF = 3
"""Samples off the track that count as outliers; more are two jumps."""
BACK = 0.35
"""Part of the way off that may be left after the way back."""
ELSEWHERE = 10.0
"""Jump [m] over a hole or with another size, from which on it is another object."""
AFTER_GAP = 1.0
"""Time [s] after which a track that ends may go on under another id: the pipeline's own limit."""
LIKE = 2.0
"""Distance [m] at which a track that changes ids goes on from where the other would be."""
NEAR, FASTER = 1.5, 1.5
"""Distance [m] and difference of velocity [m/s] of a new track from where the ended one leads, without a gap."""
USUAL = (6.0, 2.0)
"""Acceleration [m/s²] in such a gap, of vehicles and of pedestrians."""


@dataclass(frozen=True)
class _Jump:
    """Track `track` misses by `miss` [m] in the step after sample k."""

    track: int
    k: int
    miss: complex


def jumps(table: CheckedTable) -> tuple[CheckedTable, list[RankedFinding]]:
    """Give outliers, jumps, and ids that switch or are reused; and the table cut where its tracks are torn."""
    out: list[RankedFinding] = []
    kept: list[Track] = []
    torn: list[_Jump] = []
    for track in table.tracks:
        residuals = _residuals(track, table.step)
        whole, outliers = _without_outliers(table, track, residuals)
        out += outliers
        miss, limit = residuals if whole is track else _residuals(whole, table.step)
        far = np.flatnonzero(np.abs(miss) > limit)
        torn += [_Jump(len(kept), int(k), complex(miss[k])) for k in far]
        kept.append(whole)
    switches = list(_switches(kept, torn))
    for first, second in switches:
        out.append(_switched(table, kept, first, second))
    explained = {id(j) for pair in switches for j in pair}
    for jump in torn:
        if id(jump) not in explained:
            out.append(_torn(table, kept[jump.track], jump))
    cuts: dict[int, list[int]] = {}
    for jump in torn:
        cuts.setdefault(jump.track, []).append(jump.k)
    pieces = [piece for n, track in enumerate(kept) for piece in track.split(sorted(cuts.get(n, [])))]
    return table.replaced(pieces), out


def _residuals(track: Track, step: float) -> tuple[Complex, Floats]:
    """Per step, the miss [m] (the smaller of that against speed and heading and that against the steps around), and
    the largest that is possible."""
    if len(track) < 3:
        return np.zeros(max(len(track) - 1, 0), dtype=complex), np.full(max(len(track) - 1, 0), np.inf)
    dt, way = np.diff(track.t), np.diff(track.p)
    velocity = track.velocity()
    by_speed = way - 0.5 * dt * (velocity[1:] + velocity[:-1])
    by_steps = way - dt * _around(way / dt)
    miss = np.where(np.abs(by_speed) < np.abs(by_steps), by_speed, by_steps)
    usual = float(np.median(np.abs(miss))) / RAYLEIGH
    # between known speeds at both ends, a hole hides at most a dt² / 4; hardly ever more than half of that
    hidden = np.maximum(dt - step, 0.0)
    return miss, REACH + NOISE * usual + 0.15 * STRONGEST * hidden**2 + 0.1 * np.abs(velocity[1:]) * hidden


def _around(velocity: Complex) -> Complex:
    """The median velocity of up to three steps before and three after each step, itself left out."""
    reach = np.array([-3, -2, -1, 1, 2, 3])
    place = np.arange(len(velocity))[:, None] + reach
    inside = (place >= 0) & (place < len(velocity))
    return np.asarray(medians(velocity[np.clip(place, 0, len(velocity) - 1)], inside))


def _without_outliers(
    table: CheckedTable, track: Track, residuals: tuple[Complex, Floats]
) -> tuple[Track, list[RankedFinding]]:
    """The track without samples that are off it and come back, and the finding of them."""
    miss, limit = residuals
    big = np.flatnonzero(np.abs(miss) > limit)
    off: list[tuple[int, int, float]] = []
    used = -1
    for k in big.tolist():
        if k <= used:
            continue
        for width in range(1, BRIEF + 1):
            end = k + width
            if end < len(miss) and abs(miss[k : end + 1].sum()) < BACK * abs(miss[k]) and end in big:
                off.append((k + 1, end, float(abs(miss[k]))))
                used = end
                break
    if len(miss) > 6:  # a first or last sample off the track cannot come back
        for k, sample in ((0, 0), (len(miss) - 1, len(track) - 1)):
            beside = (
                track.t[k + 1] - track.t[k] < 1.5 * table.step
            )  # over a hole it may be the rest that moved
            if k in big and beside and not any(a <= sample <= b for a, b, _ in off):
                off.append((sample, sample, float(abs(miss[k]))))
    if not off:
        return track, []
    drop = np.zeros(len(track), dtype=bool)
    for a, b, _ in off:
        drop[a : b + 1] = True
    worst = max(off, key=lambda o: o[2])
    t = track.t[drop]
    text = f"{int(drop.sum())} samples off the track, by up to {worst[2]:.2f} m at {track.t[worst[0]]:.2f} s"
    one = found("OUTLIER", table.source, track.id, (t[0], t[-1]), worst[2], "m", text, limit=REACH)
    return track.at(~drop), [one]


def _switches(tracks: list[Track], torn: list[_Jump]) -> Iterator[tuple[_Jump, _Jump]]:
    """Pairs of jumps at one time in which each ends where the other would have gone."""
    for n, first in enumerate(torn):
        for second in torn[n + 1 :]:
            a, b = tracks[first.track], tracks[second.track]
            if first.track == second.track or abs(a.t[first.k + 1] - b.t[second.k + 1]) > 1e-6:
                continue
            apart = abs(first.miss)
            if abs(first.miss + second.miss) < max(LIKE, 0.2 * apart):
                yield first, second


def _switched(table: CheckedTable, tracks: list[Track], first: _Jump, second: _Jump) -> RankedFinding:
    a, b = tracks[first.track], tracks[second.track]
    at = float(a.t[first.k + 1])
    text = f"changes ids with {b.id!r} at {at:.2f} s: each goes on {abs(first.miss):.1f} m away, where the other was"
    return found(
        "ID_SWITCH", table.source, a.id, (at, a.t[-1]), abs(first.miss), "m", text, limit=REACH,
        details={"other": b.id},
    )  # fmt: skip


def _torn(table: CheckedTable, track: Track, jump: _Jump) -> RankedFinding:
    """A jump for good: another object where it follows a hole or a change of size, else a jump."""
    before, after = float(track.t[jump.k]), float(track.t[jump.k + 1])
    far, hole = abs(jump.miss), after - before
    another = far > ELSEWHERE and hole > 1.5 * table.step
    name = "ID_REUSED" if another else "POSITION_JUMP"
    how = "another object has the id" if another else "farther than possible"
    text = f"permanently {far:.2f} m off its track from {before:.2f} to {after:.2f} s: {how}"
    grave: Severity = "error" if far > GRAVE else "warning"
    return found(name, table.source, track.id, (before, after), far, "m", text, limit=REACH, severity=grave)


def broken(table: CheckedTable) -> list[RankedFinding]:
    """Give tracks that end amid the recording and go on under another id."""
    begins, ends = table.span
    by_id: dict[str, list[Track]] = {}
    for track in table.tracks:
        by_id.setdefault(track.id, []).append(track)
    out: list[RankedFinding] = []
    firsts = {name: pieces[0] for name, pieces in by_id.items() if pieces[0].t[0] > begins + 1.5 * table.step}
    for name, pieces in by_id.items():
        last = pieces[-1]
        if last.t[-1] > ends - 1.5 * table.step or len(last) < 3:
            continue
        known = table.gt_id.get(name, "")
        near = [
            (abs(miss), other)
            for other in firsts.values()
            if other.id != name
            and not (known and table.gt_id.get(other.id, "") == known)
            and (miss := _continues(last, other, table.step)) is not None
        ]
        if not near:
            continue
        far, other = min(near, key=lambda pair: pair[0])
        del firsts[other.id]  # it goes on from one track only
        gap = float(other.t[0] - last.t[-1])
        text = f"ends at {last.t[-1]:.2f} s; {other.id!r} begins {gap:.2f} s later {far:.2f} m from where it would be"
        one = found(
            "TRACK_BROKEN", table.source, name, (last.t[-1], other.t[0]), max(gap, 0.0), "s", text,
            limit=AFTER_GAP, other=other.id, details={"other": other.id},
        )  # fmt: skip
        out.append(one)
    return out


def _continues(ended: Track, begun: Track, step: float) -> float | None:
    """How far [m] the begun track's start is from where the ended one leads; None where it is no continuation."""
    gap = float(begun.t[0] - ended.t[-1])
    if not 0.5 * step < gap <= AFTER_GAP + 0.5 * step:
        return None
    velocity = np.median(ended.velocity()[-5:].real) + 1j * np.median(ended.velocity()[-5:].imag)
    far = abs(begun.p[0] - ended.p[-1] - gap * velocity)
    start = begun.velocity()[:5]
    change = abs(np.median(start.real) + 1j * np.median(start.imag) - velocity)
    hard = USUAL[ended.kind == PEDESTRIAN]
    if far > NEAR + gap * (0.1 * abs(velocity) + 0.5 * hard * gap):
        return None
    if change > FASTER + 0.1 * abs(velocity) + hard * gap:
        return None
    sizes = abs(ended.length - begun.length) / max(ended.length, begun.length)
    return float(far) if sizes < 0.3 else None


def parts_of(known: list[RankedFinding]) -> set[str]:
    """Give the SD ids under which broken tracks go on."""
    return {f.other for f in known if f.finding.code == "TRACK_BROKEN" and f.finding.source == "sd"}
