"""Lines that leave the measured way for a lane beside it, or come back to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats, smooth_step
from resim.simulation.reactive.ways import Line, Way

_CHORD = 5.0
"""m before and after a place, of the chord to which "aside" is at right angles: headings of who stands are noise."""


class Aside(Line):
    """A line so far [m] to the left of the way's grid at each of its points: offset (P,).

    returns: whether it is the way itself, once the change is over. begin: offset [m] where the change begins.
    """

    returns: bool = False
    begin: float = 0.0

    def clear_at(self, s: float, position: NDArray[np.complex128], aside: float) -> float:
        """Give s [m], not before the one given, from where on it is `aside` [m] beside positions (M,), or infinity.

        On the side to which it goes.
        """
        ahead, left = self.places(s, position)
        towards = 1.0 if self.offset[np.searchsorted(self.s, self.done)] > self.begin else -1.0
        there = float(np.max(towards * (np.interp(s + ahead, self.s, self.offset) + left)))
        clear = (towards * self.offset - there >= aside) & (self.s >= s)
        return float(self.s[int(clear.argmax())]) if clear.any() else np.inf

    def __init__(self, way: Way, offset: Floats, done: float, until: float) -> None:
        """Args are stations [m]: done, where the change is over; until, where the lane ends."""
        grid = way.grid
        self.offset = offset
        position = grid.position + 1j * np.exp(1j * _direction(grid)) * offset
        s = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(position)))])
        turned = np.angle(np.gradient(position, grid.s) / np.gradient(grid.position, grid.s))
        ends = (float(np.interp(done, grid.s, s)), float(np.interp(until, grid.s, s, right=np.inf)))
        super().__init__(position, grid.heading + turned, s, grid.s, grid.z, (way.length, way.width))
        self.done, self.until = ends


def leaving(way: Way, line: Line, station: float, length: float, target: Floats, until: float) -> Aside:
    """Give the line that goes from `line`, at a station [m], over to `target` within length [m], and stays there.

    target: offsets (P,) [m] at the points of the way's grid. until: station [m] at which the lane ends.

    It goes over by `smooth_step` of the share of the length: no jump in direction or curvature at either end.
    """
    share = smooth_step((way.grid.s - station) / length)[0]
    out = Aside(way, offset_of(way, line) * (1.0 - share) + target * share, station + length, until)
    out.returns, out.begin = not target.any(), float(np.interp(station, way.grid.s, out.offset))
    return out


def offset_of(way: Way, line: Line) -> Floats:
    """Give how far (P,) [m] left of the points of its way's grid a line is."""
    return line.offset if isinstance(line, Aside) else np.zeros(len(way.grid.s))


def _direction(grid: Line) -> Floats:
    """The direction (P,) [rad] of the way at the points of its grid, of chords."""
    before, after = (
        np.interp(grid.s + off, grid.s, grid.position.real)
        + 1j * np.interp(grid.s + off, grid.s, grid.position.imag)
        for off in (-_CHORD, _CHORD)
    )
    return np.asarray(np.angle(after - before))
