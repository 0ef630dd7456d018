"""Rules of the road: speed over the limit, leaving the lane, leaving the road."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from resim.core.geometry import Bools, Floats, box_corners
from resim.core.tracks import Tracks
from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.values import MeasureValues, State
from resim.road.opendrive import RoadNetwork, RoadPositions

SPEED_OVER_LIMIT = MeasureDefinition(
    name="speed over limit",
    unit="m/s",
    worst="high",
    kind="legal",
    source="the map's limit (ASAM OpenDRIVE: road type and lane speed)",
    meaning="speed above the map's limit; negative is below it",
    own=lambda tracks, network: speed_over_limit(tracks, network),
    alone=True,
)


def speed_over_limit(tracks: Tracks, network: RoadNetwork) -> MeasureValues:
    """Give v - limit (N, T) [m/s]; negative is below the limit.

    The limit is that of the lane the box's centre is in (`RoadNetwork.speed_limit`). NOT_DEFINED where there is no
    limit or the centre is on no lane; NOT_COMPUTED where there is no sample.
    """
    place, _ = _places(tracks, network)
    limit = np.where(place.on_road, network.speed_limit(place.road, place.lane, place.s), np.nan)
    return _values(SPEED_OVER_LIMIT, tracks.v[tracks.valid] - limit, tracks.valid)


LANE_OVERHANG = MeasureDefinition(
    name="lane overhang",
    unit="m",
    worst="high",
    kind="legal",
    source="German road traffic act, section 7 (lanes)",
    meaning="how far the box reaches over its lane's border",
    own=lambda tracks, network: lane_overhang(tracks, network),
    alone=True,
)


def lane_overhang(tracks: Tracks, network: RoadNetwork) -> MeasureValues:
    """Give how far (N, T) [m] the box reaches over the border of its lane; negative is room left.

    |t| + ½ (length |sin| + width |cos|) - ½ lane width, for the lane the centre is in, taken as straight over the
    length of the box, angles against the lane's direction; off all lanes, of the nearest one that vehicles drive on.
    NOT_DEFINED where the size is unknown; NOT_COMPUTED where there is no sample.
    """
    place, _ = _places(tracks, network)
    turn = tracks.heading[tracks.valid] - network.lane_heading(place.road, place.lane, place.s)
    length, width = _sizes(tracks)
    half = 0.5 * (length * np.abs(np.sin(turn)) + width * np.abs(np.cos(turn)))
    over = np.abs(place.t) + half - 0.5 * network.lane_width(place.road, place.lane, place.s)
    return _values(LANE_OVERHANG, over, tracks.valid)


OFF_ROAD = MeasureDefinition(
    name="off the road",
    unit="1",
    worst="high",
    kind="legal",
    source="German road traffic act, section 2 (1) (carriageways)",
    meaning="corners of the box that are on no lane for vehicles",
    own=lambda tracks, network: off_road(tracks, network),
    alone=True,
)


def off_road(tracks: Tracks, network: RoadNetwork) -> MeasureValues:
    """Give how many (N, T) of the box's four corners are on no lane that vehicles drive on.

    NOT_DEFINED where the size is unknown; NOT_COMPUTED where there is no sample.
    """
    length, width = _sizes(tracks)
    _, on_road = _places(tracks, network)
    off = np.where(np.isfinite(length + width), 4.0 - on_road.sum(axis=1), np.nan)
    return _values(OFF_ROAD, off, tracks.valid)


@lru_cache(maxsize=1)
def _places(tracks: Tracks, network: RoadNetwork) -> tuple[RoadPositions, Bools]:
    """Where the centres (samples,) of all valid samples are on the road, and which corners (samples, 4) are on it.

    Looked up together, which takes as long as either, and kept for the next measure of the tracks.
    """
    x, y, heading = (column[tracks.valid] for column in (tracks.x, tracks.y, tracks.heading))
    corners, n = box_corners(x, y, heading, *_sizes(tracks)).reshape(-1, 2).T, len(x)
    every = network.to_road(
        np.concatenate([x, corners[0]]), np.concatenate([y, corners[1]]),
        heading=np.concatenate([heading, np.full(4 * n, np.nan)]),  # a corner heads nowhere
        z=None if tracks.z is None else np.concatenate([z := tracks.z[tracks.valid], np.repeat(z, 4)]),
    )  # fmt: skip
    centres = RoadPositions(every.road[:n], every.lane[:n], every.s[:n], every.t[:n], every.on_road[:n])
    return centres, every.on_road[n:].reshape(n, 4)


def _sizes(tracks: Tracks) -> tuple[Floats, Floats]:
    """Length and width (samples,) of all valid samples, NaN where unknown."""
    row = np.nonzero(tracks.valid)[0]
    length, width = (np.where(size > 0.0, size, np.nan)[row] for size in (tracks.length, tracks.width))
    return length, width


def _values(of: MeasureDefinition, value: Floats, valid: Bools) -> MeasureValues:
    """Values (N, T) of the values (samples,) of all valid samples."""
    every = np.full(valid.shape, np.nan)
    every[valid] = value
    state = np.where(np.isfinite(every), State.VALUE, State.NOT_DEFINED)
    return of.values(every, np.where(valid, state, State.NOT_COMPUTED).astype(np.uint8))
