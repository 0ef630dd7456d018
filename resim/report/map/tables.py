"""What stays inexact, in words and as tables: lanes worst first, and gaps."""

from __future__ import annotations

from collections.abc import Sequence

from resim.core.spelling import counted
from resim.report.markup import Markup, html, join
from resim.report.plots import number
from resim.road.flaws import SEVERITIES, Flaw
from resim.road.opendrive import VEHICLE_LANES
from resim.road.sumo import Conversion, Jump, LaneError

MOST = 1000
"""Rows of one table; conversion.json has them all."""

LANE_HEAD = (
    "road", "section", "lane", "type", "junction", "worst", "mean", "limit", "s [m]", "x [m]", "y [m]", "remark",
)  # fmt: skip
GAP_HEAD = ("gap", "from SUMO lane", "to SUMO lane", "x [m]", "y [m]")


def flaws_section(flaws: Sequence[Flaw]) -> Markup:
    """Give what is wrong in the map itself, worst first."""
    if not flaws:
        return Markup("<p>No flaw was found.</p>")
    rows = [
        html("<tr><td>{}</td><td>{}</td><td>{}</td></tr>", flaw.severity, flaw.code, flaw.text) for flaw in flaws[:MOST]
    ]  # fmt: skip
    counts = ", ".join(
        counted(number, severity)
        for severity in SEVERITIES if (number := sum(flaw.severity == severity for flaw in flaws))
    )  # fmt: skip
    return html('<p class="line">{}.</p>', counts) + _table(("", "code", "what"), rows, len(flaws))


def errors_section(conversion: Conversion | None) -> Markup:
    """Give the section under the picture."""
    if conversion is None:
        return Markup("<p>There is no SUMO net of this map, so that its errors are not known.</p>")
    vehicles = [lane for lane in conversion.bad if lane.type in VEHICLE_LANES]
    others = [lane for lane in conversion.bad if lane.type not in VEHICLE_LANES]
    parts = [html('<p class="line">{}</p>', _verdict(conversion, len(vehicles)))]
    for title, lanes in (("Lanes for vehicles", vehicles), ("Other lanes", others)):
        if lanes:
            parts.append(
                html("<h3>{} that are missing or not exact, worst first ({})</h3>", title, len(lanes))
            )
            parts.append(_table(LANE_HEAD, [_lane_row(lane) for lane in lanes[:MOST]], len(lanes)))
    if conversion.lost:
        parts.append(
            html(
                "<h3>Links of lanes that the net has not ({})</h3>"
                "<p>netconvert makes no connection of them.</p>",
                len(conversion.lost),
            )
        )
        rows = [html("<tr><td>{}</td></tr>", link) for link in conversion.lost[:MOST]]
        parts.append(_table(("link",), rows, len(conversion.lost)))
    if conversion.jumps:
        jumps = conversion.jumps
        parts.append(
            html(
                "<h3>Gaps in the map between linked lanes, widest first ({})</h3>"
                "<p>The map's lanes do not meet there; the net bridges the gap.</p>",
                len(jumps),
            )
        )
        parts.append(_table(GAP_HEAD, [_gap_row(jump) for jump in jumps[:MOST]], len(jumps)))
    return join(parts, "\n")


def distance(value: float | None) -> str:
    """Give a distance [m] with its unit: millimetres below one metre."""
    if value is None:
        return "–"
    return f"{number(value, 2)} m" if value >= 1.0 else f"{number(1000.0 * value, 2)} mm"


def _verdict(conversion: Conversion, bad: int) -> Markup:
    lanes = conversion.lanes
    there = [lane for lane in lanes if lane.worst is not None]
    if not there:
        return html("None of the map's {} lanes is in the SUMO net.", len(lanes))
    worst = max(there, key=lambda lane: lane.worst or 0.0)
    size = html(
        "the largest error is <b>{}</b> ({}), the mean {}",
        distance(worst.worst),
        worst.key,
        distance(conversion.mean),
    )
    if not conversion.bad:
        return html("<b>All {} lanes are in the SUMO net within their limit</b>: {}.", len(lanes), size)
    missing = sum(lane.worst is None for lane in lanes)
    over = len(conversion.bad) - missing
    if not bad:
        first = Markup("<b>All lanes for vehicles are in the SUMO net within their limit</b>")
    else:
        first = html("<b>Lanes for vehicles that are missing or not exact: {}</b>", bad)
    return html(
        "{}. Of all {} lanes {} are not in the net and {} beyond their limit; of the others, {}.",
        first,
        len(lanes),
        missing,
        over,
        size,
    )


def _table(head: Sequence[str], rows: Sequence[Markup], total: int) -> Markup:
    more = html('<p class="note">and {} more</p>', total - MOST) if total > MOST else ""
    heads = join(html("<th>{}</th>", name) for name in head)
    return html(
        '<div class="wide rows"><table class="places"><thead><tr>{}</tr></thead>\n<tbody>{}</tbody></table></div>{}',
        heads,
        join(rows, "\n"),
        more,
    )


def _lane_row(lane: LaneError) -> Markup:
    key = f"{lane.road}\t{lane.section}\t{lane.lane}"
    cells = (
        lane.road, lane.section, number(lane.lane, 0), lane.type, lane.junction or "",
        "missing" if lane.worst is None else distance(lane.worst), distance(lane.mean), f"{1000 * lane.limit:g} mm",
        number(lane.s, 2), number(lane.x, 2), number(lane.y, 2), lane.remark,
    )  # fmt: skip
    return _row(lane.x, lane.y, html(' data-lane="{}"', key), cells)


def _gap_row(jump: Jump) -> Markup:
    cells = (
        distance(jump.gap),
        jump.origin,
        jump.target,
        number(jump.x, 2),
        number(jump.y, 2),
    )
    return _row(jump.x, jump.y, "", cells)


def _row(x: float, y: float, extra: str, cells: Sequence[object]) -> Markup:
    inner = join(html("<td>{}</td>", cell) for cell in cells)
    return html('<tr tabindex="0" data-x="{:.2f}" data-y="{:.2f}"{}>{}</tr>', x, y, extra, inner)
