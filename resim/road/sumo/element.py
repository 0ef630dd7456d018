"""The curve of one <geometry>, computed anew for `truth`: no line is shared with `resim.road.opendrive.reference`."""

from __future__ import annotations

from math import ceil

import numpy as np
from lxml.etree import _Element

from resim.core.geometry import Floats

TURN, CHORD = 0.02, 0.005
FEWEST, MOST = 2_000, 200_000


class Element:
    """One <geometry>. bend: its curvature [1/m] at start and end; uv: of a polynomial, its two coordinates."""

    def __init__(self, geometry: _Element) -> None:
        self.s, self.length, self.x, self.y, self.heading = (
            number(geometry, name) for name in ("s", "length", "x", "y", "hdg")
        )
        curve = next(
            child for child in geometry if child.tag in ("line", "arc", "spiral", "poly3", "paramPoly3")
        )
        self.kind = str(curve.tag)
        self.bend = (0.0, 0.0)
        if self.kind == "arc":
            self.bend = (number(curve, "curvature"),) * 2
        elif self.kind == "spiral":
            self.bend = number(curve, "curvStart"), number(curve, "curvEnd")
        self.uv: tuple[np.polynomial.Polynomial, np.polynomial.Polynomial] | None = None
        if self.kind == "poly3":
            self.uv = np.polynomial.Polynomial([0.0, 1.0]), _polynomial(curve, "")
        elif self.kind == "paramPoly3":
            self.uv = _polynomial(curve, "U"), _polynomial(curve, "V")
        self.by_length = curve.get("pRange") == "arcLength"

    def places(self, ds: Floats) -> Floats:
        """Give x, y [m] and heading [rad] (3, K) at ascending distances ds (K,) [m] from its start."""
        z, turn = self._bent(ds) if self.uv is None else self._drawn(ds, *self.uv)
        z = complex(self.x, self.y) + z * np.exp(1j * self.heading)
        return np.stack([z.real, z.imag, self.heading + turn])

    def _bent(self, ds: Floats) -> tuple[Floats, Floats]:
        """Sum up exp(i turn) over distances, by Simpson's rule on steps that turn by at most TURN [rad]."""
        start, rate = self.bend[0], (self.bend[1] - self.bend[0]) / self.length
        most = max(abs(start), abs(start + rate * float(ds[-1])))
        fill = np.linspace(0.0, ds[-1], ceil(min(most * max(float(ds[-1]), 0.0) / TURN, MOST)) + 1)
        at = np.unique(np.concatenate([[0.0], ds, fill]))
        middle = 0.5 * (at[1:] + at[:-1])
        ways = [np.exp(1j * (start * p + 0.5 * rate * p * p)) for p in (at, middle)]
        sums = np.concatenate(
            [[0.0], np.cumsum(np.diff(at) * (ways[0][1:] + ways[0][:-1] + 4.0 * ways[1]) / 6.0)]
        )
        found = np.searchsorted(at, ds)
        return sums[found] - sums[np.searchsorted(at, 0.0)], start * ds + 0.5 * rate * ds * ds

    def _drawn(
        self, ds: Floats, u: np.polynomial.Polynomial, v: np.polynomial.Polynomial
    ) -> tuple[Floats, Floats]:
        """A polynomial's points: its parameter grows with the length of the curve, measured by chords."""
        p = ds
        if not self.by_length or self.kind == "poly3":
            end = 1.0 if self.kind == "paramPoly3" else self.length
            reach = max(float(ds[-1]) / self.length, 1.0)
            grid = np.linspace(0.0, end * reach, int(np.clip(self.length / CHORD, FEWEST, MOST)) + 1)
            run = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(u(grid)), np.diff(v(grid))))])
            scale = float(np.interp(end, grid, run)) / self.length if self.kind == "paramPoly3" else 1.0
            p = np.interp(ds * scale, run, grid)
        return u(p) + 1j * v(p), np.arctan2(v.deriv()(p), u.deriv()(p))


def _polynomial(curve: _Element, suffix: str) -> np.polynomial.Polynomial:
    return np.polynomial.Polynomial([number(curve, name + suffix) for name in "abcd"])


def number(element: _Element, name: str) -> float:
    """Give an attribute as a number."""
    return float(str(element.get(name)))
