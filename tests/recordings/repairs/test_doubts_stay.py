"""What a repair makes of a drive is judged with the doubts that it had: PASS only where the truth passes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from resim.core.errors import InputError
from resim.metrics.criteria import freeze_criteria, read_criteria
from resim.resimulation import AssessmentOptions, assess_folder, repair_recording

LANE = (
    '<lane id="{}" type="driving" level="false"><link/><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
)
ROAD = """<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="s" north="0" south="0" east="0"
west="0"/><road name="r" length="900" id="1" junction="-1" rule="RHT"><link/><planView><geometry s="0" x="0" y="0"
hdg="0" length="900"><line/></geometry></planView><lanes><laneSection s="0"><center><lane id="0" type="none"
level="false"/></center><right>{}</right></laneSection></lanes></road></OpenDRIVE>"""
CRITERIA = """name = "c"
[[criterion]]
name = "collision"
measure = "collision"
above = 0.0
[[criterion]]
name = "TTC"
measure = "TTC"
below = 1.5
[[criterion]]
name = "gap"
measure = "gap ahead"
below = 5.0
"""
T = np.round(np.arange(0.0, 7.0001, 0.04), 6)
EGO_Y = -5.25
Frame = pd.DataFrame
Fault = Callable[[Frame], Frame]


def track(name: str, t: np.ndarray, x: np.ndarray, y: np.ndarray | float, **size: object) -> Frame:
    x, y = x + 0.0 * t, np.asarray(y) + 0.0 * t
    vx, vy = np.gradient(x, t), np.gradient(y, t)
    v = np.hypot(vx, vy)
    heading = np.where(v > 0.1, np.arctan2(vy, vx), 0.0)
    body = {"length": 4.7, "width": 1.9, "kind": "car"} | size
    return Frame({"t": t, "id": name, "x": x, "y": y, "heading": heading, "v": v, **body})


def drive(*tracks: Frame) -> Frame:
    ego, behind = track("ego", T, 100.0 + 20.0 * T, EGO_Y), track("B", T, 30.0 + 20.0 * T, EGO_Y)
    return pd.concat([ego, *tracks, behind]).sort_values("t", kind="stable").reset_index(drop=True)


def lead(brakes: float) -> Frame:
    """A car 40 m ahead that brakes at that time [s]."""
    v = np.maximum(20.0 - 8.0 * np.maximum(T - brakes, 0.0), 0.0)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(T))])
    return drive(track("c", T, 140.0 + way, EGO_Y))


WIDE = drive(track("c", T, 115.0 + 17.0 * T, EGO_Y + 2.2, width=2.6))
OUT = drive(
    track("c", T, 202.35 + 0.0 * T, EGO_Y - 3.5 + 3.5 * np.exp(-(((T - 4.9) / 0.9) ** 2)),
          length=0.5, width=0.6, kind="pedestrian")
)  # fmt: skip
BRAKES, ASIDE = lead(2.5), drive(track("c", T, 115.0 + 17.0 * T, EGO_Y + 3.5))


def rows(f: Frame, start: float, end: float) -> pd.Series:
    return (f["id"] == "c") & f["t"].between(start - 1e-6, end + 1e-6)


def put(f: Frame, start: float, end: float, **values: object) -> Frame:
    f = f.copy()
    for column, value in values.items():
        f.loc[rows(f, start, end), column] = value
    return f


def hidden(start: float, end: float) -> Fault:
    return lambda f: f[~rows(f, start, end)]


def steady(f: Frame) -> Frame:
    """Positions that a tracker goes on with at 20 m/s, while the speed is right."""
    f = f.copy()
    late = rows(f, 2.5, 9.0)
    f.loc[late, "x"] = f.loc[late, "x"].iloc[0] + 20.0 * (f.loc[late, "t"] - 2.52)
    return f


def other(f: Frame) -> Frame:
    """The lead is lost as it brakes, and another car is seen near its old way."""
    t = T[T >= 3.5]
    return pd.concat([f[~rows(f, 2.6, 9.0)], track("n", t, 142.5 + 20.0 * t, EGO_Y + 1.2)]).sort_values("t")


def doubled(f: Frame) -> Frame:
    """Every row is a duplicate, once as narrow as the car is not."""
    narrow = put(f, 0.0, 9.0, width=1.9)
    return pd.concat([narrow[rows(f, 0.0, 9.0)], f]).sort_values("t", kind="stable")


UNSAFE: dict[str, tuple[Frame, Fault, float]] = {
    "sizes": (WIDE, lambda f: put(f, 0.0, 6.0, width=1.9), 1.0),
    "sizes of doubles": (WIDE, doubled, 1.0),
    "swapped": (WIDE.assign(length=np.where(WIDE["id"] == "c", 1.9, 4.7)), lambda f: f, 1.0),
    "hole": (OUT, hidden(3.4, 6.4), 6.0),
    "values": (OUT, lambda f: put(f, 3.4, 6.4, x=np.nan, v=np.nan), 6.0),
    "values to the end": (BRAKES, lambda f: put(f, 2.6, 9.0, x=np.nan, y=np.nan), 1.0),
    "another": (BRAKES, other, 1.0),
    "extrapolated": (BRAKES, steady, 1.0),
}
"""Drives that break a limit, and faults that hide it; the longest gap [s] that is to be filled."""
SAFE: dict[str, Fault] = {
    "gap": hidden(3.0, 3.6),
    "speed unit": lambda f: f.assign(v=3.6 * f["v"]),
    "doubles": lambda f: pd.concat([f, f[rows(f, 3.0, 3.2)]]).sort_values("t", kind="stable"),
    "outlier": lambda f: put(f, 3.0, 3.0, y=EGO_Y + 7.5),
}


def written(folder: Path, frame: Frame) -> Path:
    folder.mkdir()
    (folder / "road.xodr").write_text(ROAD.format("".join(map(LANE.format, (-1, -2, -3)))))
    (folder / "recording.toml").write_text('name = "d"\nmap = "road.xodr"\nego = "ego"\n')
    frame.to_csv(folder / "gt.csv", index=False)
    (folder / "criteria.toml").write_text(CRITERIA)
    return folder


def verdicts(folder: Path, criteria: Path) -> dict[str, str]:
    how = AssessmentOptions(criteria=read_criteria(freeze_criteria(criteria)), only=())
    try:
        block = assess_folder(folder, how).blocks["GT"]
    except InputError:
        return {}
    return {name: v.outcome for name, v in block.verdicts.items()}


@pytest.mark.parametrize("name", UNSAFE)
def test_no_repair_passes_what_the_truth_fails(tmp_path: Path, name: str) -> None:
    truth, fault, max_gap = UNSAFE[name]
    whole = written(tmp_path / "truth", truth)
    faulty = written(tmp_path / "faulty", fault(truth))
    repair_recording(faulty, tmp_path / "fixed", max_gap=max_gap)
    true = verdicts(whole, whole / "criteria.toml")
    after = verdicts(tmp_path / "fixed", whole / "criteria.toml")
    assert after
    assert {n for n, v in after.items() if v == "PASS"} <= {n for n, v in true.items() if v == "PASS"}


@pytest.mark.parametrize("name", SAFE)
def test_what_is_repaired_for_sure_or_for_a_moment_passes(tmp_path: Path, name: str) -> None:
    faulty = written(tmp_path / "faulty", SAFE[name](ASIDE))
    _, repaired = repair_recording(faulty, tmp_path / "fixed")
    assert repaired.done
    assert set(verdicts(tmp_path / "fixed", faulty / "criteria.toml").values()) == {"PASS"}
