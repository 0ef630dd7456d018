"""What stays inexact, in words and as tables: lanes worst first, and gaps."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

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


def flaws_section(flaws: Sequence[Flaw]) -> str:
    """Give what is wrong in the map itself, worst first."""
    if not flaws:
        return "<p>No flaw was found.</p>"
    rows = [
        f"<tr><td>{flaw.severity}</td><td>{flaw.code}</td><td>{escape(flaw.text)}</td></tr>" for flaw in flaws[:MOST]
    ]  # fmt: skip
    counts = ", ".join(
        f"{number} {severity}{'s' if number > 1 else ''}"
        for severity in SEVERITIES if (number := sum(flaw.severity == severity for flaw in flaws))
    )  # fmt: skip
    return f'<p class="line">{counts}.</p>' + _table(("", "code", "what"), rows, len(flaws))


def errors_section(conversion: Conversion | None) -> str:
    """Give the section under the picture."""
    if conversion is None:
        return "<p>There is no SUMO net of this map, so that its errors are not known.</p>"
    vehicles = [lane for lane in conversion.bad if lane.type in VEHICLE_LANES]
    others = [lane for lane in conversion.bad if lane.type not in VEHICLE_LANES]
    parts = [f'<p class="line">{_verdict(conversion, len(vehicles))}</p>']
    for title, lanes in (("Lanes for vehicles", vehicles), ("Other lanes", others)):
        if lanes:
            parts.append(f"<h3>{title} that are missing or not exact, worst first ({len(lanes)})</h3>")
            parts.append(_table(LANE_HEAD, [_lane_row(lane) for lane in lanes[:MOST]], len(lanes)))
    if conversion.lost:
        parts.append(
            f"<h3>Links of lanes that the net has not ({len(conversion.lost)})</h3>"
            "<p>netconvert makes no connection of them.</p>"
        )
        rows = [f"<tr><td>{escape(link)}</td></tr>" for link in conversion.lost[:MOST]]
        parts.append(_table(("link",), rows, len(conversion.lost)))
    if conversion.jumps:
        jumps = conversion.jumps
        parts.append(
            f"<h3>Gaps in the map between linked lanes, widest first ({len(jumps)})</h3>"
            "<p>The map's lanes do not meet there; the net bridges the gap.</p>"
        )
        parts.append(_table(GAP_HEAD, [_gap_row(jump) for jump in jumps[:MOST]], len(jumps)))
    return "\n".join(parts)


def distance(value: float | None) -> str:
    """Give a distance [m] with its unit: millimetres below one metre."""
    if value is None:
        return "–"
    return f"{number(value, 2)} m" if value >= 1.0 else f"{number(1000.0 * value, 2)} mm"


def _verdict(conversion: Conversion, bad: int) -> str:
    lanes = conversion.lanes
    there = [lane for lane in lanes if lane.worst is not None]
    if not there:
        return f"None of the map's {len(lanes)} lanes is in the SUMO net."
    worst = max(there, key=lambda lane: lane.worst or 0.0)
    size = (
        f"the largest error is <b>{distance(worst.worst)}</b> ({escape(str(worst.key))}), "
        f"the mean {distance(conversion.mean)}"
    )
    if not conversion.bad:
        return f"<b>All {len(lanes)} lanes are in the SUMO net within their limit</b>: {size}."
    missing = sum(lane.worst is None for lane in lanes)
    over = len(conversion.bad) - missing
    if not bad:
        first = "<b>All lanes for vehicles are in the SUMO net within their limit</b>"
    else:
        first = f"<b>Lanes for vehicles that are missing or not exact: {bad}</b>"
    return (
        f"{first}. Of all {len(lanes)} lanes {missing} are not in the net and {over} beyond their limit; "
        f"of those that are there, {size}."
    )


def _table(head: Sequence[str], rows: Sequence[str], total: int) -> str:
    more = f'<p class="note">and {total - MOST} more</p>' if total > MOST else ""
    heads = "".join(f"<th>{name}</th>" for name in head)
    return (
        f'<div class="wide rows"><table class="places"><thead><tr>{heads}</tr></thead>\n<tbody>'
        + "\n".join(rows)
        + f"</tbody></table></div>{more}"
    )


def _lane_row(lane: LaneError) -> str:
    key = escape(f"{lane.road}\t{lane.section}\t{lane.lane}")
    cells = (
        escape(lane.road), lane.section, number(lane.lane, 0), escape(lane.type), escape(lane.junction or ""),
        "missing" if lane.worst is None else distance(lane.worst), distance(lane.mean), f"{1000 * lane.limit:g} mm",
        number(lane.s, 2), number(lane.x, 2), number(lane.y, 2), escape(lane.remark),
    )  # fmt: skip
    return _row(lane.x, lane.y, f' data-lane="{key}"', cells)


def _gap_row(jump: Jump) -> str:
    cells = (
        distance(jump.gap),
        escape(jump.origin),
        escape(jump.target),
        number(jump.x, 2),
        number(jump.y, 2),
    )
    return _row(jump.x, jump.y, "", cells)


def _row(x: float, y: float, extra: str, cells: Sequence[object]) -> str:
    inner = "".join(f"<td>{cell}</td>" for cell in cells)
    return f'<tr tabindex="0" data-x="{x:.2f}" data-y="{y:.2f}"{extra}>{inner}</tr>'
