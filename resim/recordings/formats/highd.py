"""The highD family of drone data: highD, and inD, rounD and exiD, whose columns differ.

A recording `XX` is three files, `XX_tracks.csv`, `XX_tracksMeta.csv` and `XX_recordingMeta.csv`.

- highD (Krajewski et al. 2018): `x`, `y` are the upper left corner of the box, y down as in the image;
  `width` is the vehicle's length, `height` its width; no heading, vehicles drive along x.
- inD, rounD, exiD: `xCenter`, `yCenter`, y up, `heading` in degrees anticlockwise; pedestrians and some
  bicycles have a size of 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.geometry import from_frame, wrap_angle
from resim.core.tracks import Tracks
from resim.recordings.formats.registry import FORMATS, FormatOption, RecordingFormat
from resim.recordings.present import existing_map
from resim.recordings.recording import Recording
from resim.recordings.tables import BIGGEST, check_tracks, read_table
from resim.recordings.window import cut_window

MOTION = ("xVelocity", "yVelocity", "xAcceleration", "yAcceleration")
HIGHD_TRACKS = ("frame", "id", "x", "y", "width", "height", *MOTION)
HIGHD_META = ("id", "class", "drivingDirection")
CENTRE_TRACKS = ("frame", "trackId", "xCenter", "yCenter", "heading", "width", "length", *MOTION)
TEXT = ("id", "trackId", "class")

KIND = {
    "car": "car", "truck": "truck", "truck_bus": "truck", "van": "van", "bus": "bus", "trailer": "trailer",
    "motorcycle": "motorcycle", "bicycle": "bicycle", "pedestrian": "pedestrian",
}  # fmt: skip
# length, width [m] of what the data give no box for
ASSUMED_SIZE = {"pedestrian": (0.5, 0.5), "bicycle": (1.8, 0.6), "motorcycle": (2.2, 0.8)}
FASTEST, SLOWEST = 1e4, 1e-3
"""Frames a second [Hz] at most and at least; the data have 25."""
_STANDING = 0.5  # m/s; slower, the direction of the velocity says nothing


@dataclass(frozen=True)
class Alignment:
    """Where the origin (x, y) [m] and the x axis (rotation [rad]) of the data's frame lie in the map."""

    x: float = 0.0
    y: float = 0.0
    rotation: float = 0.0


def read_highd(
    tracks_csv: Path,
    *,
    map: Path,
    ego: str,
    start: float | None = None,
    end: float | None = None,
    alignment: Alignment | None = None,
) -> Recording:
    """Give what happened around the vehicle `ego` of a highD, inD, rounD or exiD recording as ground truth.

    start, end [s] count from the file's first frame; without them the window is the EGO's own. The data's
    frame (highD's with y turned up) is laid into the map by `alignment`. Raises InputError.
    """
    stem = _stem(tracks_csv)
    frame_rate = _frame_rate(tracks_csv.with_name(f"{stem}_recordingMeta.csv"))
    frame = _read_tracks(tracks_csv, tracks_csv.with_name(f"{stem}_tracksMeta.csv"), frame_rate)
    frame, window = cut_window(frame, tracks_csv, ego=ego, start=start, end=end)
    frame, assumed = _with_sizes(frame)
    place = alignment or Alignment()
    x, y = from_frame(frame["x"], frame["y"], place.x, place.y, place.rotation)
    frame = frame.assign(x=x, y=y, heading=wrap_angle(frame["heading"] + place.rotation))
    check_tracks(tracks_csv, frame)
    provenance = {"source": tracks_csv.name, "format": "highD family", **window}
    if alignment is not None:
        provenance["alignment"] = f"x {place.x!r} m, y {place.y!r} m, rotation {place.rotation!r} rad"
    if assumed:
        provenance["assumed_sizes"] = assumed
    return Recording(
        name=f"{stem}_{ego}", map=existing_map(map, map), ego=ego,
        gt=Tracks.from_frame(frame), gt_rate=frame_rate, provenance=provenance,
    )  # fmt: skip


def _read(
    tracks_csv: Path, *, alignment: tuple[float, float, float] | None = None, **window: Any
) -> Recording:
    """`read_highd` as the command calls it."""
    if alignment and not all(abs(value) <= BIGGEST for value in alignment):
        raise InputError(
            "--alignment", f"is {alignment}, expected finite numbers", "Give x [m], y [m] and rotation [rad]."
        )
    return read_highd(tracks_csv, alignment=Alignment(*alignment) if alignment else None, **window)


FORMATS.add(
    RecordingFormat(
        name="highd",
        source="CSV of the highD family (highD, exiD, inD, rounD)",
        file="tracks",
        file_help="XX_tracks.csv of highD, exiD, inD or rounD; its meta files beside it.",
        reader=_read,
        patterns=("*_tracks.csv",),
        options=(
            FormatOption(
                "alignment",
                tuple[float, float, float],
                "Pose of the data's frame in the map [m m rad], if the frames differ.",
                metavar="X Y HEADING",
            ),
        ),
    )
)


def _stem(tracks_csv: Path) -> str:
    if not tracks_csv.name.endswith("_tracks.csv"):
        raise InputError(tracks_csv, "is not named XX_tracks.csv", "Name the tracks file of a recording.")
    return tracks_csv.name.removesuffix("_tracks.csv")


def _frame_rate(path: Path) -> float:
    """Frames a second [Hz]."""
    rate = float(read_table(path, required=("frameRate",), text=TEXT)["frameRate"].iloc[0])
    if not SLOWEST <= rate <= FASTEST:
        raise InputError(path, f"frameRate is {rate:g}, expected {SLOWEST:g} to {FASTEST:g} Hz")
    return rate


def _read_tracks(path: Path, meta_path: Path, frame_rate: float) -> pd.DataFrame:
    """The track table in the data's frame, y up, by time; t counts from the first frame, `a` goes along."""
    meta = read_table(meta_path, required=("class",), optional=("trackId",), text=TEXT)
    if "trackId" in meta:
        raw = _centred(read_table(path, required=CENTRE_TRACKS, text=TEXT))
        meta = meta.set_index("trackId")
    else:
        meta = read_table(meta_path, required=HIGHD_META, text=TEXT).set_index("id")
        raw = _from_corners(read_table(path, required=HIGHD_TRACKS, text=TEXT))
    if len(torn := raw.loc[raw["frame"] % 1.0 != 0.0, "frame"]):
        raise InputError(path, f"row {torn.index[0]}: frame is {torn.iloc[0]:g}, expected a whole number")
    if not meta.index.is_unique:
        raise InputError(meta_path, f"vehicle {meta.index[meta.index.duplicated()][0]!r} is a duplicate")
    if len(unknown := raw.loc[~raw["id"].isin(meta.index), "id"]):
        raise InputError(meta_path, f"has no row for vehicle {unknown.iloc[0]!r}, which is in {path.name}")
    raw["kind"] = raw["id"].map(meta["class"].str.lower().map(KIND).fillna("unknown"))
    raw["t"] = (raw["frame"] - raw["frame"].min()) / frame_rate
    if "heading" not in raw:
        raw["heading"] = _course(raw, raw["id"].map(meta["drivingDirection"]))
    along_x, along_y = np.cos(raw["heading"]), np.sin(raw["heading"])
    raw["v"] = raw["vx"] * along_x + raw["vy"] * along_y
    raw["a"] = raw["ax"] * along_x + raw["ay"] * along_y
    return raw.sort_values("t", kind="stable")


def _centred(raw: pd.DataFrame) -> pd.DataFrame:
    raw = raw.assign(heading=wrap_angle(np.radians(raw["heading"])))
    names = {"trackId": "id", "xCenter": "x", "yCenter": "y"}
    return raw.rename(columns=names | dict(zip(MOTION, ("vx", "vy", "ax", "ay"), strict=True)))


def _from_corners(raw: pd.DataFrame) -> pd.DataFrame:
    """highD's boxes by their centre, with y turned up."""
    return pd.DataFrame(
        {
            "frame": raw["frame"], "id": raw["id"], "length": raw["width"], "width": raw["height"],
            "x": raw["x"] + 0.5 * raw["width"], "y": -(raw["y"] + 0.5 * raw["height"]),
            "vx": raw["xVelocity"], "vy": -raw["yVelocity"],
            "ax": raw["xAcceleration"], "ay": -raw["yAcceleration"],
        }
    )  # fmt: skip


def _course(raw: pd.DataFrame, driving_direction: pd.Series) -> pd.Series:
    """The direction of the velocity [rad]; a standing vehicle keeps its last one.

    One that has not moved yet takes its first, one that never moves highD's driving direction (1: to -x).
    """
    known = np.hypot(raw["vx"], raw["vy"]) > _STANDING
    course = pd.Series(np.where(known, np.arctan2(raw["vy"], raw["vx"]), np.nan), index=raw.index)
    ordered = course.iloc[np.lexsort((raw["frame"], raw["id"]))]
    by_vehicle = raw["id"].loc[ordered.index]
    held: pd.Series = ordered.groupby(by_vehicle).ffill().groupby(by_vehicle).bfill()
    facing = pd.Series(np.where(driving_direction == 1.0, np.pi, 0.0), index=raw.index)
    return held.reindex(raw.index).fillna(facing)


def _with_sizes(frame: pd.DataFrame) -> tuple[pd.DataFrame, str]:
    """Put assumed sizes where the data give a box of 0, and say for which objects."""
    without = (frame["length"] <= 0.0) | (frame["width"] <= 0.0)
    notes = []
    for kind, (length, width) in ASSUMED_SIZE.items():
        rows = without & (frame["kind"] == kind)
        frame = frame.assign(
            length=frame["length"].mask(rows, length), width=frame["width"].mask(rows, width)
        )
        if rows.any():
            ids = ", ".join(frame.loc[rows, "id"].drop_duplicates())
            notes.append(f"{kind} {length} x {width} m: {ids}")
    return frame, "; ".join(notes)
