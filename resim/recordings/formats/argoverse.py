"""Argoverse 2: logs of the sensor data set, with a tracker's output beside them, and scenarios of motion forecasting.

Source: https://github.com/argoverse/av2-api (structures/cuboid.py, utils/io.py, datasets/motion_forecasting). Positions
are those of the city's frame, in which the OpenDRIVE map has to be: Argoverse's own vector maps are not read.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.geometry import wrap_angle
from resim.core.spelling import did_you_mean
from resim.recordings.formats.argoverse_log import AV, read_log, read_tracker
from resim.recordings.formats.registry import FORMATS, FormatOption, RecordingFormat
from resim.recordings.mapped.mapping import Match
from resim.recordings.mapped.motion import sized
from resim.recordings.mapped.reader import matched
from resim.recordings.present import existing_map
from resim.recordings.settings import Settings
from resim.recordings.source import RecordingTables, check_extent
from resim.recordings.tables import MOST_TURNED, check_times, read_table, row_problem
from resim.recordings.window import asked_window, beyond_ego, times_of

COLUMNS = ("timestep", "position_x", "position_y", "heading", "velocity_x", "velocity_y")
TIMES = ("start_timestamp", "end_timestamp", "num_timestamps")
TEXT = ("track_id", "object_type")
KINDS = {
    "vehicle": "car", "pedestrian": "pedestrian", "motorcyclist": "motorcycle", "cyclist": "bicycle", "bus": "bus",
    "riderless_bicycle": "bicycle", "unknown": "unknown",
}  # fmt: skip
"""Kinds of a scenario's object types; static objects, background and construction are left out."""
FASTEST, SLOWEST = 0.01, 1.0
"""Time [s] between two time steps at least and at most: it is 0.1 s."""


def read_argoverse(
    source: Path,
    *,
    map: Path,
    ego: str | None = None,
    start: float | None = None,
    end: float | None = None,
    sd: Path | None = None,
) -> RecordingTables:
    """Give what happened around the AV, or another object, as ground truth; and what a tracker saw as sensor data.

    Args:
        source: Folder of a sensor log (annotations.feather, city_SE3_egovehicle.feather), or a scenario of motion
            forecasting (scenario_ID.parquet), or its folder.
        map: OpenDRIVE file, in the frame of the city.
        ego: track_uuid or track_id of the EGO; without it "AV".
        start: First time [s] since the first annotation; default: the EGO's own.
        end: Last time [s]; default: the EGO's own.
        sd: Boxes of a tracker in the AV's frame, a Feather file with the columns of annotations.

    Raises:
        InputError: A file, column or value cannot be used; the EGO is not there.
    """
    ego = ego or AV
    scenario = _scenario(source)
    seen, first = None, 0
    if scenario is not None:
        if sd is not None:
            problem = "is sensor data, but a scenario of motion forecasting has no log to compare it with"
            raise InputError(sd, problem, "Give the folder of a sensor log, or leave out --sd.")
        gt, notes = _forecasting(scenario)
    else:
        gt, notes, first = read_log(source)
        if sd is not None:
            seen, told = read_tracker(sd, source, first)
            notes |= told
    file = scenario or source / "annotations.feather"
    gt, seen = _windowed(file, gt, seen, ego, start, end)
    if beyond := beyond_ego(times_of(gt, file, ego), gt):
        notes["without_ego"] = beyond
    check_extent(file, gt)
    check_times(file, gt)
    if seen is not None and sd is not None:
        seen, told = matched(Match(by="nearest"), gt, seen, sd, ego)
        notes |= told
    name = f"{file.stem if scenario else source.absolute().name}_{ego}"
    provenance = {
        "source": file.name if scenario else source.absolute().name,
        "format": "Argoverse 2",
        **notes,
    }
    return RecordingTables(
        settings=Settings(name=name, map=str(map), ego=ego, provenance=provenance),
        map=existing_map(map, map), gt=gt, sd=seen, plan=None, folder=None, gt_file=file, sd_file=sd or file,
    )  # fmt: skip


FORMATS.add(
    RecordingFormat(
        name="argoverse",
        source="Argoverse 2 (sensor logs, motion forecasting)",
        file="log",
        file_help="Folder of a sensor log (annotations.feather), or scenario_ID.parquet of motion forecasting.",
        reader=read_argoverse,
        options=(
            FormatOption(
                "sd",
                Path,
                "Boxes of a tracker: Feather, as annotations.",
                metavar="FILE",
                patterns=("*.feather",),
            ),
        ),
        works_out=("ego",),
        patterns=("scenario_*.parquet", "./annotations.feather"),
    )
)


def _scenario(source: Path) -> Path | None:
    """The Parquet file of a scenario, None for the folder of a sensor log."""
    if source.is_dir():
        if (source / "annotations.feather").is_file():
            return None
        found = sorted(source.glob("scenario_*.parquet"))
        if len(found) == 1:
            return found[0]
        there = ", ".join(sorted(p.name for p in source.iterdir())[:20]) or "nothing"
        problem = f"has neither annotations.feather nor one scenario_*.parquet; it has {there}"
        raise InputError(
            source, problem, "Give the folder of a log with annotations (train or val), or a scenario."
        )
    if source.suffix != ".parquet":
        raise InputError(source, "is neither the folder of a log nor a .parquet file", "Give one of them.")
    return source


def _forecasting(path: Path) -> tuple[pd.DataFrame, dict[str, str]]:
    """The track table of a scenario, and what was assumed and left out."""
    raw = read_table(path, required=(*TEXT, *COLUMNS, *TIMES), text=(*TEXT, *TIMES))
    start, step = _clock(path, raw)
    kind = raw["object_type"].map(KINDS)
    left = raw.loc[kind.isna(), "object_type"]
    frame = raw.assign(kind=kind)[kind.notna()]
    if frame.empty:
        raise InputError(path, f"has no road user, only {', '.join(left.unique())}", "Give another scenario.")
    if (turned := frame["heading"].abs() > MOST_TURNED).any():
        row = frame.index[turned][0]
        problem = f"heading is {frame['heading'][row]:g}, expected radians up to {MOST_TURNED:g}"
        raise InputError(path, row_problem(frame, row, problem), "Download the scenario again.")
    heading = wrap_angle(frame["heading"].to_numpy(float))
    made = pd.DataFrame(
        {
            "t": np.round(frame["timestep"] * step, 9), "id": frame["track_id"], "x": frame["position_x"],
            "y": frame["position_y"], "heading": heading,
            "v": frame["velocity_x"] * np.cos(heading) + frame["velocity_y"] * np.sin(heading),
            "length": np.nan, "width": np.nan, "kind": frame["kind"],
        }
    )  # fmt: skip
    made, assumed = sized(made)
    notes = {"original_start": f"{start:.0f} ns", "gt_sizes": assumed}
    if len(left):
        counts = raw[kind.isna()].groupby("object_type")["track_id"].nunique()
        notes["gt_left_out"] = ", ".join(f"{n} {name}" for name, n in counts.items())
    return made.sort_values("t", kind="stable"), notes


def _clock(path: Path, raw: pd.DataFrame) -> tuple[float, float]:
    """The first time [ns], and the time [s] between two time steps."""
    told = [
        str(raw[name].iloc[0]) for name in TIMES
    ]  # as text: numbers of tables end before nanoseconds of today
    try:
        start, end, count = map(float, told)
        step = (end - start) / max(count - 1.0, 1.0) / 1e9
    except ValueError:
        step = np.nan
    if not FASTEST <= step <= SLOWEST:
        problem = f"{', '.join(TIMES)} are {', '.join(told)}, expected time steps 0.1 s apart"
        raise InputError(path, problem, "Download the scenario again.")
    return start, step


def _windowed(
    path: Path, gt: pd.DataFrame, sd: pd.DataFrame | None, ego: str, start: float | None, end: float | None
) -> tuple[pd.DataFrame, pd.DataFrame | None]:
    """The rows from start to end [s]; nothing is cut where they are not given."""
    known = gt["id"].drop_duplicates().tolist()
    if ego not in known:
        problem = f"ego {ego!r} was not found{did_you_mean(ego, known)}"
        raise InputError(path, problem, f"It has {', '.join(known[:20])}.")
    low, high = asked_window(gt, path, ego=ego, start=start, end=end)
    first, *others = (
        one[one["t"].between(low, high)].reset_index(drop=True) for one in (gt, *([] if sd is None else [sd]))
    )
    for one in (first, *others):
        one.index = pd.RangeIndex(1, len(one) + 1)
    return first, others[0] if others else None
