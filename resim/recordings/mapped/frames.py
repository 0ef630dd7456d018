"""Frames of tables: coordinate systems of the earth, axes laid into the map, the EGO's and its sensor's view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.errors import InputError
from resim.core.geometry import Bools, Floats, from_frame, to_frame, wrap_angle
from resim.core.tracks import Tracks
from resim.recordings.mapped.mapping import HeadingColumn, Reference, TableMapping
from resim.recordings.mapped.rows import SourceTable
from resim.road.opendrive import RoadNetwork

FAR = 1e5
"""Median distance [m] from the map's first road from which on a crs, or an order of columns, is wrong."""
STEP = 10.0
"""Way [m] by which the direction of north in the map is found."""
NORTH = 0.5 * np.pi

ALONG_ACROSS: dict[Reference, tuple[float, float]] = {
    "center": (0.0, 0.0),
    "front": (0.5, 0.0),
    "rear": (-0.5, 0.0),
    "rear axle": (-0.5, 0.0),
    "front left": (0.5, 0.5),
    "front right": (0.5, -0.5),
    "rear left": (-0.5, 0.5),
    "rear right": (-0.5, -0.5),
}
"""Where a reference point is on the box, in lengths ahead and widths to the left of the centre."""


@dataclass(frozen=True, eq=False)
class MapPositions:
    """Positions of K rows in the map, and how their table's axes lie there.

    Attributes:
        x: (K,) m, map frame.
        y: (K,) m, map frame.
        turn: (K,) rad, direction of the table's x axis in the map.
        north: (K,) rad, direction of north in the map.
        vx: (K,) m/s, the EGO's velocity, for relative ones; NaN where that is not known.
        vy: (K,) m/s.
        known: (K,) whether the row can be placed: the EGO is there.
    """

    x: Floats
    y: Floats
    turn: Floats
    north: Floats
    vx: Floats
    vy: Floats
    known: Bools

    def heading(self, raw: Floats, told: HeadingColumn) -> Floats:
        """Give headings [rad] in the map of those in the table."""
        return wrap_angle(self.turned(raw, told))

    def turned(self, raw: Floats, told: HeadingColumn) -> Floats:
        """Give the same, with the turns that the table's count."""
        zero = self.north if told.zero == "north" else self.turn
        return (-raw if told.clockwise else raw) + zero


def place(rows: SourceTable, t: Floats, network: RoadNetwork, ego: Tracks | None) -> MapPositions:
    """Lay the rows' positions into the map. t: (K,) s; ego: the EGO's track, where it is known. Raises InputError."""
    told = rows.mapping
    if told.crs is not None:
        x, y, turn = _projected(rows, told.crs, network)
        north = turn + NORTH
    else:
        x, y = rows.coordinates(degrees=False)
        y = -y if told.mirrored else y
        x, y, turn = _laid(told, x, y, t, ego)
        north = np.full(len(t), NORTH)
    vx, vy = _velocity(ego, t)
    return MapPositions(x, y, turn, north, vx, vy, np.isfinite(turn))


def centred(
    told: TableMapping, x: Floats, y: Floats, heading: Floats, length: Floats, width: Floats
) -> tuple[Floats, Floats]:
    """Give the centres [m] of boxes by their reference points."""
    along, across = ALONG_ACROSS[told.reference]
    if not (along or across):
        return x, y
    ahead, left = along * length + (told.rear_overhang or 0.0), across * width
    return from_frame(-ahead, -left, x, y, heading)


def _laid(
    told: TableMapping, x: Floats, y: Floats, t: Floats, ego: Tracks | None
) -> tuple[Floats, Floats, Floats]:
    """Positions in the map of those in a frame that lies, or drives, in it; and the direction of its x axis."""
    if told.frame == "map":
        east, north, turn = told.offset or (0.0, 0.0, 0.0)
        return *from_frame(x, y, east, north, turn), np.full(len(t), turn)
    if ego is None:
        raise ValueError("the EGO's track is read before what lies in its frame")
    x0, y0, heading, _ = _poses(ego, t)
    if told.mounting is not None:
        ahead, left, turn = told.mounting
        x0, y0 = from_frame(ahead, left, x0, y0, heading)
        heading = heading + turn
    return *from_frame(x, y, x0, y0, heading), heading


def _velocity(ego: Tracks | None, t: Floats) -> tuple[Floats, Floats]:
    """The EGO's velocity [m/s] in the map at the times (K,)."""
    if ego is None:
        return np.full(len(t), np.nan), np.full(len(t), np.nan)
    _, _, heading, v = _poses(ego, t)
    return v * np.cos(heading), v * np.sin(heading)


def _poses(ego: Tracks, t: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """The EGO's x, y, heading and v (K,) at times (K,), NaN but between samples at most two usual steps apart."""
    known = ego.t[ego.valid[0]]
    step = float(np.median(np.diff(known))) if len(known) > 1 else 0.0
    times, places = np.unique(t, return_inverse=True)
    own = ego.at(times, max_gap=2.0 * step)
    return own.x[0, places], own.y[0, places], own.heading[0, places], own.v[0, places]


def _projected(rows: SourceTable, crs: str, network: RoadNetwork) -> tuple[Floats, Floats, Floats]:
    """Positions in the map of those in a crs, and the direction of its east there."""
    from pyproj import CRS, Geod, Transformer
    from pyproj.exceptions import CRSError, ProjError

    road = map_crs(network)
    try:
        source = CRS.from_user_input(crs)
    except CRSError as e:
        problem = f"{rows.where}.crs is {crs!r}, which pyproj does not know ({_first(e)})"
        raise InputError(rows.path, problem, "Give one such as EPSG:4326 or EPSG:25832.") from e
    geographic = bool(source.is_geographic)
    if not geographic and rows.mapping.lat is not None:
        raise InputError(
            rows.path, f"{rows.where}.crs {crs!r} has metres, but lat and lon are named", "Name x and y."
        )
    east, north = rows.coordinates(degrees=geographic)
    if geographic:
        _check_degrees(rows, east, north)
    try:
        to_map = Transformer.from_crs(source, road, always_xy=True)
        x, y = _transformed(to_map, east, north, network)
        there = np.isfinite(x)
        if geographic:
            geod = source.get_geod() or Geod(ellps="WGS84")
            beyond, above = _north_of(geod, east, north)
        else:
            metre = source.axis_info[0].unit_conversion_factor or 1.0
            beyond, above = east, north + STEP / metre
        x1, y1 = _transformed(to_map, beyond, above, network)
    except ProjError as e:
        raise InputError(
            rows.path, f"{rows.where}.crs {crs!r} cannot be turned into the map's ({_first(e)})"
        ) from e
    if (np.isfinite(east) & np.isfinite(north) & ~there).any() or not there.any():
        raise InputError(
            rows.path, f"{rows.where}: positions in {crs!r} have no place in the map's geoReference"
        )
    _check_near(rows, crs, x[there], y[there], network)
    return x, y, np.arctan2(y1 - y, x1 - x) - NORTH


def from_degrees(network: RoadNetwork, latitude: Floats, longitude: Floats) -> tuple[Floats, Floats]:
    """Give positions x, y (K,) [m] in the map of WGS84 degrees (K,), by its geoReference and its header's offset.

    NaN where there is none. Raises InputError where the geoReference cannot be used.
    """
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    road = map_crs(network)
    try:
        to_map = Transformer.from_crs("EPSG:4326", road, always_xy=True)
        return _transformed(to_map, longitude, latitude, network)
    except ProjError as e:
        problem = f"geoReference cannot be reached from latitude and longitude ({_first(e)})"
        raise InputError(network.path, problem) from e


def map_crs(network: RoadNetwork) -> object:
    """Give the map's coordinate system as pyproj has it. Raises InputError where its geoReference is none."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    remedy = "Give the map its <geoReference>, or the table's positions in the map's frame."
    if network.geo_reference is None:
        raise InputError(network.path, "has no geoReference, which a table with a crs needs", remedy)
    try:
        found = CRS.from_user_input(network.geo_reference)
    except CRSError as e:
        problem = f"geoReference is {network.geo_reference[:200]!r}, which pyproj does not know ({_first(e)})"
        raise InputError(network.path, problem, remedy) from e
    if found.is_compound:  # positions are in its plane; its grid of heights may not be there
        plane = found.sub_crs_list[0].to_json_dict()
        plane.pop("remarks", None)  # the whole string, which PROJ would go by
        found = CRS.from_json_dict(plane)
    if found.is_geographic:
        problem = f"geoReference is {network.geo_reference[:200]!r}, which has degrees and no metres"
        raise InputError(network.path, problem, remedy)
    return found


def _transformed(to_map: object, east: Floats, north: Floats, network: RoadNetwork) -> tuple[Floats, Floats]:
    """Map positions; NaN where there is none."""
    x, y = to_map.transform(east, north)  # type: ignore[attr-defined]
    x, y = (np.where(np.isfinite(z), z, np.nan) for z in (np.asarray(x, float), np.asarray(y, float)))
    return to_frame(x, y, *network.header.offset)


def _north_of(geod: object, lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
    """Degrees of the points STEP to the north."""
    lon, lat = np.nan_to_num(lon), np.nan_to_num(lat)
    to = geod.fwd(lon, lat, np.zeros(len(lon)), np.full(len(lon), STEP))  # type: ignore[attr-defined]
    return np.asarray(to[0], float), np.asarray(to[1], float)


def _check_degrees(rows: SourceTable, lon: Floats, lat: Floats) -> None:
    for (name, told), values, most in zip(rows.mapping.places, (lon, lat), (180.0, 90.0), strict=True):
        rows.refuse(np.abs(values) > most, name, told, f"degrees up to {most:g}")


def _check_near(rows: SourceTable, crs: str, x: Floats, y: Floats, network: RoadNetwork) -> None:
    """Refuse positions in another part of the world."""
    first = next(iter(network.roads.values())).geometries[0]
    far = float(np.median(np.hypot(x - first.x, y - first.y)))
    if far > FAR:
        east, north = (own.column or name for name, own in rows.mapping.places)
        problem = f"{rows.where}: positions in {crs!r} lie {far / 1000.0:.0f} km from the map"
        remedy = f"Is the crs another one, or are {east} and {north} swapped, or is it another map?"
        raise InputError(rows.path, problem, remedy)


def _first(error: Exception) -> str:
    return str(error).splitlines()[0][:120]
