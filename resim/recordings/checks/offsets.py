"""Offsets: sensor data that has an object elsewhere than ground truth, by more than sensors usually err."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from resim.core.finding import Severity
from resim.core.geometry import Floats
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.matching import APART, MatchedTrack
from resim.recordings.checks.tracks import CheckedTable, runs

BIN = 1.0
"""Time [s] over which offsets are taken in the median: white noise goes."""
FEW = 3
"""Samples in a bin from which on it counts."""
ASIDE, TURNED = 1.0, 0.1
"""Offset [m] across the object's heading that sensors have, more by this part of the offset along it."""
AHEAD, LATE = 3.0, 0.3
"""Offset [m] along it that they have where no clock explains it, more by the way of this time [s]."""


@dataclass(frozen=True)
class _Off:
    """One object's worst offset [m] ahead and to the left, from start to end [s]."""

    pair: MatchedTrack
    along: float
    across: float
    start: float
    end: float

    @property
    def far(self) -> float:
        return float(np.hypot(self.along, self.across))

    @property
    def words(self) -> str:
        ways = [(self.along, "ahead of", "behind"), (self.across, "to the left of", "to the right of")]
        return " and ".join(
            f"{abs(m):.1f} m {a if m > 0.0 else b}" for m, a, b in ways if abs(m) > 0.1 * self.far
        )


def offsets(sd: CheckedTable, known: list[MatchedTrack], explained: set[str]) -> Iterator[RankedFinding]:
    """Give SD objects that are off their GT for a second or longer; where most are, one finding of the table.

    explained: SD ids whose offset ahead a clock explains, or a reference point.
    """
    found_off = [one for pair in known if (one := _off(pair, pair.sd.id in explained)) is not None]
    off = {one.pair.sd.id: one for one in sorted(found_off, key=lambda o: o.far)}  # of its pieces the worst
    every = {pair.sd.id for pair in known}
    if len(off) > max(2, 0.5 * len(every)):
        worst = max(off.values(), key=lambda o: o.far)
        across = float(np.median([o.across for o in off.values()]))
        side = f"{abs(across):.1f} m to the {'left' if across > 0.0 else 'right'}"
        text = (
            f"{len(off)} of {len(every)} objects are off their ground truth for a second or longer, {side} in the "
            f"median; {worst.pair.sd.id!r} worst, {worst.words} it"
        )
        yield _finding(sd, "", sd.span, worst.far, text)
        return
    for name, one in off.items():
        text = (
            f"is {one.words} {one.pair.gt.id!r} of the ground truth from {one.start:.2f} to {one.end:.2f} s"
        )
        yield _finding(sd, name, (one.start, one.end), one.far, text)


def _finding(sd: CheckedTable, name: str, span: tuple[float, float], far: float, text: str) -> RankedFinding:
    severity: Severity = "error" if far > APART else "warning"
    return found("SENSOR_OFFSET", sd.source, name, span, far, "m", text, limit=ASIDE, severity=severity)


def _off(pair: MatchedTrack, explained: bool) -> _Off | None:
    """The longest time in which the offset, in bins of 1 s, is beyond what is usual; None where it never is."""
    number = np.floor((pair.t - pair.t[0]) / BIN).astype(int)
    edges = np.flatnonzero(np.diff(number)) + 1

    def binned(values: Floats) -> Floats:
        return np.array([np.median(part) for part in np.split(values, edges)])

    along, across, v, t = (binned(values) for values in (pair.along, pair.across, pair.v, pair.t))
    enough = np.array([len(part) >= FEW for part in np.split(pair.t, edges)])
    beyond = np.abs(across) > ASIDE + TURNED * np.abs(along)
    if not explained:
        half = 0.5 * max(pair.gt.length, pair.sd.length)
        beyond |= np.abs(along) > max(AHEAD, half) + LATE * np.abs(v)
    spans = runs(beyond & enough)
    if not spans:
        return None
    a, b = max(spans, key=lambda span: span[1] - span[0])
    here = slice(a, b + 1)
    start, end = max(float(t[a]) - 0.5 * BIN, pair.t[0]), min(float(t[b]) + 0.5 * BIN, pair.t[-1])
    return _Off(pair, float(np.median(along[here])), float(np.median(across[here])), float(start), float(end))
