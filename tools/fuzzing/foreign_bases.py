"""Whole recordings in formats of others, a second of the corner case each, for `foreign` to damage."""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from fuzzing.inputs import GROUND, ROOT
from resim.core.tracks import Tracks
from resim.exports import mcap, osi, rosbag
from resim.jobs.export import export_openscenario, recorded_drive
from resim.recordings import Recording, read_recording
from resim.recordings.formats.highd_writer import write_highd
from resim.road.opendrive import load

STEPS, RATE = 26, 25.0
FIELDS = ("x", "y", "heading", "v", "length", "width")
COLUMNS = "".join(f'{name} = "{name}"\n' for name in ("id", "t", *FIELDS, "kind"))
TABLE = f'ego = "ego"\n[gt]\n{COLUMNS}'
SCENES = """ego = "ego"
[gt]
topic = "scene"
list = "boxes"
id = "name"
t = { column = "stamp", unit = "ns" }
x = "place.x"
y = "place.y"
heading = "yaw"
v = "speed"
length = "size.0"
width = "size.1"
"""


def _short(tracks: Tracks) -> Tracks:
    two = {
        name: value[:, :STEPS] for name, value in vars(tracks).items()
        if isinstance(value, np.ndarray) and value.ndim == 2
    }  # fmt: skip
    return replace(tracks, t=tracks.t[:STEPS], **two)


@cache
def _recording() -> Recording:
    whole = read_recording(ROOT / "scenarios" / "cut_in_brake")
    assert whole.sd is not None
    return replace(whole, gt=_short(whole.gt), sd=_short(whole.sd), plan=None)


@cache
def _rows() -> pd.DataFrame:
    gt = _recording().gt
    n, k = np.nonzero(gt.valid)
    columns = {name: getattr(gt, name)[n, k] for name in ("x", "y", "heading", "v")}
    frame = pd.DataFrame(
        {"t": gt.t[k], "id": gt.ids[n], **columns, "length": gt.length[n], "width": gt.width[n]}
    )
    return frame.assign(kind=gt.kind[n]).sort_values(["t", "id"]).reset_index(drop=True)


def _csv(frame: pd.DataFrame) -> bytes:
    return frame.to_csv(index=False).encode()


@cache
def base(kind: str) -> dict[str, bytes]:
    """Give the files of a whole recording of this kind."""
    if kind in ("osi", "osi_mcap", "bag"):
        module = {"osi": osi, "osi_mcap": mcap, "bag": rosbag}[kind]
        with tempfile.TemporaryDirectory() as folder:
            module.write(recorded_drive(_recording(), load(GROUND)), Path(folder))
            return _files(Path(folder))
    if kind == "openscenario":
        with tempfile.TemporaryDirectory() as folder:
            export_openscenario(ROOT / "scenarios" / "rear_end", Path(folder) / "out", style="trajectory")
            return {"GT.xosc": (Path(folder) / "out" / "GT.xosc").read_bytes()}
    if kind == "mcity":
        return _mcity()
    if kind == "log":
        return _log()
    return {"commonroad": _commonroad, "highd": _highd, "ind": _ind, "forecast": _forecast, "scenes": _scenes,
            "mdf": _mdf, "table": lambda: {"a.csv": _csv(_rows()), "mapping.toml": TABLE.encode()}}[kind]()  # fmt: skip


def _files(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


def _commonroad() -> dict[str, bytes]:
    def exact(tag: str, value: object) -> str:
        return f"<{tag}><exact>{value}</exact></{tag}>"

    said = []
    for number, (_, rows) in enumerate(
        sorted(_rows().groupby("id"), key=lambda one: one[0] != "ego"), start=1
    ):
        states = [
            f"<{{0}}><position><point><x>{r.x}</x><y>{r.y}</y></point></position>{exact('orientation', r.heading)}"
            f"{exact('time', k)}<velocity><intervalStart>{r.v}</intervalStart><intervalEnd>{r.v}</intervalEnd>"
            f"</velocity>{exact('acceleration', 0)}</{{0}}>"
            for k, r in enumerate(rows.itertuples())
        ]
        first, *rest = states
        shape = "<rectangle><length>4.5</length><width>1.8</width></rectangle>"
        said.append(
            f'<dynamicObstacle id="{number}"><type>car</type><shape>{shape}</shape>{first.format("initialState")}'
            f"<trajectory>{''.join(one.format('state') for one in rest)}</trajectory></dynamicObstacle>"
        )
    still = (
        '<staticObstacle id="9"><type>parkedVehicle</type><shape><circle><radius>1</radius></circle></shape>'
        f"<initialState><position><circle><radius>1</radius><center><x>9</x><y>9</y></center></circle></position>"
        f"{exact('orientation', 0)}{exact('time', 0)}</initialState></staticObstacle>"
    )
    head = '<commonRoad commonRoadVersion="2020a" timeStepSize="0.04" benchmarkID="S" author="a" source="s">'
    return {"a.xml": f"{head}{''.join(said)}{still}</commonRoad>".encode()}


def _numbered() -> Tracks:
    gt = _recording().gt
    return replace(gt, ids=np.where(gt.ids == "ego", "1", "2").astype(str))


def _ind() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        write_highd(_numbered(), Path(folder), 1, RATE)
        return _files(Path(folder))


def _highd() -> dict[str, bytes]:
    """The columns of highD itself: corners of boxes, y down."""
    rows = _rows()
    rows["frame"] = np.round(rows["t"] * RATE).astype(int) + 1
    rows["number"] = np.where(rows["id"] == "ego", 1, 2)
    tracks = pd.DataFrame({
        "frame": rows["frame"], "id": rows["number"], "x": rows["x"] - 0.5 * rows["length"],
        "y": -rows["y"] - 0.5 * rows["width"], "width": rows["length"], "height": rows["width"],
        "xVelocity": rows["v"], "yVelocity": 0.0, "xAcceleration": 0.0, "yAcceleration": 0.0,
    })  # fmt: skip
    meta = pd.DataFrame({"id": [1, 2], "class": ["Car", "Truck"], "drivingDirection": [2, 2]})
    return {
        "01_tracks.csv": _csv(tracks), "01_tracksMeta.csv": _csv(meta),
        "01_recordingMeta.csv": _csv(pd.DataFrame({"id": [1], "frameRate": [25]})),
    }  # fmt: skip


def _mcity() -> dict[str, bytes]:
    def frames(id: object) -> bytes:
        own = {
            "id": id,
            "classType": "2",
            "rotation": "3.14",
            "speed": "20.0",
            "length": "4.7",
            "width": "1.9",
        }
        told = [
            {"timestamp": 1.7e9 + 0.1 * k, "objs": [own | {"lat": 48.0, "lon": 11.004 + 2.7e-5 * k}]}
            for k in range(14)
        ]
        return json.dumps(told).encode()

    return {"gts/t1.json": frames(0), "dets/d1.json": frames("7139")}


def _forecast() -> dict[str, bytes]:
    rows = _rows()
    v = rows["v"].to_numpy() * np.exp(1j * rows["heading"].to_numpy())
    table = pd.DataFrame({
        "track_id": np.where(rows["id"] == "ego", "AV", rows["id"]), "object_type": "vehicle",
        "timestep": np.round(rows["t"] * RATE).astype(int), "position_x": rows["x"], "position_y": rows["y"],
        "heading": rows["heading"], "velocity_x": v.real, "velocity_y": v.imag,
        "start_timestamp": 3.15966253660357e17, "end_timestamp": 3.15966256160357e17, "num_timestamps": STEPS,
    })  # fmt: skip
    return {"scenario_a.parquet": _csv(table)}


def _log() -> dict[str, bytes]:
    """Poses, annotations and a tracker's boxes, as CSV that `foreign.feather` writes as Feather."""
    rows, first = _rows(), 315_966_253_660_357_000
    stamps = first + np.round(rows["t"] * 1e9).astype("int64")
    own = (rows["id"] == "ego").to_numpy()
    still = {"qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}
    poses = pd.DataFrame({
        "timestamp_ns": stamps[own], **still, "tx_m": rows["x"][own], "ty_m": rows["y"][own], "tz_m": 60.0
    })  # fmt: skip
    boxes = pd.DataFrame({
        "timestamp_ns": stamps[~own], "track_uuid": "u-" + rows["id"][~own], "category": "REGULAR_VEHICLE",
        "length_m": 4.5, "width_m": 1.8, "height_m": 1.5, **still, "tx_m": 30.0, "ty_m": 3.5, "tz_m": 0.9,
    })  # fmt: skip
    return {
        "annotations.feather": _csv(boxes), "city_SE3_egovehicle.feather": _csv(poses),
        "tracker.feather": _csv(boxes.assign(score=0.9)),
    }  # fmt: skip


def _scenes() -> dict[str, bytes]:
    lines = []
    for t, rows in _rows().groupby("t"):
        stamp = {"seconds": 1_714_550_400 + int(t), "nanos": round(t % 1.0 * 1e9)}
        boxes = [
            {
                "name": r.id,
                "place": {"x": r.x, "y": r.y},
                "yaw": r.heading,
                "speed": r.v,
                "size": [r.length, r.width],
            }
            for r in rows.itertuples()
        ]
        lines.append(json.dumps({"stamp": stamp, "boxes": boxes}))
    return {"a.mcap": "\n".join(lines).encode(), "mapping.toml": SCENES.encode()}


def _mdf() -> dict[str, bytes]:
    """A CSV that `foreign.mdf` writes as MDF, a group for each object."""
    table = "".join(
        f'[[gt]]\ntopic = "{name}"\nid = {{ value = "{name}" }}\nt = {{ column = "log_time", unit = "ns" }}\n'
        + "".join(f'{field} = "{field}"\n' for field in FIELDS)
        for name in ("ego", "1")
    )
    return {"a.mf4": _csv(_rows().drop(columns="kind")), "mapping.toml": f'ego = "ego"\n{table}'.encode()}
