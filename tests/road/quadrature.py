"""Maps read and integrated anew, sharing no code with the evaluator: the truth that it and the nets are held to.

The XML is read as it stands; headings of each <geometry> are integrated by Gauss quadrature, arc lengths inverted by
root finding, widths of lanes added up.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
from lxml import etree
from scipy.optimize import brentq

from resim.road.opendrive import load

DATA = Path(__file__).parents[3] / "shared" / "data"
MADE = Path(__file__).parent / "maps"
NETWORKS = Path(__file__).parents[2] / "networks"
FILES = {
    str(path.relative_to(folder)): path
    for folder in (NETWORKS, DATA)
    for path in sorted(folder.rglob("*.xodr"))
}
OWN = {path.name: path for path in sorted(MADE.glob("*.xodr"))}
"""Maps made for the tests, with records that the real ones lack."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
network = cache(load)


def number(element, name):
    return float(element.get(name))


def exact(element, name):
    """An attribute as it is written, to the last digit."""
    return Fraction(element.get(name))


def last_before(records, key, s):
    """The record in force at s (exact): the last that begins at or before it, the first where none does."""
    records = sorted(records, key=lambda record: exact(record, key))
    return records[max(bisect_right([exact(record, key) for record in records], s) - 1, 0)]


def cubic(record, ds):
    a, b, c, d = (number(record, name) for name in "abcd")
    return a + b * ds + c * ds**2 + d * ds**3


def profile(records, key, s):
    """The piecewise cubic at s, 0 without records."""
    if not records:
        return 0.0
    record = last_before(records, key, Fraction(s))
    return cubic(record, float(Fraction(s) - exact(record, key)))


def integral(f, end, panels):
    """The integral of f from 0 to end by 12-point Gauss quadrature on equal panels."""
    h = end / panels
    at = (np.arange(panels)[:, None] + 0.5 * (NODES + 1.0)) * h
    return 0.5 * h * np.sum(f(at) * WEIGHTS)


@dataclass
class Piece:
    """One <geometry>, integrated."""

    element: etree._Element

    def __post_init__(self):
        self.s, self.length, self.heading = (number(self.element, name) for name in ("s", "length", "hdg"))
        self.origin = complex(number(self.element, "x"), number(self.element, "y"))
        self.curve = next(child for child in self.element if isinstance(child.tag, str))
        self.kind = etree.QName(self.curve).localname

    def at(self, ds):
        """Position (complex) and heading at ds from the piece's start."""
        local, turn = self.polynomial(ds) if "oly3" in self.kind else self.by_heading(ds)
        return self.origin + local * np.exp(1j * self.heading), self.heading + turn

    def by_heading(self, ds):
        start = end = 0.0
        if self.kind == "arc":
            start = end = number(self.curve, "curvature")
        elif self.kind == "spiral":
            start, end = number(self.curve, "curvStart"), number(self.curve, "curvEnd")

        def turn(s):
            return start * s + 0.5 * (end - start) / self.length * s**2

        panels = 4 + int(2 * max(abs(start), abs(end)) * self.length)
        return integral(lambda s: np.exp(1j * turn(s)), ds, panels), turn(ds)

    def polynomial(self, ds):
        if self.kind == "poly3":
            u, v = np.polynomial.Polynomial([0, 1]), self.coefficients("")
        else:
            u, v = self.coefficients("U"), self.coefficients("V")
        du, dv = u.deriv(), v.deriv()

        def arc(p):
            return integral(lambda q: np.hypot(du(q), dv(q)), p, 64)

        if self.kind == "poly3":
            p = brentq(lambda q: arc(q) - ds, 0.0, self.length, xtol=1e-13)
        elif self.curve.get("pRange", "normalized") == "arcLength":
            p = ds
        else:  # s and the arc length are proportional; the file's length may differ from the curve's own
            share = ds / self.length * arc(1.0)
            p = brentq(lambda q: arc(q) - share, 0.0, 1.0, xtol=1e-14)
        return complex(u(p), v(p)), math.atan2(dv(p), du(p))

    def coefficients(self, suffix):
        return np.polynomial.Polynomial([number(self.curve, name + suffix) for name in "abcd"])


class RawRoad:
    """One <road> of the file, and where things are on it."""

    def __init__(self, element):
        self.element, self.id = element, element.get("id")
        geometries = element.findall("{*}planView/{*}geometry")
        self.pieces = [Piece(g) for g in geometries if number(g, "length") > 1e-9]
        self.sections = element.findall("{*}lanes/{*}laneSection")
        self.starts = [number(section, "s") for section in self.sections]
        self.offsets = element.findall("{*}lanes/{*}laneOffset")
        self.elevations = element.findall("{*}elevationProfile/{*}elevation")
        self.rolls = element.findall("{*}lateralProfile/{*}superelevation")

    def span(self, piece):
        """Where a piece is in force: up to the next one, which begins earlier or later than it ends."""
        following = [other.s for other in self.pieces if other.s > piece.s]
        return piece.s, min([*following, piece.s + piece.length])

    def lanes(self, s):
        """The lanes at s, each with the section that describes it: a single-sided one leaves the other side."""
        held = {}
        for section, start in zip(self.sections, self.starts, strict=True):
            if start <= s or not held:
                sides = [side for side in ("left", "right") if section.find(f"{{*}}{side}") is not None]
                if section.get("singleSide") == "true":
                    held = {
                        lane: own
                        for lane, own in held.items()
                        if ("left" if lane > 0 else "right") not in sides
                    }
                else:
                    held = {}
                held |= {int(lane.get("id")): (section, lane) for lane in section.iterfind("{*}*/{*}lane")}
        return held

    def borders(self, lane, s):
        """The inner and outer border's t of the lane at s: the lane offset and the widths up to it."""
        lanes = self.lanes(s)
        begin = min((number(offset, "s") for offset in self.offsets), default=math.inf)
        inner = outer = profile(self.offsets, "s", s) if s >= begin else 0.0
        side = 1 if lane > 0 else -1
        for between in range(side, lane + side, side) if lane else ():
            section, element = lanes[between]
            inner, ds = outer, Fraction(s) - exact(section, "s")
            widths, borders = element.findall("{*}width"), element.findall("{*}border")
            if borders and not widths:
                outer = profile(borders, "sOffset", ds)
            else:
                outer = inner + side * profile(widths, "sOffset", ds)
        return inner, outer


@cache
def raw_roads(name):
    return [RawRoad(element) for element in etree.parse((OWN | FILES)[name]).getroot().iterfind("{*}road")]
