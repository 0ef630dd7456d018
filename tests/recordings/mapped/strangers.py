"""A known drive as strangers write it: every unit, frame and reference point, by formulas of its own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from recordings.mercator import transverse_mercator

from resim.core.geometry import wrap_angle

MAP = Path(__file__).parents[3] / "networks" / "proving_ground.xodr"
LAT_0, LON_0 = 48.0, 11.0
"""Of the proving ground's geoReference, by tmerc with scale 1."""
PLACES = {"center": (0, 0), "front": (1, 0), "rear": (-1, 0), "front left": (1, 1), "front right": (1, -1),
          "rear left": (-1, 1), "rear right": (-1, -1), "rear axle": (-1, 0)}  # fmt: skip
OVERHANG = 0.9
"""m, from the rear axle to the rear."""
EPOCH = 1_714_550_400.0
"""s, 2024-05-01T08:00:00Z."""
SPEED = {
    "m/s": 1.0,
    "km/h": 3.6,
    "mph": 1.0 / 0.44704,
    "kn": 3600.0 / 1852.0,
    "ft/s": 1.0 / 0.3048,
    "cm/s": 100.0,
}
LENGTH = {"m": 1.0, "cm": 100.0, "mm": 1000.0, "km": 0.001, "ft": 1.0 / 0.3048}


def drive(bend: float = 0.01, steps: int = 40) -> pd.DataFrame:
    """EGO and two others on arcs beside each other, by time: closed formulas, SI, map frame, centres."""
    rows = []
    for k in range(steps):
        t = 0.1 * k
        for name, s0, left, v, size, kind in (
            ("ego", 0.0, 0.0, 15.0, (4.6, 1.8), "car"),
            ("7", 30.0, 3.5, 12.0, (10.0, 2.5), "truck"),
            ("8", 60.0, -3.5, 14.0, (4.2, 1.7), "car"),
        ):
            heading = 0.4 + bend * (s0 + v * t)
            radius = 1.0 / bend
            x = 900.0 + radius * (np.sin(heading) - np.sin(0.4)) - left * np.sin(heading)
            y = 120.0 - radius * (np.cos(heading) - np.cos(0.4)) + left * np.cos(heading)
            rows.append((t, name, x, y, heading, v * (1.0 - left * bend), *size, kind))
    columns = ["t", "id", "x", "y", "heading", "v", "length", "width", "kind"]
    return pd.DataFrame(rows, columns=columns)


def geographic(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Latitude and longitude [deg] of map positions: the closed formula of the projection, inverted by Newton."""
    lat, lon = LAT_0 + np.degrees(y / 6.37e6), LON_0 + np.degrees(x / 6.37e6 / np.cos(np.radians(LAT_0)))
    for _ in range(20):
        east, north = transverse_mercator(lat, lon, latitude_0=LAT_0, longitude_0=LON_0)
        lat = lat + np.degrees((y - north) / 6.37e6)
        lon = lon + np.degrees((x - east) / 6.37e6 / np.cos(np.radians(lat)))
    return lat, lon


def convergence(lat: np.ndarray, lon: np.ndarray, lon_0: float) -> np.ndarray:
    """Angle [rad] by which true north lies to the left of the grid's, of a transverse Mercator projection."""
    return np.arctan(np.tan(np.radians(lon - lon_0)) * np.sin(np.radians(lat)))


def utm32(lat: np.ndarray, lon: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Easting and northing [m] in UTM zone 32."""
    x, y = transverse_mercator(lat, lon, latitude_0=0.0, longitude_0=9.0)
    return 500_000.0 + 0.9996 * x, 0.9996 * y


@dataclass(frozen=True)
class Way:
    """How a stranger writes a drive."""

    frame: str = "map"
    reference: str = "center"
    time: str = "s"
    speed: str = "m/s"
    angle: str = "rad"
    zero: str = "x"
    clockwise: bool = False
    length: str = "m"
    mirrored: bool = False
    offset: tuple[float, float, float] | None = None
    velocity: str = "v"
    separator: str = ","
    decimal: str = "."
    parquet: bool = False


def written(folder: Path, truth: pd.DataFrame, way: Way, name: str = "table") -> tuple[Path, str]:
    """Write rows as a stranger's table; give the file, and the lines of its mapping."""
    told: dict[str, str] = {}
    out = pd.DataFrame(index=truth.index)
    along, across = PLACES[way.reference]
    ahead = along * 0.5 * truth["length"] + (OVERHANG if way.reference == "rear axle" else 0.0)
    left = across * 0.5 * truth["width"]
    h = truth["heading"].to_numpy()
    x = (truth["x"] + ahead * np.cos(h) - left * np.sin(h)).to_numpy()
    y = (truth["y"] + ahead * np.sin(h) + left * np.cos(h)).to_numpy()
    out["who"] = truth["id"]
    told["id"] = '"who"'
    out["when"], told["t"] = _times(truth["t"].to_numpy(), way)
    x_axis, north = np.zeros(len(truth)), np.full(len(truth), 0.5 * np.pi)
    head: list[str] = []
    if way.frame in ("wgs84", "utm"):
        lat, lon = geographic(x, y)
        grid = convergence(lat, lon, LON_0)
        if way.frame == "wgs84":
            out["breite"], out["laenge"] = lat, lon
            head.append('crs = "EPSG:4326"')
            told |= {"lat": '"breite"', "lon": '"laenge"'}
            north = north + grid
        else:
            out["ost"], out["nord"] = utm32(lat, lon)
            head.append('crs = "EPSG:32632"')
            told |= {"x": '"ost"', "y": '"nord"'}
            north = north + grid - convergence(lat, lon, 9.0)
        x_axis = north - 0.5 * np.pi
    elif way.frame in ("ego", "sensor"):
        own = truth[truth["id"] == "ego"].set_index("t")
        x0, y0, h0 = (truth["t"].map(own[c]).to_numpy() for c in ("x", "y", "heading"))
        head.append(f'frame = "{way.frame}"')
        if way.frame == "sensor":
            x0, y0, h0 = (
                x0 + 2.0 * np.cos(h0) - 0.3 * np.sin(h0),
                y0 + 2.0 * np.sin(h0) + 0.3 * np.cos(h0),
                h0 + 0.2,
            )
            head.append("mounting = [2.0, 0.3, 0.2]")
        p = ((x - x0) + 1j * (y - y0)) * np.exp(-1j * h0)
        x, y, x_axis = p.real, p.imag, h0
    elif way.offset is not None:
        x0, y0, turn = way.offset
        p = ((x - x0) + 1j * (y - y0)) * np.exp(-1j * turn)
        x, y, x_axis = p.real, p.imag, np.full(len(truth), turn)
        head.append(f"offset = [{x0}, {y0}, {turn}]")
    if way.frame not in ("wgs84", "utm"):
        sign = -1.0 if way.mirrored else 1.0
        out["px"], out["py"] = x * LENGTH[way.length], sign * y * LENGTH[way.length]
        told |= {c: f'{{ column = "p{c}", unit = "{way.length}" }}' for c in ("x", "y")}
        head += ["mirrored = true"] if way.mirrored else []
    angle = h - (north if way.zero == "north" else x_axis)
    angle = (-angle if way.clockwise else angle) % (2.0 * np.pi)
    out["yaw"] = angle * {"rad": 1.0, "deg": 180.0 / np.pi, "mrad": 1000.0}[way.angle]
    told["heading"] = (
        f'{{ column = "yaw", unit = "{way.angle}", zero = "{way.zero}", clockwise = {str(way.clockwise).lower()} }}'
    )
    _speeds(out, told, truth, way, x_axis, head)
    for side in ("length", "width"):
        out[side[:3]] = truth[side] * LENGTH[way.length]
        told[side] = f'{{ column = "{side[:3]}", unit = "{way.length}" }}'
    out["class"] = truth["kind"].map({"car": 1, "truck": 2})
    told["kind"] = '{ column = "class", names = { "1" = "car", "2" = "truck" } }'
    if way.reference != "center":
        head.append(f'reference = "{way.reference}"')
    if way.reference == "rear axle":
        head.append(f"rear_overhang = {OVERHANG}")
    path = folder / f"{name}.{'parquet' if way.parquet else 'csv'}"
    if way.parquet:
        _to_parquet(out, path)
    else:
        out.to_csv(path, index=False, sep=way.separator, decimal=way.decimal)
        if way.separator != ",":
            head += [f'separator = "{way.separator}"', f'decimal = "{way.decimal}"']
    return path, "\n".join([f'file = "{path.name}"', *head, *(f"{k} = {v}" for k, v in told.items())])


def _times(t: np.ndarray, way: Way) -> tuple[object, str]:
    if way.time == "frames":
        return np.round(t * 10.0).astype(int), '{ column = "when", unit = "frames", rate = 10.0 }'
    if way.time == "iso":
        stamps = pd.to_datetime(np.round((t + EPOCH) * 1e3).astype("int64"), unit="ms", utc=True)
        return stamps.strftime("%Y-%m-%dT%H:%M:%S.%fZ"), '{ column = "when", unit = "iso" }'
    if way.time == "unix":
        return np.round((t + EPOCH) * 1e3).astype("int64"), '{ column = "when", unit = "ms" }'
    factor = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[way.time]
    return t * factor, f'{{ column = "when", unit = "{way.time}" }}'


def _speeds(
    out: pd.DataFrame,
    told: dict[str, str],
    truth: pd.DataFrame,
    way: Way,
    x_axis: np.ndarray,
    head: list[str],
) -> None:
    factor = SPEED[way.speed]
    if way.velocity == "v":
        out["speed"] = truth["v"] * factor
        told["v"] = f'{{ column = "speed", unit = "{way.speed}" }}'
        return
    velocity = (truth["v"] * np.exp(1j * truth["heading"])).to_numpy()
    relative = way.velocity == "relative"
    if relative:
        own = truth[truth["id"] == "ego"].set_index("t")
        velocity = velocity - truth["t"].map(own["v"] * np.exp(1j * own["heading"])).to_numpy()
    velocity = velocity * np.exp(-1j * x_axis) * factor
    out["ve"], out["vn"] = velocity.real, -velocity.imag if "mirrored = true" in head else velocity.imag
    more = ", relative = true" if relative else ""
    told |= {c: f'{{ column = "{n}", unit = "{way.speed}"{more} }}' for c, n in (("vx", "ve"), ("vy", "vn"))}


def _to_parquet(frame: pd.DataFrame, path: Path) -> None:
    import duckdb

    with duckdb.connect() as db:
        db.register("rows", frame)
        db.execute(f"COPY rows TO '{path}' (FORMAT parquet)")


def same(found: pd.DataFrame, truth: pd.DataFrame, origin: float = 0.0) -> None:
    """The drive is given back to 1 mm and 1e-4 rad."""
    found = found.sort_values(["t", "id"]).reset_index(drop=True)
    truth = truth.sort_values(["t", "id"]).reset_index(drop=True)
    assert found["id"].tolist() == truth["id"].tolist()
    assert found["kind"].tolist() == truth["kind"].tolist()
    for column, far in {"t": 1e-6, "x": 1e-3, "y": 1e-3, "v": 1e-3, "length": 1e-6, "width": 1e-6}.items():
        np.testing.assert_allclose(found[column], truth[column], rtol=0.0, atol=far, err_msg=column)
    assert np.abs(wrap_angle(found["heading"] - truth["heading"])).max() < 1e-4
