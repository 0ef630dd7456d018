"""Logs of Argoverse 2's sensor data set: boxes in the AV's frame, laid into the city by the AV's pose."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from resim.core.errors import InputError
from resim.core.geometry import Floats
from resim.core.schema import EXISTENCE
from resim.recordings.logs.apart import read_apart
from resim.recordings.logs.raw import need
from resim.recordings.mapped.motion import REACH, speeds
from resim.recordings.tables import BIGGEST

AV = "AV"
"""What the EGO is called, as in motion forecasting."""
SIZE, AHEAD = (4.877, 2.0), 1.35
"""Length and width [m] of the AV, a Ford Fusion, as the data set's scenario mining has them. How far the box's centre
is ahead of the middle of the rear axle, where its frame is [m]: assumed, by wheelbase and overhangs of the model."""
POSE = ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
BOX = ("length_m", "width_m", "height_m")
KINDS = {
    "REGULAR_VEHICLE": "car", "LARGE_VEHICLE": "truck", "BOX_TRUCK": "truck", "TRUCK": "truck", "TRUCK_CAB": "truck",
    "VEHICULAR_TRAILER": "trailer", "MESSAGE_BOARD_TRAILER": "trailer", "TRAFFIC_LIGHT_TRAILER": "trailer",
    "BUS": "bus", "ARTICULATED_BUS": "bus", "SCHOOL_BUS": "bus", "MOTORCYCLE": "motorcycle",
    "MOTORCYCLIST": "motorcycle", "BICYCLE": "bicycle", "BICYCLIST": "bicycle", "PEDESTRIAN": "pedestrian",
    "OFFICIAL_SIGNALER": "pedestrian", "ANIMAL": "unknown", "DOG": "unknown", "RAILED_VEHICLE": "unknown",
    "STROLLER": "unknown", "WHEELCHAIR": "unknown", "WHEELED_DEVICE": "unknown", "WHEELED_RIDER": "unknown",
}  # fmt: skip
"""Kinds of categories; what does not move (bollards, cones, barrels, signs) is left out, as is EGO_VEHICLE."""
_AT = "at {} ns"
"""What the index of the AV's poses is, for errors."""
_WRITE = "Download the log again."
_TRACKER = "Give Feather with the columns of annotations: timestamp_ns, track_uuid, category, qw, tx_m, length_m, ..."


def read_log(folder: Path) -> tuple[pd.DataFrame, dict[str, str], int]:
    """Give the track table of a log in the city's frame, what was derived, and the first annotation's time [ns].

    Its times [s] count from the first annotation; the EGO is there at the times of annotations. Raises InputError.
    """
    poses = _poses(folder)
    path = folder / "annotations.feather"
    boxes = _read(path, ("timestamp_ns", "track_uuid", "category", *POSE, *BOX), _WRITE)
    first = int(boxes["timestamp_ns"].min())
    table, left = _placed(path, boxes, "track_uuid", poses, first)
    ego = _ego(poses, np.unique(boxes["timestamp_ns"]), first)
    found = pd.concat([ego, table], ignore_index=True).sort_values("t", kind="stable")
    notes = {
        "original_start": f"{first} ns",
        "ego_box": f"{SIZE[0]:g} x {SIZE[1]:g} m, its centre {AHEAD:g} m ahead of the rear axle (assumed)",
        "gt_speeds": f"of the positions over {2 * REACH:g} s",
    }
    return found, notes | ({"gt_left_out": left} if left else {}), first


def read_tracker(path: Path, folder: Path, first: int) -> tuple[pd.DataFrame, dict[str, str]]:
    """Give a tracker's boxes as a track table in the city's frame; times [s] count from `first` [ns].

    path: Feather as annotations, with track_uuid or track_id, and score where it has one; of several logs (log_id) that
    of the folder's name is read. Raises InputError.
    """
    boxes = _read(
        path,
        ("timestamp_ns", "category", *POSE, *BOX),
        _TRACKER,
        ("track_uuid", "track_id", "score", "log_id"),
    )
    if "log_id" in boxes:
        own = boxes["log_id"] == folder.absolute().name
        if not own.any():
            there = ", ".join(boxes["log_id"].unique()[:10])
            raise InputError(
                path, f"has no row with log_id {folder.absolute().name!r}; it has {there}", _TRACKER
            )
        boxes = boxes[own]
    name = next((column for column in ("track_uuid", "track_id") if column in boxes), None)
    if name is None:
        raise InputError(path, "has neither track_uuid nor track_id", "Give tracks, not detections.")
    table, left = _placed(path, boxes, name, _poses(folder), first)
    if "score" in boxes:
        table[EXISTENCE] = np.clip(boxes.loc[table.index, "score"].to_numpy(float), 0.0, 1.0)
    table = table.sort_values("t", kind="stable")
    notes = {"sd_source": path.name, "sd_speeds": f"of the positions over {2 * REACH:g} s"}
    return table, notes | ({"sd_left_out": left} if left else {})


class _Poses(NamedTuple):
    """The AV's poses in the city, by time [ns], and their file."""

    file: Path
    table: pd.DataFrame


def _poses(folder: Path) -> _Poses:
    """Read the AV's poses."""
    path = folder / "city_SE3_egovehicle.feather"
    found = _read(path, ("timestamp_ns", *POSE), _WRITE)
    return _Poses(path, found.drop_duplicates("timestamp_ns").set_index("timestamp_ns"))


def _read(path: Path, required: tuple[str, ...], remedy: str, optional: tuple[str, ...] = ()) -> pd.DataFrame:
    """The columns of a Feather file; numbers are finite, times whole."""
    if not path.is_file():
        raise InputError(path, "there is no such file", remedy)
    need(path, "pyarrow", "Feather files", "argoverse")
    child = "resim.recordings.logs.feather_child"
    found = pd.DataFrame(read_apart(path, child, (*required, *optional), what="Feather", remedy=remedy))
    lost = [name for name in required if name not in found]
    if lost:
        raise InputError(
            path, f"has no column {', '.join(lost)}; it has {', '.join(map(str, found))}", remedy
        )
    if found.empty:
        raise InputError(path, "has no row", remedy)
    found.index = pd.RangeIndex(1, len(found) + 1)
    for name in (*POSE, *BOX, "timestamp_ns", "score"):
        if name not in found:
            continue
        values = pd.to_numeric(found[name], errors="coerce")
        most = np.inf if name == "timestamp_ns" else BIGGEST
        wrong = ~(np.abs(values.to_numpy(float)) <= most) | (values <= 0.0 if name in BOX else False)
        if name == "timestamp_ns" and not pd.api.types.is_integer_dtype(values):
            raise InputError(path, "timestamp_ns is not of whole numbers", remedy)
        if wrong.any():
            row = found.index[np.asarray(wrong)][0]
            value = str(found[name][row])[:50]
            raise InputError(
                path, f"row {row}: {name} is {value}, expected a number up to {BIGGEST:g}", remedy
            )
    return found


def _placed(
    path: Path, boxes: pd.DataFrame, name: str, poses: _Poses, first: int
) -> tuple[pd.DataFrame, str]:
    """Boxes in the city as a track table, indexed as they are; and which of them were left out."""
    kind = boxes["category"].map(KINDS)
    counts = boxes[kind.isna()].groupby("category")[name].nunique()
    left = ", ".join(f"{n} {category}" for category, n in counts.items())
    boxes = boxes[kind.notna()]
    if boxes.empty:
        raise InputError(path, f"has no road user, only {left}", "Give another log.")
    unknown = ~boxes["timestamp_ns"].isin(poses.table.index)
    if unknown.any():
        row = boxes.index[unknown][0]
        problem = f"row {row}: at {boxes['timestamp_ns'][row]} ns the log has no pose of the AV"
        raise InputError(path, problem, "Give what belongs to this log, at the times of its annotations.")
    av = poses.table.loc[boxes["timestamp_ns"]]
    turn, place = _rotations(poses.file, av, _AT), av[list(POSE[4:])].to_numpy(float)
    inner, offset = _rotations(path, boxes), boxes[list(POSE[4:])].to_numpy(float)
    x, y, z = (place + np.einsum("kij,kj->ki", turn, offset)).T
    ahead = np.einsum("kij,kj->ki", turn, inner[:, :, 0])
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    t = (boxes["timestamp_ns"].to_numpy("int64") - first) / 1e9
    ids = boxes[name].astype(str)
    frame = pd.DataFrame(
        {
            "t": t, "id": ids, "x": x, "y": y, "heading": heading, "v": speeds(ids, t, x, y, heading),
            "length": boxes["length_m"], "width": boxes["width_m"], "kind": kind[boxes.index],
            "z": z - 0.5 * boxes["height_m"],
        },
        index=boxes.index,
    )  # fmt: skip
    return frame, left


def _ego(poses: _Poses, times: NDArray[np.int64], first: int) -> pd.DataFrame:
    """The AV's own track at times [ns]; the centre of its box."""
    own = poses.table.loc[poses.table.index.isin(times)].sort_index()
    turn = _rotations(poses.file, own, _AT)
    heading = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    x, y = own["tx_m"] + AHEAD * np.cos(heading), own["ty_m"] + AHEAD * np.sin(heading)
    t = (own.index.to_numpy("int64") - first) / 1e9
    ids = pd.Series(AV, index=range(len(own)))
    v = speeds(ids, t, x.to_numpy(), y.to_numpy(), heading)
    columns = {
        "t": t,
        "id": AV,
        "x": x,
        "y": y,
        "heading": heading,
        "v": v,
        "length": SIZE[0],
        "width": SIZE[1],
    }
    return pd.DataFrame(columns | {"kind": "car", "z": own["tz_m"]}).reset_index(drop=True)


def _rotations(path: Path, rows: pd.DataFrame, where: str = "row {}") -> Floats:
    """Rotation matrices (K, 3, 3) of quaternions of length 1; where: what the index of the rows is, for errors."""
    w, x, y, z = rows[list(POSE[:4])].to_numpy(float).T
    norm = np.sqrt(w * w + x * x + y * y + z * z)
    if (wrong := np.abs(norm - 1.0) > 0.01).any():
        place = where.format(rows.index[wrong][0])
        raise InputError(path, f"{place}: the quaternion has length {norm[wrong][0]:g}, expected 1", _WRITE)
    w, x, y, z = w / norm, x / norm, y / norm, z / norm
    entries = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(entries), 2, 0)
