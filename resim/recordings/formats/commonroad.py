"""CommonRoad scenarios, formats 2018a (times in seconds), 2018b and 2020a (times in steps)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
from lxml import etree

from resim.core.errors import InputError
from resim.core.files import read_file
from resim.core.geometry import Floats, wrap_angle
from resim.core.tracks import Tracks
from resim.core.xml import safe_root
from resim.recordings.formats.registry import FORMATS, RecordingFormat
from resim.recordings.present import existing_map
from resim.recordings.recording import Recording, sample_rate
from resim.recordings.tables import BIGGEST, MOST_TURNED
from resim.recordings.window import cut_window

VERSIONS = ("2018a", "2018b", "2020a")
KIND = {
    "car": "car", "taxi": "car", "priorityVehicle": "car", "parkedVehicle": "car", "truck": "truck",
    "bus": "bus", "bicycle": "bicycle", "motorcycle": "motorcycle", "pedestrian": "pedestrian",
}  # fmt: skip
# parts of the site, not traffic
FURNITURE = ("roadBoundary", "building", "pillar", "median_strip")
_EXPORT = "Export the scenario from its tool again."


def read_commonroad(
    xml: Path, *, map: Path, ego: str, start: float | None = None, end: float | None = None
) -> Recording:
    """Give what happened around the dynamic obstacle `ego` as ground truth.

    start, end [s] are scenario times; without them the window is the EGO's own. Intervals count as their
    middle. Static obstacles stand for the whole window, as `unknown` where the type is no vehicle's; walls,
    pillars and the like (FURNITURE) are left out. The map is in the scenario's frame. Raises InputError.
    """
    root = _parse(xml)
    obstacles = _obstacles(xml, root)
    step = _step(xml, root)
    moving = [_trajectory(xml, o, step) for o in obstacles if not _is_static(o)]
    if not moving:
        raise InputError(xml, "has no dynamic obstacle", "A recording needs a driven EGO.")
    frame, window = cut_window(pd.concat(moving), xml, ego=ego, start=start, end=end)
    times = np.unique(frame["t"])
    frame = pd.concat([frame, *(_standing(xml, o, times) for o in obstacles if _is_static(o))])
    frame["heading"] = wrap_angle(frame["heading"])
    measured = frame.dropna(axis="columns", how="all").sort_values("t", kind="stable")
    gt = Tracks.from_frame(measured)
    return Recording(
        name=f"{root.get('benchmarkID', xml.stem)}_{ego}", map=existing_map(map, map), ego=ego, gt=gt,
        gt_rate=sample_rate(xml, gt), provenance=_provenance(xml, root) | window,
    )  # fmt: skip


FORMATS.add(
    RecordingFormat(
        name="commonroad",
        source="a CommonRoad scenario",
        file="scenario",
        file_help="CommonRoad scenario, XML of 2018a or 2020a.",
        reader=read_commonroad,
        patterns=("*.xml",),
    )
)


def _parse(path: Path) -> etree._Element:
    """The root of a CommonRoad file."""
    root = safe_root(read_file(path, "Check the path"), path, remedy=_EXPORT)
    if root.tag != "commonRoad":
        raise InputError(path, f"the root element is <{root.tag}>, expected <commonRoad>")
    if (version := root.get("commonRoadVersion")) not in VERSIONS:
        problem = f"commonRoadVersion is {version!r}, expected one of {', '.join(VERSIONS)}"
        raise InputError(path, problem, "Convert the scenario to 2020a.")
    return root


def _step(path: Path, root: etree._Element) -> float:
    """Seconds in one unit of a state's time."""
    if root.get("commonRoadVersion") == "2018a":
        return 1.0
    step = _float(path, root.get("timeStepSize"), "<commonRoad> timeStepSize")
    if step <= 0.0:
        raise InputError(path, f"timeStepSize is {step:g}, expected seconds above 0")
    return step


def _obstacles(path: Path, root: etree._Element) -> list[etree._Element]:
    """Every obstacle that is traffic."""
    found = [o for o in root if o.tag in ("obstacle", "dynamicObstacle", "staticObstacle")]
    ids = pd.Series([o.get("id", "") for o in found], dtype=str)
    if len(twice := ids[ids.duplicated()]):
        raise InputError(
            path, f"obstacle id {twice.iloc[0]!r} is a duplicate", "Give each obstacle its own id."
        )
    return [o for o in found if o.findtext("type", "").strip() not in FURNITURE]


def _is_static(obstacle: etree._Element) -> bool:
    return obstacle.tag == "staticObstacle" or obstacle.findtext("role", "").strip() == "static"


def _trajectory(path: Path, obstacle: etree._Element, step: float) -> pd.DataFrame:
    """The track table of a dynamic obstacle; yaw_rate and a are NaN where the file has none, z where it has any."""
    where = f"obstacle {obstacle.get('id')}"
    states = _states(path, obstacle)
    rows = {
        name: np.full(len(states), np.nan) for name in ("t", "x", "y", "heading", "v", "yaw_rate", "a", "z")
    }
    for n, state in enumerate(states):
        place = f"{where}, state {n}"
        rows["t"][n] = step * _value(path, state, "time", place)
        rows["x"][n], rows["y"][n] = _position(path, state, place)
        if (height := state.findtext("position/point/z")) is not None:
            rows["z"][n] = _float(path, height, f"{place}: position z")
        rows["heading"][n] = _value(path, state, "orientation", place, MOST_TURNED)
        rows["v"][n] = _value(path, state, "velocity", place)
        for column, tag in (("yaw_rate", "yawRate"), ("a", "acceleration")):
            if state.find(tag) is not None:
                rows[column][n] = _value(path, state, tag, place)
    if not np.isfinite(rows["z"]).any():
        del rows["z"]
    late = np.flatnonzero(np.diff(rows["t"]) <= 0.0)
    if len(late):
        before, now = rows["t"][late[0]], rows["t"][late[0] + 1]
        raise InputError(path, f"{where}, state {late[0] + 1}: time {now:g} s does not follow {before:g} s")
    return pd.DataFrame(rows | _identity(path, obstacle))


def _standing(path: Path, obstacle: etree._Element, times: Floats) -> pd.DataFrame:
    """The track table of a static obstacle, there and at rest at all times (T,) [s]."""
    where = f"obstacle {obstacle.get('id')}"
    state = _states(path, obstacle)[0]
    x, y = _position(path, state, where)
    heading = _value(path, state, "orientation", where, MOST_TURNED)
    rest = {"t": times, "x": x, "y": y, "heading": heading, "v": 0.0, "yaw_rate": 0.0, "a": 0.0}
    return pd.DataFrame(rest | _identity(path, obstacle))


def _states(path: Path, obstacle: etree._Element) -> list[etree._Element]:
    states = [*obstacle.findall("initialState"), *obstacle.findall("trajectory/state")]
    if not states:
        problem = f"obstacle {obstacle.get('id')} has no trajectory"
        raise InputError(path, problem, "Only obstacles with a trajectory can be replayed.")
    return states


def _identity(path: Path, obstacle: etree._Element) -> dict[str, str | float]:
    """Id, kind, and the box [m] of a rectangle or a circle around the position."""
    name = obstacle.get("id", "")
    shape = obstacle.find("shape")
    form = None if shape is None or len(shape) != 1 else shape[0]
    if form is None or form.tag not in ("rectangle", "circle"):
        tags = "none" if shape is None else ", ".join(str(e.tag) for e in shape)
        raise InputError(path, f"obstacle {name}: shape is {tags}, expected one rectangle or circle")
    if any(
        _float(path, e.text or "0", f"obstacle {name}: shape {e.tag}")
        for e in form.iter("x", "y", "orientation")
    ):
        raise InputError(path, f"obstacle {name}: its shape is offset or rotated relative to its position")
    if form.tag == "circle":
        length = width = 2.0 * _float(path, form.findtext("radius"), f"obstacle {name}: radius")
    else:
        length, width = (
            _float(path, form.findtext(side), f"obstacle {name}: {side}") for side in ("length", "width")
        )
    if min(length, width) <= 0.0:
        raise InputError(path, f"obstacle {name}: size is {length:g} x {width:g} m, expected more than 0")
    kind = KIND.get(obstacle.findtext("type", "").strip(), "unknown")
    return {"id": name, "kind": kind, "length": length, "width": width}


def _position(path: Path, state: etree._Element, where: str) -> tuple[float, float]:
    """The point [m], or the centre of the area where the position is uncertain."""
    point = state.find("position/point")
    if point is None:
        point = state.find("position/*/center")
    if point is None:
        raise InputError(path, f"{where}: position is neither a point nor an area with a centre")
    return tuple(_float(path, point.findtext(c), f"{where}: position {c}") for c in ("x", "y"))  # type: ignore[return-value]


def _value(path: Path, state: etree._Element, tag: str, where: str, most: float = BIGGEST) -> float:
    """The exact value, or the middle of the interval."""
    exact = state.findtext(f"{tag}/exact")
    if exact is not None:
        return _float(path, exact, f"{where}: {tag}", most)
    ends = (state.findtext(f"{tag}/interval{end}") for end in ("Start", "End"))
    return 0.5 * sum(_float(path, end, f"{where}: {tag}", most) for end in ends)


def _float(path: Path, text: str | None, where: str, most: float = BIGGEST) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not abs(value) <= most:
        found = "missing" if text is None else repr(text[:50])
        raise InputError(path, f"{where} is {found}, expected a finite number up to {most:g}")
    return value


def _provenance(path: Path, root: etree._Element) -> dict[str, str]:
    known = {
        "source": path.name, "format": f"CommonRoad {root.get('commonRoadVersion')}",
        "benchmark": root.get("benchmarkID"), "author": root.get("author"), "data": root.get("source"),
    }  # fmt: skip
    return {key: value for key, value in known.items() if value}
