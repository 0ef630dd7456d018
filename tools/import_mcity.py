"""Make recordings of the Mcity trials (University of Michigan, MIT licence): RTK truth and roadside perception.

    python tools/import_mcity.py DATA_DIR OUT_DIR

DATA_DIR holds `gts/`, `dets/` and `mcity.xodr`. Each trial becomes the folder OUT_DIR/mcity_N. The tracked
vehicle (trial 11: pedestrian) is the EGO and the only ground truth; the sensor data hold all that the
roadside sensor perceived, the EGO among it. What was found out about the data, and is applied here:

- `rotation` [rad] points backwards: heading = rotation + pi. For pedestrians it says nothing.
- `speed` is in km/h: over the matched vehicle it is 3.6 times the truth's.
- Some perceived frames stand in the file in the wrong order; their times are right.
- The truth is a point of unknown place on the vehicle; it is taken for the centre of the box.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.signal import savgol_filter

from resim.core.errors import InputError, ResimError
from resim.core.geometry import Floats, wrap_angle
from resim.core.tracks import Strings, Tracks
from resim.ingest import Recording, write_recording
from resim.ingest.recording import sample_rate
from resim.road.opendrive import RoadNetwork, load

TRIALS = {  # truth, perception, EGO
    "3": ("gts/gps_data_3.json", "dets/detection_3.json", "vehicle"),
    "4": ("gts/gps_data_4.json", "dets/detection_4.json", "vehicle"),
    "5": ("gts/gps_data_5.json", "dets/detection_5.json", "vehicle"),
    "11": ("gts/ped_gps_data_ped_11.json", "dets/detection_ped_11.json", "pedestrian"),
}
KIND = {"2": "car", "10": "pedestrian"}
LENGTH, WIDTH = 4.92, 1.86  # m, Lincoln MKZ: the data do not name the vehicle
PEDESTRIAN_SIZE = 0.5  # m
GATE = 3.0  # m; a perceived object farther from the truth is another one
SMOOTHED = {"vehicle": 0.5, "pedestrian": 1.1}  # s, window of the local cubic fit to the truth
STANDING = 0.3  # m/s; slower, the truth keeps its last heading


def main() -> int:
    """Import every trial; 0 when done, 2 where an input cannot be used."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data_dir", type=Path)
    parser.add_argument("out_dir", type=Path)
    parser.add_argument("--length", type=float, default=LENGTH, help=f"of the vehicle [m], else {LENGTH}")
    parser.add_argument("--width", type=float, default=WIDTH, help=f"of the vehicle [m], else {WIDTH}")
    args = parser.parse_args()
    try:
        network = load(args.data_dir / "mcity.xodr")
        for trial in TRIALS:
            recording = import_trial(trial, args.data_dir, network, length=args.length, width=args.width)
            write_recording(recording, args.out_dir / recording.name)
            print(f"{recording.name}: {recording.provenance['outcome']}")
    except ResimError as e:
        print(e, file=sys.stderr)
        return 2
    return 0


def import_trial(
    trial: str, data_dir: Path, network: RoadNetwork, *, length: float = LENGTH, width: float = WIDTH
) -> Recording:
    """Give one trial as a recording; time 0 is the first truth sample within both files' times."""
    truth_file, seen_file, ego = TRIALS[trial]
    origin = _origin(network)
    truth = _read_frames(data_dir / truth_file, origin)
    seen, swapped = _in_order(_read_frames(data_dir / seen_file, origin))
    first = truth.loc[truth["t"] >= seen["t"].min(), "t"].min()
    last = min(truth["t"].max(), seen["t"].max())
    box = (length, width) if ego == "vehicle" else (PEDESTRIAN_SIZE, PEDESTRIAN_SIZE)
    gt = Tracks.from_frame(_truth(truth, ego, box)).window(first, last)
    sd = Tracks.from_frame(_perceived(seen)).window(first, last)
    gt, sd = (_from_zero(t, first) for t in (gt, sd))
    gt_id = match(gt, sd)
    return Recording(
        name=f"mcity_{trial}", map=network.path.resolve(), ego=ego, gt=gt, sd=sd, sd_gt_id=gt_id,
        gt_rate=sample_rate(data_dir / truth_file, gt), sd_rate=sample_rate(data_dir / seen_file, sd),
        provenance={
            "source": f"Mcity trial {trial}, University of Michigan, MIT licence: {truth_file}, {seen_file}",
            "original_start": f"unix time {first:.6f} s",
            "projection": network.geo_reference or "",
            "ego_size": f"assumed {box[0]:g} x {box[1]:g} m, the truth being its centre",
            "heading_and_speed_of_truth": f"local cubic over {SMOOTHED[ego]} s of the positions",
            "identity": f"of the perceived, the nearest to the truth within {GATE} m, by majority per id",
            "frames_put_in_order": str(swapped),
            "outcome": _outcome(network, gt, sd, gt_id),
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


def match(gt: Tracks, sd: Tracks) -> Strings:
    """Give the GT id (N_sd,) of each perceived object, "" for all but those that are the one truth object.

    At each time the nearest perceived object within GATE is taken for it; an id that is so in more than half
    of its samples gets the identity.
    """
    truth = gt.at(sd.t)
    distance = np.hypot(sd.x - truth.x, sd.y - truth.y)
    distance = np.where(np.isfinite(distance), distance, np.inf)
    nearest, taken = distance.argmin(axis=0), distance.min(axis=0) <= GATE
    wins = np.bincount(nearest[taken], minlength=len(sd))
    return np.where(wins > 0.5 * (sd.valid & truth.valid).sum(axis=1), gt.ids[0], "")


def _origin(network: RoadNetwork) -> tuple[float, float]:
    """Latitude and longitude [deg] of the map's origin, of its geoReference."""
    text = network.geo_reference or ""
    found = [re.search(rf"\+{name}=(-?[\d.]+)", text) for name in ("lat_0", "lon_0")]
    if "+proj=tmerc" not in text or found[0] is None or found[1] is None:
        raise InputError(network.path, f"geoReference is {text!r}, expected +proj=tmerc +lat_0 +lon_0")
    return float(found[0][1]), float(found[1][1])


def _read_frames(path: Path, origin: tuple[float, float]) -> pd.DataFrame:
    """One row per frame and object, in the order of the file: t [s, unix], x, y [m], and the file's fields."""
    try:
        frames: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
        rows = pd.DataFrame([o | {"t": f["timestamp"]} for f in frames for o in f["objs"]])
        latitude, longitude = rows["lat"].to_numpy(float), rows["lon"].to_numpy(float)
    except OSError as e:
        raise InputError(path, f"cannot be read ({e.strerror})", "Name the folder of the Mcity data.") from e
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


def _truth(rows: pd.DataFrame, ego: str, box: tuple[float, float]) -> pd.DataFrame:
    """The track table of the truth: positions as measured, heading and speed of a zero-phase local fit."""
    samples = round(SMOOTHED[ego] / float(rows["t"].diff().median())) // 2 * 2 + 1

    def rate(values: pd.Series) -> Floats:
        smoothed: Floats = savgol_filter(values - values.iloc[0], samples, 3, deriv=1)
        return smoothed

    step = rate(rows["t"])
    vx, vy = rate(rows["x"]) / step, rate(rows["y"]) / step
    v = np.hypot(vx, vy)
    heading = pd.Series(np.where(v > STANDING, np.arctan2(vy, vx), np.nan)).ffill().bfill()
    kind = "car" if ego == "vehicle" else "pedestrian"
    return rows[["t", "x", "y"]].assign(
        id=ego, heading=heading.to_numpy(), v=v, length=box[0], width=box[1], kind=kind
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


def _outcome(network: RoadNetwork, gt: Tracks, sd: Tracks, gt_id: Strings) -> str:
    """What the trial holds, how far the perceived EGO is off, and how much of the drive is beyond the lanes."""
    matched = gt_id != ""
    truth = gt.at(sd.t)
    error = np.hypot(sd.x - truth.x, sd.y - truth.y)[matched]
    error = error[np.isfinite(error)]
    off = int((~network.to_road(gt.x[0], gt.y[0], heading=gt.heading[0]).on_road).sum())
    return (
        f"{gt.t[-1]:.1f} s, {len(gt.t)} truth samples, {off} of them on no driving lane; {len(sd)} perceived ids, "
        f"{int(matched.sum())} of the EGO with {len(error)} samples, median error {np.median(error):.2f} m"
    )


if __name__ == "__main__":
    sys.exit(main())
