"""A map of a cross of four roads of one lane each way, named by where they lie; every way leads straight on."""

from __future__ import annotations

import numpy as np
import sumolib
from road.small_maps import lane, road, section

NODE = "9.junction"
WAYS = {"w": ("W.0", "E.0"), "e": ("-E.0", "-W.0"), "s": ("S.0", "N.0"), "n": ("-N.0", "-S.0")}
"""Edges of the net that traffic drives from each side."""


def arm(name, x, y, heading, *, ends_here, signals=""):
    both = section((1, lane(1)), (-1, lane(-1)))
    ends = {"after": "junction:9"} if ends_here else {"before": "junction:9"}
    text = road(name, x, y, heading, 90, both, **ends)
    return text.replace("</road>", f"<signals>{signals}</signals></road>")


def way(name, x, y, heading, origin, target, lanes):
    before, after = lanes
    inner = section((-1, lane(-1, before=before, after=after)))
    return road(name, x, y, heading, 20, inner, before=f"road:{origin}", after=f"road:{target}", junction="9")


def cross(*, junction="", controllers="", inside="", **signals):
    """The cross. signals: at the roads W, E, S, N; junction: elements of it; inside: signals on the way from W."""
    from_w = way("we", -10, 0, 0, "W:end", "E:start", (-1, -1))
    ends = [("W", "we", -1), ("E", "ew", 1), ("S", "sn", -1), ("N", "ns", 1)]
    connections = "".join(
        f'<connection id="{k}" incomingRoad="{arm}" connectingRoad="{way}" contactPoint="start">'
        f'<laneLink from="{number}" to="-1"/></connection>'
        for k, (arm, way, number) in enumerate(ends)
    )
    return (
        arm("W", -100, 0, 0, ends_here=True, signals=signals.get("W", "")),
        arm("E", 10, 0, 0, ends_here=False, signals=signals.get("E", "")),
        arm("S", 0, -100, np.pi / 2, ends_here=True, signals=signals.get("S", "")),
        arm("N", 0, 10, np.pi / 2, ends_here=False, signals=signals.get("N", "")),
        from_w.replace("</road>", f"<signals>{inside}</signals></road>"),
        way("ew", 10, 0, np.pi, "E:start", "W:end", (1, 1)),
        way("sn", 0, -10, np.pi / 2, "S:end", "N:start", (-1, -1)),
        way("ns", 0, 10, -np.pi / 2, "N:start", "S:end", (1, 1)),
        controllers,
        f'<junction id="9">{connections}{junction}</junction>',
    )


def signal(name, kind, *, s=88.0, orientation="+", dynamic="no", inside="", country="DE"):
    place = f'id="{name}" s="{s}" t="-4" orientation="{orientation}"'
    return f'<signal {place} dynamic="{dynamic}" country="{country}" type="{kind}">{inside}</signal>'


def light(name, **place):
    return signal(name, "1000001", dynamic="yes", country="OpenDRIVE", **place)


LIGHTS = {
    "W": light("lw"), "S": light("ls"),
    "E": light("le", s=2.0, orientation="-"), "N": light("ln", s=2.0, orientation="-"),
}  # fmt: skip


def controller(name, *lights, sequence=0):
    inside = "".join(f'<control signalId="{light}"/>' for light in lights)
    return f'<controller id="{name}" sequence="{sequence}">{inside}</controller>'


def read(converted):
    """Read a net as sumolib does, with the programs of traffic lights."""
    return sumolib.net.readNet(str(converted.path), withPrograms=True, withInternal=True)
