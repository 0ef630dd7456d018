"""The Mcity trials (University of Michigan, MIT licence): RTK truth and roadside perception.

The folder of the data holds `gts/`, `dets/` and `mcity.xodr`. A trial is what one file of perception saw, and all files
of truth that share time with it, or with one of these; its name is the last number in the file's. The tracked objects
are the ground truth, the EGO is the vehicle (else pedestrian) that is tracked longest; the sensor data hold all that
the roadside sensor perceived, the EGO among it. What was found out about the data, and is applied here:

- `rotation` [rad] points backwards: heading = rotation + pi. For pedestrians it says nothing.
- `speed` is in km/h: over the matched vehicle it is 3.6 times the truth's.
- Some perceived frames stand in the file in the wrong order; their times are right.
- The truth is a point of unknown place on the vehicle; it is taken for the centre of the box.

Nothing is cut but by start and end: rows before the EGO's first sample, and after its last, show that the drive lasted
longer than its truth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.clock import TICK
from resim.core.errors import InputError
from resim.core.geometry import Floats, wrap_angle
from resim.core.schema import GT_ID
from resim.core.tracks import Tracks
from resim.recordings.formats.mcity_frames import MOTION, PLACE, SIZE, read_objects, trials
from resim.recordings.formats.registry import FORMATS, FormatOption, RecordingFormat
from resim.recordings.mapped.frames import from_degrees
from resim.recordings.mapped.matching import assigned
from resim.recordings.present import existing_map
from resim.recordings.recording import sample_rate
from resim.recordings.settings import Settings
from resim.recordings.source import RecordingTables
from resim.recordings.tables import complete_rows
from resim.recordings.window import beyond_ego, limits
from resim.road.opendrive import RoadNetwork, load

KIND = {"2": "car", "10": "pedestrian"}
LENGTH, WIDTH = 4.92, 1.86  # m, Lincoln MKZ: the data do not name the vehicle
PEDESTRIAN_SIZE = 0.5  # m
MAP = "mcity.xodr"
GATE = 3.0  # m; a perceived object farther from the truth is another one
SMOOTHED = {"car": 0.5, "pedestrian": 1.1}  # s, window of the local cubic fit to the truth
STANDING = 0.3  # m/s; slower, the truth keeps its last heading
FITTED = 5  # samples of the shortest local cubic; fewer have differences


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
) -> RecordingTables:
    """Give the tables of a trial.

    Args:
        data: Folder of the data.
        map: OpenDRIVE file; default: that in the folder.
        ego: Id of the EGO in the truth; default: the vehicle that is tracked longest.
        start: First time [s] after the EGO's first sample; default: that of all rows.
        end: Last time [s] after the EGO's first sample; default: that of all rows.
        trial: Its name; needed where the folder holds more than one.
        length: Of the vehicles [m], which the data do not tell.
        width: Of the vehicles [m].

    Returns:
        The tables, faults that `resim check` tells left in.

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
        patterns=("./mcity.xodr",),
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
) -> RecordingTables:
    """Give a trial's tables, times [s] from the EGO's first sample on, where it lies on the map.

    length, width: of the vehicle [m]; a pedestrian has PEDESTRIAN_SIZE. ego: id in the truth; default: the vehicle
    (else pedestrian) that is tracked longest. Raises InputError for files that hold no such trial, or no frames as
    described above.
    """
    seen_file, truth_files = _files(data_dir, trial)
    truth = _named([_read(path, network, PLACE).assign(file=path.name) for path in truth_files])
    seen = _read(seen_file, network, (*PLACE, *MOTION, *SIZE))
    ego = _ego(truth, float(seen["t"].min()), float(seen["t"].max())) if ego is None else ego
    if ego not in truth["id"].to_numpy():
        names = ", ".join(truth["id"].drop_duplicates())
        raise InputError(data_dir, f"trial {trial} has no object {ego!r} in its truth", f"It has {names}.")
    first = float(truth.loc[truth["id"] == ego, "t"].min())
    boxes = {"car": (length, width), "pedestrian": (PEDESTRIAN_SIZE, PEDESTRIAN_SIZE)}
    kinds = truth.groupby("id", sort=False)["kind"].agg(lambda own: own.mode()[0])
    tracks = [_truth(rows, SMOOTHED[kinds[name]], boxes) for name, rows in truth.groupby("id", sort=False)]
    turn = network.header.offset[2]
    gt, sd = (_from_zero(frame, first) for frame in (pd.concat(tracks), _perceived(seen, turn)))
    whole, perceived = complete_rows(gt), complete_rows(sd)
    if not (whole["id"] == ego).any():
        problem = (
            f"{_where(truth, ego)} has no row with a position and a heading: it never moves, or is nowhere"
        )
        raise InputError(truth_files[0].parent, problem, "Name another one with --ego.")
    found = assigned(whole, perceived, GATE, ego) if len(perceived) else None
    of = {} if found is None else dict(zip(dict.fromkeys(perceived["id"]), found.gt_id.tolist(), strict=True))
    sd = sd.assign(**{GT_ID: sd["id"].map(of).fillna("")})
    files = ", ".join(path.relative_to(data_dir).as_posix() for path in (*truth_files, seen_file))
    told = {
        "source": f"Mcity trial {trial}, University of Michigan, MIT licence: {files}",
        "original_start": f"unix time {first:.6f} s",
        "projection": network.geo_reference or "",
        "ego_size": "assumed {:g} x {:g} m, the truth being its centre".format(*boxes[kinds[ego]]),
        "heading_and_speed_of_truth": f"local cubic over {SMOOTHED[kinds[ego]]} s of the positions",
        "identity": f"of the perceived, the nearest to the truth within {GATE} m, by majority per id; the EGO's own "
        "detection by kind, size and all its samples",
        "frames_put_in_order": str(seen.loc[seen["late"], "t"].nunique()),
        "outcome": _outcome(network, whole, perceived, of, ego),
    }
    told |= dict(_notes(gt, sd, truth, ego, {} if found is None else dict(found.not_ego)))
    own = Tracks.from_frame(whole[whole["id"] == ego])
    sd_rate = sample_rate(seen_file, Tracks.from_frame(perceived)) if len(perceived) else None
    return RecordingTables(
        settings=Settings(
            name=f"mcity_{trial}", map=str(network.path.resolve()), ego=ego, provenance=told,
            gt_rate=sample_rate(truth_files[0], own), sd_rate=sd_rate,
        ),
        map=network.path.resolve(), gt=gt, sd=sd, plan=None, folder=None, gt_file=truth_files[0], sd_file=seen_file,
    )  # fmt: skip


def _files(data_dir: Path, trial: str) -> tuple[Path, tuple[Path, ...]]:
    """The files of a trial: what was perceived, and the truth."""
    known = trials(data_dir)
    if trial not in known:
        raise InputError(data_dir, f"holds no trial {trial!r}", f"It has {', '.join(known) or 'none'}.")
    return known[trial]


def _where(truth: pd.DataFrame, name: str) -> str:
    """An object of the truth, with its file and its id there."""
    row = truth[truth["id"] == name].iloc[0]
    return f"{name} ({row['file']}, id {row['original']})"


def _notes(
    gt: pd.DataFrame, sd: pd.DataFrame, truth: pd.DataFrame, ego: str, not_ego: dict[str, str]
) -> Iterator[tuple[str, str]]:
    """What somebody has to know: who has no heading, who is not the EGO, and what goes on without the EGO."""
    lost = gt.groupby("id", sort=False)["heading"].apply(lambda h: bool(h.isna().all()))
    if names := lost.index[lost.to_numpy()].tolist():
        yield (
            "headings_missing",
            ", ".join(_where(truth, name) for name in names[:10])
            + ": never moves, so its heading is unknown; criteria that it can break are INVALID. "
            "Write its heading into gt.csv where it is known",
        )
    strange = truth.loc[~truth["classType"].isin(list(KIND)), "classType"].unique().tolist()
    if strange:
        yield "kinds", f"classes {', '.join(map(repr, strange[:10]))} of the truth taken as car"
    if not_ego:
        yield "not_the_ego", ", ".join(f"{name} ({why})" for name, why in list(not_ego.items())[:10])
    own = gt.loc[gt["id"] == ego, "t"].to_numpy(float)
    for name, frame in (("gt", gt), ("sd", sd)):
        if beyond := beyond_ego(own, frame):
            yield f"{name}_without_ego", beyond


def _cut(data: Path, whole: RecordingTables, start: float | None, end: float | None) -> RecordingTables:
    """The tables from start to end [s], their times from start on."""
    own = whole.gt.loc[whole.gt["id"] == whole.settings.ego, "t"]
    last = float(own.max())
    begin, until = 0.0 if start is None else start, last if end is None else end
    if not 0.0 <= begin < until <= last + TICK or whole.sd is None:
        problem = f"lasts {last:g} s, the requested window is {begin:g} to {until:g} s"
        raise InputError(data, problem, "Choose a start and an end within it.")
    gt, sd = (
        _from_zero(frame[frame["t"].between(*limits(start, end))], begin) for frame in (whole.gt, whole.sd)
    )
    if sd.empty:
        raise InputError(data, f"has no sensor data from {begin:g} to {until:g} s", "Choose another window.")
    window = f"{begin:g} to {until:g} s after the original start"
    told = {**whole.settings.provenance, "window": window}
    return replace(whole, gt=gt, sd=sd, settings=whole.settings.model_copy(update={"provenance": told}))


def _named(files: list[pd.DataFrame]) -> pd.DataFrame:
    """The rows of all truth, `id` and `kind` by object: vehicle or pedestrian, with a number where there are more."""
    parts = []
    for number, rows in enumerate(files):
        again = rows.groupby(["t", "id"]).cumcount()  # two in one frame under one id
        kind = rows["classType"].map(KIND).fillna("car")
        parts.append(
            rows.assign(
                kind=kind,
                original=rows["id"],
                id=[f"{number}/{i}/{n}" for i, n in zip(rows["id"], again, strict=True)],
            )
        )
    rows = pd.concat(parts, ignore_index=True)
    names: dict[str, str] = {}
    for of, word in (("car", "vehicle"), ("pedestrian", "pedestrian")):
        own = rows.loc[rows["kind"] == of, "id"].drop_duplicates().tolist()
        names |= {name: word if len(own) == 1 else f"{word}_{k}" for k, name in enumerate(own, start=1)}
    return rows.assign(id=rows["id"].map(names))


def _ego(truth: pd.DataFrame, begin: float, end: float) -> str:
    """The vehicle, else the pedestrian, that is there longest of what was perceived, the first of equals."""
    own = truth.assign(t=truth["t"].clip(begin, end))
    lasts = own.groupby(["kind", "id"], sort=False)["t"].agg(np.ptp).reset_index()
    lasts = lasts.sort_values(["kind", "t"], ascending=[True, False], kind="stable")
    return str(lasts["id"].iloc[0])


def _read(path: Path, network: RoadNetwork, numbers: tuple[str, ...]) -> pd.DataFrame:
    """The objects of a file, with x, y [m] in the map."""
    rows = read_objects(path, numbers)
    x, y = from_degrees(network, rows["lat"].to_numpy(float), rows["lon"].to_numpy(float))
    return rows.assign(x=x, y=y)


def _truth(rows: pd.DataFrame, over: float, boxes: dict[str, tuple[float, float]]) -> pd.DataFrame:
    """The track table of one object's truth: positions as measured, heading and speed of a zero-phase local fit over
    so many seconds; kinds as each row has them, with their boxes [m].
    """
    known = np.isfinite(rows[["x", "y"]].to_numpy(float)).all(axis=1)
    t, first, places = np.unique(rows["t"].to_numpy(float)[known], return_index=True, return_inverse=True)
    vx, vy = (_rate(t, rows[c].to_numpy(float)[known][first], over) for c in ("x", "y"))
    fast = np.hypot(vx, vy)
    course = pd.Series(np.where(fast > STANDING, np.arctan2(vy, vx), np.nan)).ffill().bfill().to_numpy()
    heading, v = (np.full(len(rows), np.nan) for _ in range(2))
    heading[known], v[known] = course[places], fast[places]
    length, width = (rows["kind"].map({kind: box[side] for kind, box in boxes.items()}) for side in (0, 1))
    return rows[["t", "id", "x", "y", "kind"]].assign(heading=heading, v=v, length=length, width=width)


def _rate(t: Floats, values: Floats, over: float) -> Floats:
    """The derivative (K,) of a local cubic over so many seconds; differences of a few samples, NaN of one alone."""
    from scipy.signal import savgol_filter  # it takes a second to load, and every run loads the formats

    if len(t) < 2:
        return np.full(len(t), np.nan)
    if len(t) < FITTED:
        return np.asarray(np.gradient(values, t))
    most = (len(t) - 1) // 2 * 2 + 1
    samples = min(max(round(over / float(np.median(np.diff(t)))) // 2 * 2 + 1, FITTED), most)
    change, step = (savgol_filter(z - z[0], samples, 3, deriv=1) for z in (values, t))
    return np.asarray(change / np.where(step > 0.0, step, np.nan))


def _perceived(rows: pd.DataFrame, turn: float) -> pd.DataFrame:
    """The track table of the perceived, sizes and classes as each row has them. turn: rad, of the map in its crs."""
    return rows[["t", "id", "x", "y"]].assign(
        heading=wrap_angle(rows["rotation"].to_numpy(float) + np.pi - turn), v=rows["speed"] / 3.6,
        length=rows["length"], width=rows["width"], kind=rows["classType"].map(KIND).fillna("unknown"),
    )  # fmt: skip


def _from_zero(frame: pd.DataFrame, first: float) -> pd.DataFrame:
    """The rows by time, from the first time [s] on."""
    frame = frame.assign(t=np.round(frame["t"] - first, 6)).sort_values("t", kind="stable")
    frame.index = pd.RangeIndex(2, len(frame) + 2)
    return frame


def _outcome(network: RoadNetwork, gt: pd.DataFrame, sd: pd.DataFrame, of: dict[str, str], ego: str) -> str:
    """What the trial holds, how far the perceived EGO is off, and how much of the drive is beyond the lanes."""
    own = Tracks.from_frame(gt[gt["id"] == ego])
    x, y, heading = own.x[0], own.y[0], own.heading[0]
    off = int((~network.to_road(x, y, heading=heading).on_road).sum())
    text = f"{own.t[-1]:.1f} s, {len(x)} truth samples, {off} of them on no driving lane; {len(of)} perceived ids"
    names = [name for name, truth in of.items() if truth == ego]
    if not names:
        return f"{text}, none of the EGO"
    rows = sd[sd["id"].isin(names)]
    times, places = np.unique(rows["t"].to_numpy(float), return_inverse=True)
    truth = own.at(times)
    error = np.hypot(rows["x"] - truth.x[0, places], rows["y"] - truth.y[0, places]).dropna()
    return f"{text}, {len(names)} of the EGO with {len(error)} samples, median error {error.median():.2f} m"
