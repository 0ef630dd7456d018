"""The Mcity trials (University of Michigan, MIT licence): RTK truth and roadside perception.

The folder of the data holds `gts/`, `dets/` and `mcity.xodr`. A trial is what one file of perception saw, and all files
of truth whose times lie in its; its name is the last number in the file's. The tracked objects are the ground truth,
the EGO is the vehicle (else pedestrian) that is tracked longest; the sensor data hold all that the roadside sensor
perceived, the EGO among it. What was found out about the data, and is applied here:

- `rotation` [rad] points backwards: heading = rotation + pi. For pedestrians it says nothing.
- `speed` is in km/h: over the matched vehicle it is 3.6 times the truth's.
- Some perceived frames stand in the file in the wrong order; their times are right.
- The truth is a point of unknown place on the vehicle; it is taken for the centre of the box.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.geometry import Floats, wrap_angle
from resim.core.tracks import Strings, Tracks
from resim.recordings.formats.registry import FORMATS, FormatOption, RecordingFormat
from resim.recordings.mapped.matching import assigned
from resim.recordings.recording import Recording, existing_map, sample_rate
from resim.road.opendrive import RoadNetwork, load

KIND = {"2": "car", "10": "pedestrian"}
LENGTH, WIDTH = 4.92, 1.86  # m, Lincoln MKZ: the data do not name the vehicle
PEDESTRIAN_SIZE = 0.5  # m
MAP = "mcity.xodr"
GATE = 3.0  # m; a perceived object farther from the truth is another one
SMOOTHED = {"car": 0.5, "pedestrian": 1.1}  # s, window of the local cubic fit to the truth
STANDING = 0.3  # m/s; slower, the truth keeps its last heading


def read_mcity(
    data: Path,
    *,
    map: Path | None = None,
    ego: str | None = None,
    start: float | None = None,
    end: float | None = None,
    trial: str | None = None,
    length: float | None = None,
    width: float | None = None,
) -> Recording:
    """Give a trial as a recording.

    Args:
        data: Folder of the data.
        map: OpenDRIVE file; default: that in the folder.
        ego: Id of the EGO in the truth; default: the vehicle that is tracked longest.
        start: First time [s] after the EGO's first sample.
        end: Last time [s] after the EGO's first sample.
        trial: Its name; needed where the folder holds more than one.
        length: Of the vehicles [m], which the data do not tell.
        width: Of the vehicles [m].

    Returns:
        The recording.

    Raises:
        InputError: The folder holds no such trial, or its files cannot be used.
    """
    for name, size in (("--length", length), ("--width", width)):
        if size is not None and not 0.0 < size < 100.0:
            raise InputError(name, f"{size:g} m is not the size of a vehicle", "Give metres above 0.")
    if trial is None:
        known = trials(data)
        if len(known) > 1:
            raise InputError(data, f"holds the trials {', '.join(known)}", "Name one with --trial.")
        trial = next(iter(known))
    road = data / MAP if map is None else map
    found = import_trial(
        trial, data, load(existing_map(road, road)), length=length or LENGTH, width=width or WIDTH, ego=ego
    )
    return found if start is None and end is None else _cut(data, found, start, end)


FORMATS.add(
    RecordingFormat(
        name="mcity",
        source="the Mcity trials",
        file="folder",
        file_help="Folder of the data, with gts/, dets/ and mcity.xodr.",
        reader=read_mcity,
        options=(
            FormatOption(
                "trial", str, "Which trial, such as 3; needed where there are several.", metavar="N"
            ),
            FormatOption("length", float, f"Length of the vehicles [m]; default: {LENGTH}.", metavar="M"),
            FormatOption("width", float, f"Width of the vehicles [m]; default: {WIDTH}.", metavar="M"),
        ),
        works_out=("map", "ego"),
    )
)


def import_trial(
    trial: str,
    data_dir: Path,
    network: RoadNetwork,
    *,
    length: float = LENGTH,
    width: float = WIDTH,
    ego: str | None = None,
) -> Recording:
    """Give one trial as a recording; time 0 is the first truth sample of the EGO within both files' times."""
    known = trials(data_dir)
    if trial not in known:
        raise InputError(data_dir, f"holds no trial {trial!r}", f"It has {', '.join(known) or 'none'}.")
    seen_file, truth_files = known[trial]
    origin = _origin(network)
    truth = _named([_read_frames(path, origin) for path in truth_files])
    seen, swapped = _in_order(_read_frames(seen_file, origin))
    ego = _ego(truth) if ego is None else ego
    if ego not in truth["id"].to_numpy():
        names = ", ".join(truth["id"].drop_duplicates())
        raise InputError(data_dir, f"trial {trial} has no object {ego!r} in its truth", f"It has {names}.")
    own = truth.loc[truth["id"] == ego, "t"]
    first, last = own[own >= seen["t"].min()].min(), min(own.max(), seen["t"].max())
    boxes = {"car": (length, width), "pedestrian": (PEDESTRIAN_SIZE, PEDESTRIAN_SIZE)}
    kinds = truth.groupby("id", sort=False)["kind"].first()
    tracks = [_truth(rows, kinds[name], boxes[kinds[name]]) for name, rows in truth.groupby("id", sort=False)]
    gt = Tracks.from_frame(pd.concat(tracks).sort_values("t", kind="stable")).window(first, last)
    sd = Tracks.from_frame(_perceived(seen)).window(first, last)
    gt, sd = (_from_zero(t, first) for t in (gt, sd))
    gt_id = assigned(gt, sd, GATE).gt_id
    return Recording(
        name=f"mcity_{trial}", map=network.path.resolve(), ego=ego, gt=gt, sd=sd, sd_gt_id=gt_id,
        gt_rate=sample_rate(truth_files[0], gt.select([ego])), sd_rate=sample_rate(seen_file, sd),
        provenance={
            "source": f"Mcity trial {trial}, University of Michigan, MIT licence: "
            + ", ".join(path.relative_to(data_dir).as_posix() for path in (*truth_files, seen_file)),
            "original_start": f"unix time {first:.6f} s",
            "projection": network.geo_reference or "",
            "ego_size": "assumed {:g} x {:g} m, the truth being its centre".format(*boxes[kinds[ego]]),
            "heading_and_speed_of_truth": f"local cubic over {SMOOTHED[kinds[ego]]} s of the positions",
            "identity": f"of the perceived, the nearest to the truth within {GATE} m, by majority per id",
            "frames_put_in_order": str(swapped),
            "outcome": _outcome(network, gt, sd, gt_id, ego),
        },
    )  # fmt: skip


def transverse_mercator(
    latitude: Floats, longitude: Floats, *, latitude_0: float, longitude_0: float
) -> tuple[Floats, Floats]:
    """Give x east, y north [m] of WGS84 degrees, scale 1 on the meridian of the origin.

    Krueger's series to the 4th order in the third flattening (Karney 2011, Eqs. 7 to 11 and 35); within a
    nanometre of PROJ near the origin.
    """
    flattening = 1.0 / 298.257223563
    n = flattening / (2.0 - flattening)
    radius = 6378137.0 / (1.0 + n) * (1.0 + n**2 / 4.0 + n**4 / 64.0)
    alpha = (
        n / 2.0 - 2.0 * n**2 / 3.0 + 5.0 * n**3 / 16.0 + 41.0 * n**4 / 180.0,
        13.0 * n**2 / 48.0 - 3.0 * n**3 / 5.0 + 557.0 * n**4 / 1440.0,
        61.0 * n**3 / 240.0 - 103.0 * n**4 / 140.0,
        49561.0 * n**4 / 161280.0,
    )
    eccentricity = 2.0 * np.sqrt(n) / (1.0 + n)

    def project(lat: Floats, dlon: Floats) -> tuple[Floats, Floats]:
        sine = np.sin(lat)
        conformal = np.sinh(np.arctanh(sine) - eccentricity * np.arctanh(eccentricity * sine))
        xi = np.arctan2(conformal, np.cos(dlon))
        eta = np.arcsinh(np.sin(dlon) / np.hypot(conformal, np.cos(dlon)))
        east = eta + sum(a * np.cos(2 * j * xi) * np.sinh(2 * j * eta) for j, a in enumerate(alpha, 1))
        north = xi + sum(a * np.sin(2 * j * xi) * np.cosh(2 * j * eta) for j, a in enumerate(alpha, 1))
        return radius * east, radius * north

    x, y = project(np.radians(latitude), np.radians(np.asarray(longitude) - longitude_0))
    return x, y - project(np.radians(latitude_0), np.zeros(()))[1]


def _cut(data: Path, whole: Recording, start: float | None, end: float | None) -> Recording:
    """The recording from start to end [s], its times from 0 on."""
    last = float(whole.gt.t[-1])
    begin, until = 0.0 if start is None else start, last if end is None else end
    if not 0.0 <= begin < until <= last + 1e-6 or whole.sd is None or whole.sd_gt_id is None:
        problem = f"lasts {last:g} s, the requested window is {begin:g} to {until:g} s"
        raise InputError(data, problem, "Choose a start and an end within it.")
    gt, sd = (_from_zero(tracks.window(begin, until), begin) for tracks in (whole.gt, whole.sd))
    names = dict(zip(whole.sd.ids.tolist(), whole.sd_gt_id.tolist(), strict=True))
    window = f"{begin:g} to {until:g} s after the original start"
    return replace(
        whole, gt=gt, sd=sd, sd_gt_id=np.array([names[i] for i in sd.ids.tolist()], dtype=str),
        provenance={**whole.provenance, "window": window},
    )  # fmt: skip


def trials(data_dir: Path) -> dict[str, tuple[Path, tuple[Path, ...]]]:
    """Give each trial's perception file and the truth files whose times lie mostly in its, by the trial's number."""
    spans = {
        path: _span(path) for folder in ("gts", "dets") for path in sorted((data_dir / folder).glob("*.json"))
    }
    found: dict[Path, list[Path]] = {}
    for truth, (begins, ends) in spans.items():
        if truth.parent.name != "gts":
            continue
        shared = {
            seen: min(ends, last) - max(begins, first)
            for seen, (first, last) in spans.items()
            if seen.parent.name == "dets"
        }
        best = max(shared, key=lambda seen: shared[seen], default=None)
        if best is not None and shared[best] > 0.5 * (ends - begins):
            found.setdefault(best, []).append(truth)
    if not found:
        raise InputError(data_dir, "holds no truth (gts/*.json) at the time of a perception (dets/*.json)")
    named = {
        (re.findall(r"\d+", seen.stem) or [seen.stem])[-1]: (seen, tuple(files))
        for seen, files in found.items()
    }
    if len(named) < len(found):
        named = {seen.stem: (seen, tuple(files)) for seen, files in found.items()}
    return dict(sorted(named.items(), key=lambda item: (len(item[0]), item[0])))


def _span(path: Path) -> tuple[float, float]:
    """First and last time [s] of a file's frames."""
    times = [float(frame["timestamp"]) for frame in _frames(path)]
    if not times:
        raise InputError(path, "holds no frames")
    return min(times), max(times)


def _named(files: list[pd.DataFrame]) -> pd.DataFrame:
    """The rows of all truth, `id` and `kind` by object: vehicle or pedestrian, with a number where there are more."""
    parts = []
    for number, rows in enumerate(files):
        again = rows.groupby(["t", "id"]).cumcount()  # two in one frame under one id
        kind = rows["classType"].map(KIND).fillna("car")
        parts.append(
            rows.assign(kind=kind, id=[f"{number}/{i}/{n}" for i, n in zip(rows["id"], again, strict=True)])
        )
    rows = pd.concat(parts, ignore_index=True)
    names: dict[str, str] = {}
    for of, word in (("car", "vehicle"), ("pedestrian", "pedestrian")):
        own = rows.loc[rows["kind"] == of, "id"].drop_duplicates().tolist()
        names |= {name: word if len(own) == 1 else f"{word}_{k}" for k, name in enumerate(own, start=1)}
    return rows.assign(id=rows["id"].map(names))


def _ego(truth: pd.DataFrame) -> str:
    """The vehicle, else the pedestrian, that is there longest, the first of equals."""
    lasts = truth.groupby(["kind", "id"], sort=False)["t"].agg(np.ptp).reset_index()
    lasts = lasts.sort_values(["kind", "t"], ascending=[True, False], kind="stable")
    return str(lasts["id"].iloc[0])


def _origin(network: RoadNetwork) -> tuple[float, float]:
    """Latitude and longitude [deg] of the map's origin, of its geoReference."""
    text = network.geo_reference or ""
    found = [re.search(rf"\+{name}=(-?[\d.]+)", text) for name in ("lat_0", "lon_0")]
    if "+proj=tmerc" not in text or found[0] is None or found[1] is None:
        raise InputError(network.path, f"geoReference is {text!r}, expected +proj=tmerc +lat_0 +lon_0")
    return float(found[0][1]), float(found[1][1])


def _frames(path: Path) -> list[dict[str, Any]]:
    try:
        frames: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
        if not all(isinstance(f["timestamp"], (int, float)) and isinstance(f["objs"], list) for f in frames):
            raise TypeError("timestamp is no number, or objs no list")
    except OSError as e:
        raise InputError(path, f"cannot be read ({e.strerror})", "Name the folder of the Mcity data.") from e
    except (ValueError, KeyError, TypeError) as e:
        raise InputError(path, f"is not a list of frames with timestamp and objs ({e!r})") from e
    return frames


def _read_frames(path: Path, origin: tuple[float, float]) -> pd.DataFrame:
    """One row per frame and object, in the order of the file: t [s, unix], x, y [m], and the file's fields."""
    frames = _frames(path)
    try:
        rows = pd.DataFrame([o | {"t": f["timestamp"]} for f in frames for o in f["objs"]])
        latitude, longitude = rows["lat"].to_numpy(float), rows["lon"].to_numpy(float)
    except (ValueError, KeyError, TypeError) as e:
        raise InputError(path, f"is not a list of frames with timestamp and objs ({e!r})") from e
    rows["x"], rows["y"] = transverse_mercator(
        latitude, longitude, latitude_0=origin[0], longitude_0=origin[1]
    )
    rows["id"], rows["classType"] = rows["id"].astype(str), rows["classType"].astype(str)
    return rows


def _in_order(rows: pd.DataFrame) -> tuple[pd.DataFrame, int]:
    """The rows by time, and how many frames stood before an earlier one."""
    return rows.sort_values("t", kind="stable"), int((rows["t"].diff() < 0.0).sum())


def _truth(rows: pd.DataFrame, kind: str, box: tuple[float, float]) -> pd.DataFrame:
    """The track table of one object's truth: positions as measured, heading and speed of a zero-phase local fit."""
    from scipy.signal import savgol_filter  # it takes a second to load, and every run loads the formats

    samples = round(SMOOTHED[kind] / float(rows["t"].diff().median())) // 2 * 2 + 1

    def rate(values: pd.Series) -> Floats:
        smoothed: Floats = savgol_filter(values - values.iloc[0], samples, 3, deriv=1)
        return smoothed

    step = rate(rows["t"])
    vx, vy = rate(rows["x"]) / step, rate(rows["y"]) / step
    v = np.hypot(vx, vy)
    heading = pd.Series(np.where(v > STANDING, np.arctan2(vy, vx), np.nan)).ffill().bfill()
    return rows[["t", "id", "x", "y"]].assign(
        heading=heading.to_numpy(), v=v, length=box[0], width=box[1], kind=kind
    )


def _perceived(rows: pd.DataFrame) -> pd.DataFrame:
    """The track table of the perceived; an id's size is the median of its samples, its class its commonest."""
    out = rows[["t", "id", "x", "y"]].assign(
        heading=wrap_angle(rows["rotation"].astype(float) + np.pi), v=rows["speed"].astype(float) / 3.6
    )
    by_id = rows.groupby("id")
    for size in ("length", "width"):
        out[size] = rows["id"].map(rows[size].astype(float).groupby(rows["id"]).median())
    commonest = by_id["classType"].agg(lambda c: c.mode().iloc[0])
    return out.assign(kind=rows["id"].map(commonest.map(KIND).fillna("unknown")))


def _from_zero(tracks: Tracks, first: float) -> Tracks:
    frame = tracks.to_frame()
    return Tracks.from_frame(frame.assign(t=np.round(frame["t"] - first, 6)))


def _outcome(network: RoadNetwork, gt: Tracks, sd: Tracks, gt_id: Strings, ego: str) -> str:
    """What the trial holds, how far the perceived EGO is off, and how much of the drive is beyond the lanes."""
    matched = gt_id == ego
    gt = gt.select([ego])
    truth = gt.at(sd.t)
    error = np.hypot(sd.x - truth.x, sd.y - truth.y)[matched]
    error = error[np.isfinite(error)]
    off = int((~network.to_road(gt.x[gt.valid], gt.y[gt.valid], heading=gt.heading[gt.valid]).on_road).sum())
    return (
        f"{gt.t[-1]:.1f} s, {int(gt.valid.sum())} truth samples, {off} of them on no driving lane; "
        f"{len(sd)} perceived ids, {int(matched.sum())} of the EGO with {len(error)} samples, "
        f"median error {np.median(error):.2f} m"
    )
