"""Frames of the Mcity trials as JSON holds them: read, and refused with the frame, object and field that is wrong."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from resim.core.errors import InputError

PLACE, MOTION, SIZE = ("lat", "lon"), ("rotation", "speed"), ("length", "width")
"""Fields of an object. Those of place and motion may be null or NaN: they are missing then."""
MOST = {"lat": 90.0, "lon": 180.0}
"""Largest degrees."""
LATEST = 1e11
"""Largest time stamp [s]: of the year 5138."""
CORRECT = "Correct the file, or take the object out of it."


def frames_of(path: Path) -> list[dict[str, Any]]:
    """Give the frames of a file, each with `timestamp` [s, unix] and `objs`. Raises InputError."""
    try:
        frames = json.loads(path.read_text(encoding="utf-8"))
    except OSError as e:
        raise InputError(path, f"cannot be read ({e.strerror})", "Name the folder of the Mcity data.") from e
    except RecursionError as e:
        raise InputError(path, "is nested too deeply to be a list of frames", CORRECT) from e
    except ValueError as e:
        raise InputError(path, f"is not a list of frames with timestamp and objs ({e!r})") from e
    if not isinstance(frames, list):
        raise InputError(path, f"is not a list of frames with timestamp and objs, but {_short(frames)}")
    if not frames:
        raise InputError(path, "holds no frames")
    for n, frame in enumerate(frames, start=1):
        if not isinstance(frame, dict) or not {"timestamp", "objs"} <= set(frame):
            raise InputError(
                path, f"is not a list of frames with timestamp and objs: frame {n} is {_short(frame)}"
            )
        t = _float(frame["timestamp"])
        if isinstance(frame["timestamp"], str) or t is None or not abs(t) <= LATEST:
            problem = f"frame {n}: timestamp is {_short(frame['timestamp'])}, expected seconds of a calendar"
            raise InputError(path, problem, CORRECT)
        if not isinstance(frame["objs"], list):
            raise InputError(path, f"frame {n}: objs is {_short(frame['objs'])}, expected a list", CORRECT)
    return frames


def read_objects(path: Path, numbers: Sequence[str]) -> pd.DataFrame:
    """Give a row for each object of each frame, by time, in the file's order at one time.

    numbers: fields that are read besides t [s, unix], id and classType; NaN where PLACE or MOTION is missing. `late`:
    whether the object's frame stands after a later one. Raises InputError.
    """
    rows, latest = [], -math.inf
    for n, frame in enumerate(frames_of(path), start=1):
        t = float(frame["timestamp"])
        rows += [{"t": t, "late": t < latest, **own} for own in _objects(path, n, frame["objs"], numbers)]
        latest = t if frame["objs"] else latest
    if not rows:
        raise InputError(path, "holds no objects in any frame")
    return pd.DataFrame(rows).sort_values("t", kind="stable").reset_index(drop=True)


def trials(data_dir: Path) -> dict[str, tuple[Path, tuple[Path, ...]]]:
    """Give each trial's perception file and its truth files, by its number.

    These are all that share time with the perception, and all that share time with one of them: who is left out is
    nobody's obstacle.
    """
    spans = {
        path: _span(path) for folder in ("gts", "dets") for path in sorted((data_dir / folder).glob("*.json"))
    }
    truths = [path for path in spans if path.parent.name == "gts"]
    found: dict[Path, list[Path]] = {}
    for seen in (path for path in spans if path.parent.name == "dets"):
        mine = {path for path in truths if _share(spans[path], spans[seen])}
        while more := {
            path
            for path in truths
            if path not in mine and any(_share(spans[path], spans[own]) for own in mine)
        }:
            mine |= more
        if mine:
            found[seen] = [path for path in truths if path in mine]
    if not found:
        raise InputError(data_dir, "holds no truth (gts/*.json) at the time of a perception (dets/*.json)")
    named = {
        (re.findall(r"\d+", seen.stem) or [seen.stem])[-1]: (seen, tuple(files))
        for seen, files in found.items()
    }
    if len(named) < len(found):
        named = {seen.stem: (seen, tuple(files)) for seen, files in found.items()}
    return dict(sorted(named.items(), key=lambda item: (len(item[0]), item[0])))


def _share(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether two spans share time."""
    return min(one[1], other[1]) > max(one[0], other[0])


def _span(path: Path) -> tuple[float, float]:
    """First and last time [s] of a file's frames."""
    times = [float(frame["timestamp"]) for frame in frames_of(path)]
    return min(times), max(times)


def _objects(path: Path, n: int, objects: list[Any], numbers: Sequence[str]) -> Iterator[dict[str, Any]]:
    for k, told in enumerate(objects, start=1):
        where = f"frame {n}, object {k}"
        if not isinstance(told, dict):
            raise InputError(path, f"{where} is {_short(told)}, expected its fields", CORRECT)
        if lost := [name for name in ("id", "classType", *numbers) if name not in told]:
            raise InputError(
                path, f"{where}: {', '.join(lost)} missing; it has {', '.join(map(str, told))}", CORRECT
            )
        own: dict[str, Any] = {name: _name(path, where, name, told[name]) for name in ("id", "classType")}
        where = f"frame {n}, object {own['id']!r}"
        yield own | {name: _number(path, where, name, told[name]) for name in numbers}


def _name(path: Path, where: str, field: str, value: object) -> str:
    half = isinstance(value, str) and any("\ud800" <= c <= "\udfff" for c in value)  # of a character
    if isinstance(value, str | int) and not isinstance(value, bool) and str(value).strip() and not half:
        return str(value).strip()
    raise InputError(path, f"{where}: {field} is {_short(value)}, expected a text or a whole number", CORRECT)


def _number(path: Path, where: str, field: str, value: object) -> float:
    found = _float(value)
    missing = value is None or (isinstance(value, float) and math.isnan(value))
    if missing and field not in SIZE:
        return np.nan
    if found is None or not abs(found) <= MOST.get(field, 1e12):
        expected = f"degrees up to {MOST[field]:g}" if field in MOST else "a finite number"
        raise InputError(path, f"{where}: {field} is {_short(value)}, expected {expected}", CORRECT)
    return found


def _float(value: object) -> float | None:
    """A number, also as text; None for what is none."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        return None
    try:
        found = float(value)
    except (ValueError, OverflowError):
        return None
    return found if math.isfinite(found) else None


def _short(value: object) -> str:
    if isinstance(value, list | dict):
        return f"a {'list' if isinstance(value, list) else 'structure'} of {len(value)} values"
    if isinstance(value, int) and abs(value) > 1e18:
        return f"a number of {value.bit_length()} bits"
    text = repr(value)
    return text if len(text) <= 60 else text[:60] + "..."
