"""Small figures over time as inline SVG: axes with round ticks, curves with no more points than can be seen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Floats
from resim.report.markup import Markup, html, join
from resim.report.plots import clock_words

WIDTH, HEIGHT = 640.0, 240.0
LEFT, RIGHT, TOP, BOTTOM = 72.0, 14.0, 34.0, 50.0
"""Size and margins in the units of the view box; the texts grow on narrow screens (verification.css)."""
SEEN = 0.4
"""Units of the view box that a curve may be off."""


@dataclass(frozen=True)
class Axes:
    """Time [s] to the right and a quantity upwards, each from low to high."""

    t: tuple[float, float]
    y: tuple[float, float]
    label: str

    def x_of(self, t: float) -> float:
        """Give where a time is."""
        low, high = self.t
        return LEFT + (t - low) / (high - low) * (WIDTH - LEFT - RIGHT)

    def y_of(self, value: float) -> float:
        """Give where a value is."""
        low, high = self.y
        return HEIGHT - BOTTOM - (value - low) / (high - low) * (HEIGHT - TOP - BOTTOM)

    def line(self, t: Floats, values: Floats, css: str) -> Markup:
        """Give a curve; t, values (K,), NaN breaks it."""
        steps = "".join(f"M{'L'.join(self._points(t[k], values[k]))}" for k in _known(values))
        return html('<path class="{}" d="{}"/>', css, steps) if steps else Markup()

    def band(self, t: Floats, low: Floats, high: Floats, css: str) -> Markup:
        """Give the area between two curves; t, low, high (K,), both NaN at the same times."""
        steps = ""
        for k in _known(low + high):
            back = self._points(t[k], high[k])[::-1]
            steps += f"M{'L'.join([*self._points(t[k], low[k]), *back])}Z"
        return html('<path class="{}" d="{}"/>', css, steps) if steps else Markup()

    def dot(self, t: float, value: float, css: str) -> Markup:
        """Give a dot with a white rim."""
        return html('<circle class="{}" cx="{:.1f}" cy="{:.1f}" r="5"/>', css, self.x_of(t), self.y_of(value))

    def mark(self, t: float, text: str) -> Markup:
        """Give a vertical line at a time, with its text above."""
        x = self.x_of(t)
        anchor = "start" if x < 0.5 * WIDTH else "end"
        return html(
            '<path class="mark" d="M{x:.1f} {top:g}V{bottom:g}"/>'
            '<text class="marked" x="{x:.1f}" y="{above:g}" text-anchor="{anchor}">{text}</text>',
            x=x,
            top=TOP - 8.0,
            bottom=HEIGHT - BOTTOM,
            above=TOP - 14.0,
            anchor=anchor,
            text=text,
        )

    def svg(self, inside: Markup, title: str) -> Markup:
        """Give the figure; inside: what is drawn, title: what it shows."""
        return html(
            '<svg class="axes" viewBox="0 0 {:g} {:g}" role="img" aria-label="{}">{}{}</svg>',
            WIDTH,
            HEIGHT,
            title,
            self._frame(),
            inside,
        )

    def _frame(self) -> Markup:
        bottom, right = HEIGHT - BOTTOM, WIDTH - RIGHT
        rows = [(round(self.y_of(value), 1), value) for value in ticks(*self.y)]
        first, last = self.t
        columns = [(round(self.x_of(first + t), 1), t) for t in ticks(0.0, last - first)]
        grid = "".join(f"M{LEFT:g} {y:g}H{right:g}" for y, _ in rows)
        grid += "".join(f"M{x:g} {bottom:g}v5" for x, _ in columns)
        values = join(
            html('<text x="{:g}" y="{:g}">{:g}</text>', LEFT - 7.0, y + 5.0, value) for y, value in rows
        )
        times = join(html('<text x="{:g}" y="{:g}">{:g}</text>', x, bottom + 20.0, t) for x, t in columns)
        return html(
            '<path class="grid" d="{grid}"/><path class="frame" d="{frame}"/>'
            '<text x="2" y="{above:g}">{label}</text><g text-anchor="end">{values}'
            '<text x="{right:g}" y="{below:g}">{clock}</text></g><g text-anchor="middle">{times}</g>',
            grid=grid,
            frame=f"M{LEFT:g} {TOP:g}V{bottom:g}H{right:g}",
            above=TOP - 14.0,
            label=self.label,
            values=values,
            right=right,
            below=HEIGHT - 8.0,
            clock=clock_words(first),
            times=times,
        )

    def _points(self, t: Floats, values: Floats) -> list[str]:
        x = np.array([self.x_of(float(one)) for one in t])
        y = np.array([self.y_of(float(one)) for one in values])
        return [f"{round(x[k], 1):g} {round(y[k], 1):g}" for k in seen(x, y)]


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Give round values from low to high, at most `most` steps of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= rough * (1.0 - 1e-9))
    first, last = math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6)
    return [round(k * step, 9) + 0.0 for k in range(first, last + 1)]


def seen(x: Floats, y: Floats) -> list[int]:
    """Give which points of a curve are to be drawn, so that it is nowhere off by more than SEEN (Ramer 1972)."""
    kept, todo = {0, len(x) - 1}, [(0, len(x) - 1)]
    while todo:
        a, b = todo.pop()
        if b - a < 2:
            continue
        along, up = x[b] - x[a], y[b] - y[a]
        off = np.abs(along * (y[a + 1 : b] - y[a]) - up * (x[a + 1 : b] - x[a])) / max(
            np.hypot(along, up), 1e-9
        )
        k = a + 1 + int(off.argmax())
        if off[k - a - 1] > SEEN:
            kept.add(k)
            todo += [(a, k), (k, b)]
    return sorted(kept)


def array(values: Sequence[float | None]) -> Floats:
    """Give values as JSON has them as an array (K,), NaN for None."""
    return np.array([np.nan if v is None else v for v in values], dtype=float)


def _known(values: Floats) -> Iterator[slice]:
    """Parts without NaN."""
    finite = np.r_[False, np.isfinite(values), False]
    edges = np.flatnonzero(finite[1:] != finite[:-1])
    return (slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True))
