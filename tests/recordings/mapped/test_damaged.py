"""Damaged tables, mappings and trials are told as wrong, or read; nothing else happens to the user."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recordings.mapped.strangers import MAP, Way, drive, written

from resim.core.errors import InputError
from resim.recordings import write_tables
from resim.recordings.formats.mcity import read_mcity
from resim.recordings.mapped.guess import guess
from resim.recordings.mapped.reader import read_mapped
from resim.road.opendrive import load

NETWORK = load(MAP)
DRAWN = settings(
    max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
CELLS = st.sampled_from(
    [
        "",
        "nan",
        "inf",
        "-1",
        "0",
        "1e300",
        "44",
        "ego",
        "é",
        '"',
        ";",
        "\x1b[31m",
        "0001-01-01T00:00:00",
        "true",
        "[1]",
    ]
)
NAMES = [
    "who",
    "when",
    "px",
    "py",
    "yaw",
    "speed",
    "len",
    "wid",
    "class",
    "id",
    "t",
    "x",
    "lat",
    "lon",
    "vx",
    "vy",
]


def clear(job: Callable[[], object], folder: Path) -> bool:
    """Whether a job ends well, or with an error that names a file, or an option, and is one short line."""
    try:
        job()
    except InputError as e:
        return (str(folder) in str(e) or str(e).startswith("--")) and len(str(e)) < 1500
    return True


@DRAWN
@given(
    cells=st.lists(st.tuples(st.integers(0, 30), st.integers(0, 8), CELLS), max_size=20),
    header=st.dictionaries(st.integers(0, 8), st.sampled_from(NAMES), max_size=3),
    separator=st.characters(max_codepoint=300),
    rate=st.none() | st.floats(),
    window=st.tuples(st.none() | st.floats(-1.0, 9.0), st.none() | st.floats(-1.0, 9.0)),
)
def test_damaged_tables(
    cells: list[tuple[int, int, str]],
    header: dict[int, str],
    separator: str,
    rate: float | None,
    window: tuple[float | None, float | None],
) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path, text = written(folder, drive(steps=12), Way(time="frames"))
        table = pd.read_csv(path, dtype=str)
        for row, column, cell in cells:
            table.iloc[row, column] = cell
        table.columns = pd.Index([header.get(n, c) for n, c in enumerate(table.columns)])
        table.to_csv(path, index=False)
        quoted = json.dumps(separator) if rate is None else '","'
        (folder / "m.toml").write_text(
            f'ego = "ego"\n[gt]\nseparator = {quoted}\n{text}\n[sd]\n{text}\n', encoding="utf-8"
        )
        more: dict = {"rate": rate, "start": window[0], "end": window[1]}
        columns = folder / "m.toml"
        assert clear(
            lambda: write_tables(read_mapped(path, map=MAP, columns=columns, **more), folder / "out"), folder
        )
        assert clear(lambda: guess(path, folder / "g.toml", sensor=path, network=NETWORK), folder)


VALUES = st.sampled_from(
    [
        None,
        float("nan"),
        float("inf"),
        "abc",
        "",
        "4.7",
        [1],
        {},
        True,
        0,
        -1,
        1e300,
        10**400,
        "2",
        48.0,
        11.004,
    ]
)
FIELDS = ["id", "lat", "lon", "classType", "rotation", "speed", "length", "width"]


def frames(count: int, step: float = 0.1) -> list[dict]:
    """A car that drives straight on, as Mcity's files have it."""
    own = {"id": "1", "classType": "2", "rotation": 3.14, "speed": 72.0, "length": 4.7, "width": 1.9}
    return [
        {"timestamp": 1.7e9 + step * k, "objs": [own | {"lat": 48.0, "lon": 11.004 + 2.7e-4 * step * k}]}
        for k in range(count)
    ]


def trial(folder: Path, truth: object, seen: object) -> Path:
    for name, told in (("gts/t1.json", truth), ("dets/d1.json", seen)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(told if isinstance(told, str) else json.dumps(told), encoding="utf-8")
    return folder


@DRAWN
@given(
    counts=st.tuples(st.integers(1, 12), st.integers(1, 12)),
    step=st.sampled_from([0.0, 0.02, 0.1, 1.0]),
    changes=st.lists(
        st.tuples(st.booleans(), st.integers(0, 11), st.sampled_from([*FIELDS, "timestamp", "objs"]), VALUES),
        max_size=4,
    ),
    lost=st.lists(st.tuples(st.booleans(), st.integers(0, 11), st.sampled_from(FIELDS)), max_size=2),
    backwards=st.booleans(),
)
def test_damaged_trials(
    counts: tuple[int, int],
    step: float,
    changes: list[tuple[bool, int, str, object]],
    lost: list[tuple[bool, int, str]],
    backwards: bool,
) -> None:
    both = [frames(count, step)[:: -1 if backwards else 1] for count in counts]
    for of, k, field, value in changes:
        frame = both[of][k % len(both[of])]
        own = (
            frame
            if field in frame
            else frame["objs"][0]
            if isinstance(frame["objs"], list) and frame["objs"]
            else {}
        )
        if isinstance(own, dict):
            own[field] = value
    for of, k, field in lost:
        objects = both[of][k % len(both[of])]["objs"]
        if isinstance(objects, list) and objects and isinstance(objects[0], dict):
            objects[0].pop(field, None)
    with tempfile.TemporaryDirectory() as name:
        folder = trial(Path(name), *both)
        assert clear(lambda: write_tables(read_mcity(folder, map=MAP), folder / "out"), folder)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_truth_of_few_samples_is_read(tmp_path: Path, count: int) -> None:
    found = read_mcity(trial(tmp_path, frames(count), frames(20)), map=MAP)
    assert found.gt["v"].to_numpy() == pytest.approx(np.full(count, 20.1), abs=0.2)


@pytest.mark.parametrize("truth", [frames(12, 1.0), frames(40)[::-1]])
def test_a_slow_truth_and_one_in_reverse_are_read(tmp_path: Path, truth: list[dict]) -> None:
    found = read_mcity(trial(tmp_path, truth, truth), map=MAP)
    assert found.gt["t"].is_monotonic_increasing
    assert found.gt["v"].to_numpy() == pytest.approx(np.full(len(truth), 20.1), abs=0.2)
    assert found.sd is not None
    assert set(found.sd["gt_id"]) == {"vehicle"}


def test_what_json_cannot_hold_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"t1\.json: is nested too deeply to be a list of frames"):
        read_mcity(trial(tmp_path, "[" * 100_000, frames(9)), map=MAP)
    with pytest.raises(
        InputError, match=r"t1\.json: frame 1: timestamp is a number of 1329 bits, expected seconds"
    ):
        read_mcity(trial(tmp_path, [{"timestamp": 10**400, "objs": []}], frames(9)), map=MAP)
    wrong = frames(9)
    wrong[3]["objs"][0]["speed"] = "abc"
    message = r"d1\.json: frame 4, object '1': speed is 'abc', expected a finite number\. Correct the file"
    with pytest.raises(InputError, match=message):
        read_mcity(trial(tmp_path, frames(9), wrong), map=MAP)
    wrong[3]["objs"][0]["id"] = "\ud800"
    with pytest.raises(InputError, match=r"frame 4, object 1: id is .*, expected a text or a whole number"):
        read_mcity(trial(tmp_path, frames(9), wrong), map=MAP)
    del wrong[3]["objs"][0]["width"]
    with pytest.raises(InputError, match=r"d1\.json: frame 4, object 1: width missing; it has id, "):
        read_mcity(trial(tmp_path, frames(9), wrong), map=MAP)


def test_positions_that_are_missing_stay_missing(tmp_path: Path) -> None:
    truth, seen = frames(20), frames(20)
    truth[5]["objs"][0]["lat"] = seen[7]["objs"][0]["rotation"] = float("nan")
    found = read_mcity(trial(tmp_path, truth, seen), map=MAP)
    assert found.gt["x"].isna().tolist() == [k == 5 for k in range(20)]
    assert found.sd is not None
    assert found.sd["heading"].isna().tolist() == [k == 7 for k in range(20)]


def test_a_vehicle_that_never_moves_is_told_with_its_file(tmp_path: Path) -> None:
    truth = frames(30)
    for frame in truth:
        frame["objs"].append({"id": "7", "classType": "2", "lat": 48.0, "lon": 11.008})
    found = read_mcity(trial(tmp_path, truth, frames(30)), map=MAP)
    assert found.settings.ego == "vehicle_1"
    assert found.gt.loc[found.gt["id"] == "vehicle_2", "heading"].isna().all()
    told = found.settings.provenance["headings_missing"]
    assert told.startswith("vehicle_2 (t1.json, id 7): never moves, so its heading is unknown")
    with pytest.raises(
        InputError, match=r"vehicle_2 \(t1\.json, id 7\) has no row with a position and a heading"
    ):
        read_mcity(tmp_path, map=MAP, ego="vehicle_2")
