"""The table of truth: which maneuvers a made drive holds, as its routes and speeds say."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pandas as pd

from resim.core.geometry import Floats, wrap_angle
from resim.road.opendrive import RoadNetwork
from resim.scenario.generation.lane_curve import LanePiece

TRUTH_COLUMNS = ("recording", "object", "label", "start", "end", "t", "partner", "lane_from", "lane_to")
"""One row a maneuver: recording, object, label, start, end and defining moment [s], partner ("" for none), and the
lanes ("road/lane", "" where it is no matter of lanes)."""
TURNS = np.pi / 6.0
"""Angle [rad] of a way through a junction from which on it is a turn and not straight (our choice)."""
U_TURNS = 0.75 * np.pi
"""Angle [rad] from which on it is a U-turn (our choice)."""


class TrueManeuver(NamedTuple):
    """A row of the table of truth, without its recording."""

    object: str
    label: str
    start: float
    end: float
    t: float
    partner: str = ""
    lane_from: str = ""
    lane_to: str = ""


def truth_table(recording: str, rows: Iterable[TrueManeuver]) -> pd.DataFrame:
    """Give the rows as a table with TRUTH_COLUMNS, by start, then object and label."""
    ordered = sorted(rows, key=lambda row: (row.start, row.object, row.label))
    table = pd.DataFrame([(recording, *row) for row in ordered], columns=[*TRUTH_COLUMNS])
    return table.round({"start": 6, "end": 6, "t": 6})


def lane_name(road: str, lane: int) -> str:
    """Give how the table calls a lane."""
    return f"{road}/{lane}"


class JunctionPass(NamedTuple):
    """A way through a junction.

    label: turn_left, turn_right, u_turn or straight. first, last: which pieces of a route are inside.
    """

    label: str
    first: int
    last: int
    lane_from: str
    lane_to: str


def junction_passes(network: RoadNetwork, pieces: tuple[LanePiece, ...]) -> list[JunctionPass]:
    """Give each whole way of a route through a junction that one can also leave by a turn.

    A junction at which ways only diverge or merge, as at a ramp, is none to turn at.
    """
    out, k = [], 0
    while k < len(pieces):
        junction = network.roads[pieces[k].road].junction
        last = k
        while last + 1 < len(pieces) and network.roads[pieces[last + 1].road].junction == junction:
            last += 1
        if junction is not None and k and last + 1 < len(pieces) and _has_turns(network, junction):
            angle = _turned(pieces[k : last + 1])
            side = "left" if angle > 0.0 else "right"
            label = "straight" if abs(angle) < TURNS else "u_turn" if abs(angle) > U_TURNS else f"turn_{side}"
            before, after = pieces[k - 1], pieces[last + 1]
            names = lane_name(before.road, before.to_lane), lane_name(after.road, after.lane)
            out.append(JunctionPass(label, k, last, *names))
        k = last + 1
    return out


def _turned(pieces: tuple[LanePiece, ...]) -> float:
    """The angle [rad] by which a route turns over some pieces."""
    headings = []
    for piece in pieces:
        _, _, dx, dy, _, _ = piece.at(np.linspace(0.0, piece.length, 9))
        headings.append(np.arctan2(dy, dx))
    course = np.unwrap(np.concatenate(headings))
    return float(course[-1] - course[0])


def _has_turns(network: RoadNetwork, junction: str) -> bool:
    """Whether a road of the junction turns by more than TURNS."""
    for road in network.roads.values():
        if road.junction == junction:
            _, _, heading = network.reference_line(road.id, np.array([0.0, road.length]))
            if abs(float(wrap_angle(heading[1] - heading[0]))) > TURNS:
                return True
    return False


def runs_of(t: Floats, mask: np.ndarray) -> list[tuple[float, float]]:
    """Give start and end [s] of the runs of true samples (K,) at times t (K,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(float(t[a]), float(t[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
