"""Where the outcome of an adaptive sweep changes, in sentences: for the page and the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from resim.sweeps.boundary import BoundaryReport
from resim.sweeps.page.words import keeps, percent
from resim.sweeps.report import SweptParameter

ROWS = 16
"""Rows on where the outcome changes by a second parameter: of the terminal, and of the page before it folds them."""


def boundary_lines(
    found: BoundaryReport, parameters: Sequence[SweptParameter]
) -> Iterator[tuple[str, list[str]]]:
    """Give what is good, and sentences on where that changes and where it does not."""
    lines = [
        *_known(found, parameters),
        *_changes(found, parameters),
        *_ranges(found, parameters),
        _islands(found),
    ]
    yield f"{keeps(found, found.limit)}, {_asked(found)}", lines
    if found.strips and found.cells:
        first, second = parameters
        rows = [
            f"{of}: {where}{side and f' ({side})'}" for of, where, side in strip_lines(found, first, second)
        ]
        more = [f"and {len(rows) - ROWS} more, in the page's table"] if len(rows) > ROWS else []
        yield f"where it changes along {first.label}, by {second.label}", rows[:ROWS] + more


def _asked(found: BoundaryReport) -> str:
    """What makes a point good."""
    if found.needed == found.seeds:
        return "in each seed of a point" if found.seeds > 1 else "in the seed of a point"
    return f"in {found.needed} or more of the {found.seeds} seeds of a point"


def _known(found: BoundaryReport, parameters: Sequence[SweptParameter]) -> Iterator[str]:
    """How many points were tried, and how well the boundary is known by them."""
    tried = f"{found.points} points tested, {found.good} of them good"
    if not found.cells:
        yield f"{tried}: the outcome does not change between the points of the first grid"
        return
    cells = f"{tried}: the outcome changes in {len(found.cells)} cell{'s' * (len(found.cells) != 1)}"
    if found.known:
        yield f"{cells} of {_size(found, parameters, found.widest)}, as small as requested"
    else:
        yield cells
        yield ran_out(found, parameters)


def ran_out(found: BoundaryReport, parameters: Sequence[SweptParameter]) -> str:
    """Say that the plan had too few points, and what they leave open."""
    return (
        f"the boundary is not known to the requested width: points = {found.most} ran out before the next round, "
        f"and cells of up to {_size(found, parameters, found.widest)} are left open "
        f"(requested: {_size(found, parameters, found.widths)})"
    )


def _islands(found: BoundaryReport) -> str:
    """Say how likely it is that a small region where the outcome is another was missed."""
    sizes = ", ".join(f"{percent(i.size)}: {percent(i.missed)}" for i in found.islands)
    chance = f"probability to miss it, by its share of each range: {sizes}"
    return f"an island within one cell of the first grid is not found; {chance}"


def _size(
    found: BoundaryReport,
    parameters: Sequence[SweptParameter],
    sizes: Mapping[str, float] | Mapping[str, float | None] | None,
) -> str:
    """Sizes by parameter, one beside the other; nothing where there are none."""
    each = ((p, (sizes or {}).get(p.name)) for p in parameters)
    return " × ".join(_value(p, found, size) for p, size in each if size is not None)


def _changes(found: BoundaryReport, parameters: Sequence[SweptParameter]) -> Iterator[str]:
    """Where the outcome changes along each parameter."""
    if len(parameters) == 1:
        (p,) = parameters
        seeds = {tried.at[0]: tried.good_seeds for tried in found.tried}
        for ((low, high),) in found.cells:
            yield (
                f"the outcome changes between {_value(p, found, low)} and {_value(p, found, high)} of {p.label} "
                f"({seeds[low]} of {found.seeds} seeds good at the lower end, {seeds[high]} at the upper one)"
            )
        return
    for p in parameters:
        spans = found.changes[p.name]
        others = [q.label for q in parameters if q is not p]
        of = others[0] if len(others) == 1 else "the others"
        if spans == ((p.low, p.high),):
            yield f"{p.label}: it changes over the whole range, for some values of {of}"
        elif spans:
            yield f"{p.label}: it changes {_between(p, found, spans)}, for some values of {of}"


def _ranges(found: BoundaryReport, parameters: Sequence[SweptParameter]) -> Iterator[str]:
    """In which ranges every point that was tried is good."""
    what = keeps(found)
    by_name = {p.name: p for p in parameters}
    if any(r.side == "whole" for r in found.ranges):
        yield f"{what} at every tested point"
        return
    for r in found.ranges:
        if r.value is not None:
            p = by_name[r.parameter]
            value, side = _value(p, found, r.value), "more" if r.side == "over" else "less"
            yield f"{what} at every tested point with {p.label} of {value} or {side} ({r.points} points)"
    if not found.good:
        yield f"{what} at no tested point"
    elif not found.ranges:
        yield "from no end of a parameter's range on are all points good"


def strip_lines(
    found: BoundaryReport, first: SweptParameter, second: SweptParameter
) -> Iterator[tuple[str, str, str]]:
    """By intervals of the second parameter: where the outcome changes along the first, and where it is good."""
    for strip in found.strips or ():
        low, high = (_value(second, found, v) for v in strip.at)
        at = f"{low} to {high}"
        if not strip.changes:
            yield at, "nowhere", "good throughout" if strip.good else "good at none"
        for c in strip.changes:
            yield at, _between(first, found, [c.between]), SIDES[c.below, c.above]


SIDES: Mapping[tuple[bool | None, bool | None], str] = {
    (True, False): "good below", (False, True): "good above", (True, True): "good on both sides",
    (False, False): "good on neither side", (None, True): "good above", (None, False): "not good above",
    (True, None): "good below", (False, None): "not good below", (None, None): "",
}  # fmt: skip


def _between(p: SweptParameter, found: BoundaryReport, spans: Sequence[Sequence[float]]) -> str:
    parts = [f"between {_value(p, found, low)} and {_value(p, found, high)}" for low, high in spans]
    return ", ".join(parts[:-1]) + " and " * (len(parts) > 1) + parts[-1]


def _value(p: SweptParameter, found: BoundaryReport, value: float) -> str:
    """A value with as many digits as the finest step of the plan asks for, and its unit."""
    step = found.finest[p.name]
    first = max(0, -math.floor(math.log10(step)))
    exact = (
        d for d in range(first, first + 2) if all(abs(round(v, d) - v) < 1e-3 * step for v in (step, p.low))
    )
    text = f"{value:.{next(exact, first + 2)}f}".replace("-", "−")
    return f"{text} {p.unit}".strip()
