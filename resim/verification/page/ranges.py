"""How far a verified scenario can be varied until a KPI flips, drawn as bars (Groh 2018, III.C)."""

from __future__ import annotations

from collections.abc import Sequence

from resim.report.markup import Markup, html, join
from resim.verification.page.cells import minus, row, rows_table
from resim.verification.validity_interval import IntervalEnd, ValidityInterval

MEANING = Markup(
    "At every variation that was run within each interval no KPI flips in simulation, the run lasts to its end, and "
    "the EGO collides with nobody unless it does in the drive. This does not prove the interval safe: it is what "
    "<b>one real re-check at its end</b> would legitimise, and no further (Groh 2018, III.C). A flip and back between "
    "two variations that were run would not have been seen."
)
OVER_SEEDS = (
    "With the perception model that holds of more than {:g} of the seeds: each variation passed the test by which the "
    "recording is verified, and that is wrong in at most 5 % of cases."
)
WIDTH, MIDDLE = 220.0, 110.0
"""Of a bar's view box; no change is in the middle."""
REACH = 96.0
"""Units of the view box from the middle to the farther end."""


def ranges(validity: Sequence[ValidityInterval]) -> Markup:
    """Give the intervals of all parameters that were varied."""
    rows = [_range(v) for v in validity]
    head = ["parameter", "from", "", "to", "resolution"]
    shares = sorted({v.agreement for v in validity if v.agreement is not None})
    seeds = " ".join(OVER_SEEDS.format(share) for share in shares)
    return html("<p>{} {}</p>{}", MEANING, seeds, rows_table(head, rows, "ranges"))


def _range(v: ValidityInterval) -> Markup:
    of = html("{} <i>of object {}</i>", v.parameter, v.object)
    resolution = f"{v.resolution:g} {v.unit}, {v.tried} variations run"
    return row([of, _end(v.low, v.unit), _bar(v), _end(v.high, v.unit), resolution])


def _end(end: IntervalEnd, unit: str) -> Markup:
    """An end of the interval, and what flips behind it, or ends it otherwise."""
    flip = [f"{', '.join(end.flips)} {'flips' if len(end.flips) == 1 else 'flip'}"] if end.flips else []
    then = "; ".join([*flip, *end.others])
    amount = minus(f"{end.amount:+.3g}")
    told = f"then {then}" if then else "no KPI flips in the tested range"
    return html("<b>{} {}</b> <i>{}</i>", amount, unit, told)


def _bar(v: ValidityInterval) -> Markup:
    """The interval about no change: a stop where something flips, an arrow where the search ended first."""
    low, high = v.low, v.high
    far = max(abs(low.amount), abs(high.amount)) or 1.0
    a, b = (MIDDLE + REACH * end.amount / far for end in (low, high))
    ends = join(
        html('<path class="stop" d="M{:.1f} 3v16"/>', x)
        if end.flips or end.others
        else html('<path class="open" d="M{:.1f} 5l{:g} 6l{:g} 6"/>', x, way * 9.0, -way * 9.0)
        for x, end, way in ((a, low, -1.0), (b, high, 1.0))
    )
    return html(
        '<svg class="bar" viewBox="0 0 {width:g} 22" aria-hidden="true"><path class="grid" d="M0 11H{width:g}"/>'
        '<path class="held" d="M{a:.1f} 11H{b:.1f}"/><path class="frame" d="M{middle:g} 1v20"/>{ends}</svg>',
        width=WIDTH,
        a=a,
        b=b,
        middle=MIDDLE,
        ends=ends,
    )
