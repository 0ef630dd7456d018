"""What a stranger's tables leave open reaches the judge: an import makes no drive safe that is not shown to be."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from recordings.mapped.strangers import MAP

from resim.core.errors import InputError
from resim.metrics.criteria import read_criteria
from resim.recordings import write_tables
from resim.recordings.checks import CODES
from resim.recordings.mapped.reader import read_mapped
from resim.resimulation import AssessmentOptions, assess_recording, load_checked

TRAFFIC = MAP.parents[1] / "scenarios" / "criteria" / "traffic.toml"
SPEED = 20.0
T = np.round(np.arange(0.0, 9.01, 0.04), 2)
FIELDS = ("t", "id", "x", "y", "heading", "v", "length", "width", "kind")
COLUMNS = "".join(f'{name} = "{name}"\n' for name in FIELDS)


def rows(name: str, x: object, y: object = -5.25, v: float = 0.0, **more: object) -> pd.DataFrame:
    """An object's rows over 9 s: a car on the EGO's lane, unless told otherwise."""
    told = {"heading": 0.0, "length": 4.7, "width": 1.9, "kind": "car", **more}
    return pd.DataFrame({"t": T, "id": name, "x": x, "y": y, "v": v, **told})


def ego() -> pd.DataFrame:
    return rows("ego", 300.0 + SPEED * T, v=SPEED)


def far() -> pd.DataFrame:
    return rows("2", 450.0 + SPEED * T, -1.75, v=SPEED)


def beside(begin: float, end: float, **more: object) -> pd.DataFrame:
    """Somebody who drives along with the EGO, and comes nearer from the left."""
    return rows("9", 300.0 + SPEED * T, -5.25 + np.clip(begin - 0.3 * T, end, None), v=SPEED, **more)


def standing() -> pd.DataFrame:
    """Whom the EGO hits at 4.77 s."""
    return rows("1", 400.0)


def until(frame: pd.DataFrame, t: float) -> pd.DataFrame:
    return frame[frame["t"] < t]


class Judge:
    """Imports tables and judges them by the shipped criteria of traffic."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.told: dict[str, str] = {}

    def imported(
        self,
        gt: list[pd.DataFrame],
        sd: list[pd.DataFrame] | None = None,
        *,
        frame: str = "",
        match: str = "",
        **more: object,
    ) -> Path:
        """Write the tables as a stranger's, and import them into a recording folder; frame: lines of the table sd."""
        pd.concat(gt).to_csv(self.folder / "gt.csv", index=False)
        text = f'ego = "ego"\n[gt]\nfile = "gt.csv"\n{COLUMNS}'
        if sd is not None:
            pd.concat(sd).to_csv(self.folder / "sd.csv", index=False)
            text += f'[sd]\nfile = "sd.csv"\n{frame}{COLUMNS}{match}'
        (self.folder / "m.toml").write_text(text, encoding="utf-8")
        arguments: dict = {"map": MAP, "columns": self.folder / "m.toml", **more}
        found = read_mapped(self.folder / "gt.csv", **arguments)
        self.told = dict(found.settings.provenance)
        write_tables(found, self.folder / "rec")
        return self.folder / "rec"

    def __call__(
        self,
        gt: list[pd.DataFrame],
        sd: list[pd.DataFrame] | None = None,
        *,
        accept: tuple[str, ...] = (),
        **more: object,
    ) -> dict[str, str]:
        """Give the verdict of `no collision` for each source."""
        return verdicts(self.imported(gt, sd, **more), accept)  # type: ignore[arg-type]


def verdicts(folder: Path, accept: tuple[str, ...] = ()) -> dict[str, str]:
    recording = load_checked(folder, accept=accept)
    found = assess_recording(recording, AssessmentOptions(criteria=read_criteria(TRAFFIC), only=()))
    return {basis: block.verdicts["no collision"].outcome for basis, block in found.blocks.items()}


@pytest.fixture
def judge(tmp_path: Path) -> Judge:
    return Judge(tmp_path)


def test_rows_after_the_egos_last_show_that_the_drive_lasted_longer(judge: Judge) -> None:
    found = judge([until(ego(), 3.0), until(standing(), 3.0)], [ego(), standing()])
    assert found == {"GT": "INVALID", "SD": "FAIL"}
    assert judge.told["sd_without_ego"].startswith("302 rows before 0 s or after 2.96 s")


def test_rows_of_others_in_gt_after_the_egos_last_are_kept(judge: Judge) -> None:
    assert judge([until(ego(), 3.0), standing()]) == {"GT": "INVALID"}


def test_rows_before_the_egos_first_show_that_the_drive_began_earlier(judge: Judge) -> None:
    late = ego()
    assert judge([late[late["t"] > 6.0], standing()], [ego(), standing()]) == {"GT": "INVALID", "SD": "FAIL"}


def test_what_cannot_be_placed_without_the_ego_is_kept_without_a_place(judge: Judge) -> None:
    seen = standing().assign(x=lambda f: f["x"] - (300.0 + SPEED * f["t"]), y=0.0)
    found = judge([until(ego(), 3.0), until(standing(), 3.0)], [seen], frame='frame = "ego"\n')
    assert found == {"GT": "INVALID", "SD": "INVALID"}
    assert judge.told["sd_without_place"].startswith("151 rows at times at which the EGO has no sample")


def test_only_what_is_asked_for_cuts(judge: Judge) -> None:
    found = judge([until(ego(), 3.0), until(standing(), 3.0)], [ego(), standing()], start=0.0, end=2.96)
    assert found == {"GT": "PASS", "SD": "PASS"}
    assert "sd_without_ego" not in judge.told
    assert judge.told["sd_outside"] == "302 rows before 0 s or after 2.96 s left out"


def test_a_sensor_whose_first_and_last_frames_lie_just_outside_is_no_doubt(judge: Judge) -> None:
    truth = pd.concat([ego(), far()])
    seen = far().assign(t=lambda f: np.round(f["t"] - 0.02, 2), x=lambda f: f["x"] - 0.02 * SPEED)
    seen = pd.concat([seen, seen.tail(1).assign(t=9.02, x=lambda f: f["x"] + 0.04 * SPEED)])
    seen = seen.assign(x=lambda f: f["x"] - (300.0 + SPEED * f["t"]), y=3.5)
    assert judge([truth], [seen], frame='frame = "ego"\n') == {"GT": "PASS", "SD": "PASS"}


SHAPES: dict[str, Callable[[], pd.DataFrame]] = {
    "motorcycle": lambda: beside(2.9, 1.2, length=2.2, width=0.8, kind="motorcycle"),
    "pedestrian": lambda: beside(2.9, 0.9, length=0.5, width=0.5, kind="pedestrian"),
    "car that comes nearer": lambda: beside(2.9, 1.2),
    "car aside throughout": lambda: beside(1.5, 1.5),
    "half as large": lambda: beside(0.3, 0.3, length=2.5, width=1.0),
    "part of the time another kind": lambda: beside(0.3, 0.3, kind=np.where(T < 4.0, "car", "pedestrian")),
    "part of the time small": lambda: beside(0.3, 0.3, length=np.where(T < 5.0, 4.7, 0.5)),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("gate", [3.0, 10.0])
def test_a_road_user_that_touches_the_ego_is_not_its_own_detection(
    judge: Judge, name: str, gate: float
) -> None:
    match = f'[match]\nby = "nearest"\ngate = {gate}\n'
    found = judge([ego(), far()], [far().assign(id="22"), SHAPES[name]()], match=match, accept=tuple(CODES))
    assert found == {"GT": "PASS", "SD": "FAIL"}
    assert "near the EGO, and not taken for it: 9 (" in judge.told["identity"]
    assert "the EGO is not detected by the sensor" in judge.told["identity"]


def test_who_takes_the_place_of_a_lost_detection_is_not_the_ego(judge: Judge) -> None:
    more = beside(2.9, 1.2, length=2.2, width=0.8, kind="motorcycle")
    seen = [far().assign(id="22"), more[more["t"] >= 3.0], until(ego(), 3.0).assign(id="e")]
    assert judge([ego(), far()], seen)["SD"] in ("FAIL", "INVALID")
    assert "the EGO is detected as e;" in judge.told["identity"]


def test_the_sensors_own_detection_of_the_ego_is_the_ego(judge: Judge) -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.25, (2, len(T)))
    own = ego().assign(id="e", x=lambda f: f["x"] - 0.9 + noise[0], y=lambda f: f["y"] + 0.2 + noise[1])
    own = own.assign(length=4.4, width=2.1, kind="unknown")
    seen = [far().assign(id="22"), until(own, 4.0), own[own["t"] >= 4.0].assign(id="f")]
    judge.imported([ego(), far()], seen)
    assert judge.told["identity"].endswith(
        "3 of 3 ids matched, median distance 0.92 m; the EGO is detected as e, f"
    )


NAMED: dict[str, Callable[[], pd.DataFrame]] = {
    "pedestrian": lambda: beside(2.9, 0.9, length=0.5, width=0.5, kind="pedestrian").assign(gt_id="ego"),
    "small": lambda: beside(2.9, 0.9, length=0.5, width=0.5, kind="unknown").assign(gt_id="ego"),
    "motorcycle of a car's size": lambda: beside(2.9, 0.9, kind="motorcycle").assign(gt_id="ego"),
}


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize("by", ["column", "hand"])
def test_who_is_named_as_the_ego_and_cannot_be_it_is_a_road_user(judge: Judge, name: str, by: str) -> None:
    gt, sd = [ego(), far()], [far().assign(gt_id="2"), NAMED[name]()]
    if by == "column":
        folder = judge.imported(gt, sd, frame='gt_id = "gt_id"\n')
    else:
        folder = judge.folder / "hand"
        folder.mkdir()
        (folder / "recording.toml").write_text(f'name = "d"\nmap = "{MAP}"\nego = "ego"\n')
        for source, tables in (("gt", gt), ("sd", sd)):
            pd.concat(tables).sort_values("t", kind="stable").to_csv(folder / f"{source}.csv", index=False)
    with pytest.raises(
        InputError, match=r"sd 9 at 0\.00 s: SD_WITHOUT_GT: is named 'ego'.* judged as a road user"
    ):
        load_checked(folder)
    assert verdicts(folder, tuple(CODES)) == {"GT": "PASS", "SD": "FAIL"}


def test_a_name_that_changes_is_not_made_one(judge: Judge) -> None:
    changing = beside(2.9, 0.9).assign(gt_id=np.where(T < 1.0, "ego", ""))
    folder = judge.imported([ego(), far()], [far().assign(gt_id="2"), changing], frame='gt_id = "gt_id"\n')
    with pytest.raises(InputError, match=r"gt_id is '', the object's first row has 'ego'"):
        load_checked(folder)


def test_a_van_that_is_the_ego_may_be_named_so(judge: Judge) -> None:
    own = ego().assign(id="9", gt_id="ego", kind="van", length=3.0)
    sd = [far().assign(gt_id="2"), own]
    assert judge([ego(), far()], sd, frame='gt_id = "gt_id"\n') == {"GT": "PASS", "SD": "PASS"}


def test_no_repair_makes_the_ego_of_who_came_to_it(judge: Judge) -> None:
    """In the EGO's box for 91 % of its samples, and apart from it at first."""
    more = rows("9", 300.0 + SPEED * T, -5.25 + np.clip(2.9 - 3.0 * T, 0.5, None), v=SPEED)
    folder = judge.imported([ego(), far()], [far().assign(id="22"), more])
    recording = load_checked(folder, accept=tuple(CODES))
    (found,) = [f for f in recording.findings if f.code == "EGO_DETECTION"]
    assert (found.object, found.repair) == ("9", "")
    assert "own detection, or a colliding object?" in found.text


@pytest.mark.parametrize("size", [-12.0, 0.0])
def test_a_size_that_none_can_have_is_not_missing(judge: Judge, size: float) -> None:
    across = rows("1", 400.0, -0.75, length=size, width=2.5, heading=0.5 * np.pi, kind="unknown")
    with pytest.raises(InputError, match=rf"object '1'\): length is {size}, expected a size above 0 m"):
        judge.imported([ego(), far(), across])


def test_headings_in_degrees_are_not_wrapped_away_as_radians(judge: Judge) -> None:
    across = rows("1", 400.0, -9.75, length=12.0, width=2.5, heading=44.0, kind="truck")
    message = r"row 454: heading \(gt\.heading\) is '44\.0', expected radians from -6\.4 to 6\.4 \(in degrees"
    with pytest.raises(InputError, match=message):
        judge.imported([ego(), far(), across])


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_headings_that_count_the_turns_driven_are_taken(judge: Judge, unit: str) -> None:
    turn = 5.0 + 0.35 * T
    circle = {"x": 400.0 + 30.0 * np.sin(turn), "y": -60.0 - 30.0 * np.cos(turn), "v": 30.0 * 0.35}
    right = rows("1", **circle, heading=turn)
    wrong = rows("1", **circle, heading=turn[::-1])
    if unit == "deg":  # of 5 to 8.15 degrees, straight on
        right, wrong = far(), rows("2", 450.0 + SPEED * T, -1.75, v=SPEED, heading=turn)
    found = judge.folder / "rec"
    judge.imported([ego(), right])
    assert found.is_dir()
    with pytest.raises(InputError, match=r"expected radians from -6\.4 to 6\.4"):
        judge.imported([ego(), wrong])
