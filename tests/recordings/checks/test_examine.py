from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resim.core.finding import SEVERITIES, Finding
from resim.core.geometry import from_frame, to_frame
from resim.recordings import RecordingTables, read_commonroad
from resim.recordings.checks import CODES, examine
from resim.recordings.repairs import repair
from resim.road.opendrive import load

Read = Callable[[str], RecordingTables]
Look = Callable[[RecordingTables], tuple[Finding, ...]]

TRUE = {
    # the sensor derives speed over 1.6 s, so it is 0.8 s late where the object brakes
    "cut_in_brake": {("SPEED_DISAGREES", "sd", "1")},
    "rear_end": set(),
    "overtake": set(),
}


@pytest.mark.parametrize("name", TRUE)
def test_nothing_false_is_found_in_what_ships(tables: Read, look: Look, name: str) -> None:
    assert {(f.code, f.source, f.object) for f in look(tables(name))} == TRUE[name]


def test_a_late_speed_is_told_with_its_delay(tables: Read, look: Look) -> None:
    (late,) = look(tables("cut_in_brake"))
    assert "0.80 s late would explain it" in late.text
    assert (late.severity, late.unit) == ("note", "m/s")
    assert 3.5 < late.start < late.end < 9.3


Change = Callable[[pd.DataFrame], pd.DataFrame]


def own(frame: pd.DataFrame, name: str = "1") -> pd.Series:
    return frame["id"] == name


def late(frame: pd.DataFrame, t: float = 5.0) -> pd.Series:
    return frame["t"] > t


def put(frame: pd.DataFrame, rows: pd.Series, column: str, value: object) -> pd.DataFrame:
    out = frame.copy()
    out.loc[rows, column] = value
    return out


def add(frame: pd.DataFrame, rows: pd.Series, column: str, value: object) -> pd.DataFrame:
    return put(frame, rows, column, frame.loc[rows, column] + value)


def hold(frame: pd.DataFrame) -> pd.DataFrame:
    rows = own(frame) & (frame["t"] > 4.0) & (frame["t"] < 4.5)
    first = frame[rows].iloc[0]
    return put(put(frame, rows, "x", first["x"]), rows, "y", first["y"])


def backwards(frame: pd.DataFrame) -> pd.DataFrame:
    order = np.arange(len(frame))
    order[[40, 140]] = order[[140, 40]]
    return frame.iloc[order]


def exchanged(frame: pd.DataFrame) -> pd.DataFrame:
    swap = {"1": "2", "2": "1"}
    return frame.assign(
        id=[swap.get(i, i) if t > 5.0 else i for i, t in zip(frame["id"], frame["t"], strict=True)]
    )


def reused(frame: pd.DataFrame) -> pd.DataFrame:
    frame = frame[~(own(frame) & (frame["t"] > 5.0) & (frame["t"] < 6.0))]
    return add(frame, own(frame) & late(frame), "x", 60.0)


def driven(frame: pd.DataFrame, *, a: float = 0.0, turned: float = 0.0) -> pd.DataFrame:
    """Object 1 at another speed and heading from 5 s on, reached within 0.2 s, its positions with it."""
    rows = own(frame)
    part = frame[rows]
    ramp = np.clip((part["t"].to_numpy() - 5.0) / 0.2, 0.0, 1.0)
    v, h = part["v"].to_numpy() + 0.2 * a * ramp, part["heading"].to_numpy() + turned * ramp
    more = 0.04 * np.cumsum(
        v * np.exp(1j * h) - part["v"].to_numpy() * np.exp(1j * part["heading"].to_numpy())
    )
    for column, value in (("v", v), ("heading", h)):
        frame = put(frame, rows, column, value)
    return add(add(frame, rows, "x", more.real), rows, "y", more.imag)


def doubled(frame: pd.DataFrame) -> pd.DataFrame:
    ghost = add(frame[own(frame, "3")], own(frame, "3")[own(frame, "3")], "x", 1.0)
    return pd.concat([frame, ghost.assign(id="9")]).sort_values("t", kind="stable")


def cornered(frame: pd.DataFrame) -> pd.DataFrame:
    along = 0.5 * frame["length"] * np.cos(frame["heading"])
    return frame.assign(x=frame["x"] - along, y=frame["y"] - 0.5 * frame["length"] * np.sin(frame["heading"]))


def returned(frame: pd.DataFrame) -> pd.DataFrame:
    rows = own(frame, "3")
    return put(put(frame, rows, "x", frame.loc[rows, "x"].to_numpy()[::-1]), rows, "heading", np.pi)


def degrees(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.assign(heading=np.degrees(frame["heading"]))


# code, source, object, change; planted in `overtake`
PLANTS: tuple[tuple[str, str, str, Change], ...] = (
    ("MISSING_VALUES", "gt", "1", lambda f: put(f, own(f) & (f["t"] == 3.0), "x", np.nan)),
    ("MISSING_SAMPLES", "sd", "1", lambda f: f[~(own(f) & f["t"].between(3.0, 3.1))]),
    ("GAP", "gt", "2", lambda f: f[~(own(f, "2") & f["t"].between(3.0, 4.0))]),
    ("GAP", "sd", "", lambda f: f[~f["t"].between(3.0, 4.0)]),
    ("DUPLICATE_SAMPLES", "gt", "1", lambda f: pd.concat([f, f[own(f) & (f["t"] == 3.0)]])),
    ("REPEATED_SAMPLES", "gt", "1", hold),
    ("TIME_BACKWARDS", "sd", "ego", backwards),
    ("CLOCK_JUMP", "gt", "", lambda f: add(f, late(f), "t", 0.3)),
    ("CLOCK_JUMP", "sd", "", lambda f: add(f, late(f), "t", -0.3)),
    ("CLOCK_DRIFT", "sd", "", lambda f: f.assign(t=1.05 * f["t"])),
    ("CLOCK_OFFSET", "sd", "", lambda f: f.assign(t=f["t"] + 0.6)),
    ("CLOCK_OFFSET", "gt", "1", lambda f: add(f, own(f), "t", 0.6).sort_values("t", kind="stable")),
    ("ID_REUSED", "gt", "1", reused),
    ("ID_SWITCH", "gt", "1", exchanged),
    ("TRACK_BROKEN", "gt", "1", lambda f: put(f, own(f) & late(f), "id", "9")),
    ("POSITION_JUMP", "gt", "1", lambda f: add(f, own(f) & late(f), "x", 5.0)),
    ("OUTLIER", "sd", "1", lambda f: add(f, own(f) & (f["t"] == 3.0), "y", 4.0)),
    ("SPEED_DISAGREES", "gt", "1", lambda f: put(f, own(f), "v", 0.8 * f["v"])),
    ("HEADING_DISAGREES", "gt", "1", lambda f: add(f, own(f), "heading", 0.2)),
    ("ACCELERATION", "gt", "1", lambda f: driven(f, a=-25.0)),
    ("YAW_RATE", "gt", "1", lambda f: driven(f, turned=0.3)),
    ("OVERLAP", "gt", "3", doubled),
    ("SIZE_CHANGES", "gt", "1", lambda f: put(f, own(f) & late(f), "length", 6.0)),
    ("SIZE_IMPOSSIBLE", "gt", "1", lambda f: f.assign(**{c: f[c].where(~own(f), 0.1) for c in ("length", "width")})),
    ("SIZE_IMPOSSIBLE", "sd", "", lambda f: f.assign(length=0.01, width=0.01)),
    ("SIZE_IMPOSSIBLE", "gt", "2", lambda f: put(f, own(f, "2"), "length", 500.0)),
    ("SIZE_SWAPPED", "gt", "", lambda f: f.assign(length=f["width"], width=f["length"])),
    ("SIZE_SWAPPED", "sd", "2", lambda f: put(put(f, own(f, "2"), "length", 1.9), own(f, "2"), "width", 4.7)),
    ("OFF_MAP", "gt", "3", lambda f: add(f, own(f, "3"), "y", -40.0)),
    ("WRONG_WAY", "gt", "3", returned),
    ("REFERENCE_POINT", "recording", "ego", cornered),
    ("TIME_UNIT", "gt", "", lambda f: f.assign(t=1e3 * f["t"])),
    ("TIME_UNIT", "sd", "", lambda f: f.assign(t=1e6 * f["t"], v=3.6 * f["v"])),
    ("EGO_DETECTION", "sd", "ego", lambda f: put(f, own(f, "ego"), "gt_id", "")),
    ("SPEED_UNIT", "gt", "", lambda f: f.assign(v=3.6 * f["v"])),
    ("SPEED_UNIT", "sd", "2", lambda f: put(f, own(f, "2"), "v", 2.237 * f["v"])),
    ("HEADING_UNIT", "gt", "", degrees),
    ("HEADING_TURNED", "gt", "", lambda f: f.assign(heading=f["heading"] + np.pi)),
    ("HEADING_CONVENTION", "sd", "", lambda f: f.assign(heading=0.5 * np.pi - f["heading"])),
    ("MIRRORED_Y", "gt", "", lambda f: f.assign(y=-f["y"], heading=-f["heading"])),
    ("SENSOR_OFFSET", "sd", "2", lambda f: add(f, own(f, "2"), "y", -2.5)),
    ("HEIGHT", "gt", "", lambda f: f.assign(z=3.0)),
    ("SD_WITHOUT_GT", "sd", "2", lambda f: put(f, own(f, "2"), "gt_id", "")),
)  # fmt: skip


@pytest.mark.parametrize(
    ("code", "source", "name", "change"), PLANTS, ids=[f"{p[0]}-{p[1]}-{p[2]}" for p in PLANTS]
)
def test_a_planted_fault_is_found_where_it_is(
    tables: Read, look: Look, code: str, source: str, name: str, change: Change
) -> None:
    before = tables("overtake")
    table = "sd" if source == "sd" else "gt"
    frame = change(getattr(before, table)).reset_index(drop=True)
    findings = look(replace(before, **{table: frame}))
    hit = [f for f in findings if (f.code, f.source, f.object) == (code, source, name)]
    assert hit, [(f.code, f.source, f.object, f.text) for f in findings]
    assert hit[0].meaning == CODES[code].meaning
    assert hit[0].unit or code.endswith("UNIT")


@pytest.mark.parametrize(("sign", "own", "other"), [(1.0, "front", "rear"), (-1.0, "rear", "front")])
def test_a_reference_point_may_be_that_of_either_table(
    tables: Read, look: Look, sign: float, own: str, other: str
) -> None:
    def moved(frame: pd.DataFrame, by: float) -> pd.DataFrame:
        half = 0.5 * by * frame["length"]
        return frame.assign(
            x=frame["x"] + half * np.cos(frame["heading"]), y=frame["y"] + half * np.sin(frame["heading"])
        )

    before = tables("cut_in_brake")  # speeds differ: no delay explains it
    for changed in (replace(before, sd=moved(before.sd, sign)), replace(before, gt=moved(before.gt, -sign))):
        (hit, *_) = [f for f in look(changed) if f.code == "REFERENCE_POINT"]
        assert f"SD names its {own} bumper, or GT its {other} bumper" in hit.text
        assert ("ahead" if sign > 0.0 else "behind") in hit.text
        assert hit.text.endswith("early" if sign > 0.0 else "late")


def test_every_code_has_a_plant() -> None:
    assert {p[0] for p in PLANTS} == set(CODES)


CAUSES = {
    "speeds in km/h are not accelerations": ("gt", lambda f: f.assign(v=3.6 * f["v"]), {"SPEED_UNIT"}),
    "a clock jump is no speed fault": ("gt", lambda f: add(f, late(f), "t", 0.3), {"CLOCK_JUMP"}),
    "a mirrored frame is no wrong way": ("gt", lambda f: f.assign(y=-f["y"]), {"MIRRORED_Y"}),
    "milliseconds are no wrong speeds": ("sd", lambda f: f.assign(t=1e3 * f["t"]), {"TIME_UNIT"}),
    "its own detection is no overlap": (
        "sd",
        lambda f: put(f, own(f, "ego"), "gt_id", "").assign(x=lambda g: g["x"] + 0.5 * own(g, "ego")),
        {"EGO_DETECTION"},
    ),
    "a reused id is no gap": ("gt", reused, {"ID_REUSED"}),
    "degrees are no yaw rate": ("gt", degrees, {"HEADING_UNIT"}),
    "a held position is no jump": ("gt", hold, {"REPEATED_SAMPLES"}),
    "a late clock is no reference point": ("sd", lambda f: f.assign(t=f["t"] + 0.6), {"CLOCK_OFFSET"}),
}


@pytest.mark.parametrize("case", CAUSES)
def test_the_cause_is_told_and_not_its_symptoms(tables: Read, look: Look, case: str) -> None:
    table, change, codes = CAUSES[case]
    before = tables("overtake")
    found = look(replace(before, **{table: change(getattr(before, table)).reset_index(drop=True)}))
    assert {f.code for f in found} == codes


def test_milliseconds_are_told_where_speeds_came_of_them(tables: Read, look: Look) -> None:
    before = tables("overtake")
    (hit,) = [f for f in look(replace(before, gt=before.gt.assign(t=1e3 * before.gt["t"], v=1e-3 * before.gt["v"])))
              if f.code == "TIME_UNIT"]  # fmt: skip
    assert (hit.severity, hit.repair, hit.source) == ("error", "", "gt")
    assert "is t in ms?" in hit.text


def test_who_hits_the_ego_is_not_taken_for_it(tables: Read, look: Look) -> None:
    """It lies on the EGO in all of its samples, of a collision of 2 s: an error, and nothing repairs it away."""
    before = tables("overtake")
    assert before.sd is not None
    hit = before.sd[own(before.sd, "ego") & (before.sd["t"] < 2.0)].assign(
        id="77", gt_id="", y=lambda f: f["y"] + 1.0
    )
    tables_hit = replace(
        before, sd=pd.concat([before.sd, hit], ignore_index=True).sort_values("t", kind="stable")
    )
    (told,) = [f for f in look(tables_hit) if f.code == "EGO_DETECTION"]
    assert (told.object, told.severity, told.repair) == ("77", "error", "")
    assert "or a colliding object?" in told.text
    near = hit.assign(y=lambda f: f["y"] + 2.5)
    beside = replace(
        before, sd=pd.concat([before.sd, near], ignore_index=True).sort_values("t", kind="stable")
    )
    assert "EGO_DETECTION" not in {f.code for f in look(beside)}


def test_who_drives_against_his_lane_or_off_the_map_is_compared_all_the_same(
    tables: Read, look: Look
) -> None:
    before = tables("overtake")
    assert before.sd is not None
    for change in (returned, lambda f: add(f, own(f, "3"), "y", -40.0)):
        gt, sd = change(before.gt), change(before.sd)
        assert {f.code for f in look(replace(before, gt=gt, sd=sd))} <= {"WRONG_WAY", "OFF_MAP"}
        far = look(replace(before, gt=gt, sd=add(sd, own(sd, "3"), "y", 30.0)))
        (hit, *_) = [f for f in far if f.code in ("SD_WITHOUT_GT", "SENSOR_OFFSET")]
        assert (hit.severity, hit.object, hit.value) == ("error", "3", pytest.approx(30.0, abs=2.0))


def test_a_sensor_that_has_objects_in_another_lane_is_told(tables: Read, look: Look) -> None:
    before = tables("overtake")
    assert before.sd is not None
    sd = before.sd
    for names, told, size in (({"1"}, "1", 3.5), ({"1", "2", "3"}, "", 3.5), ({"ego"}, "ego", 1.5)):
        found = look(replace(before, sd=add(sd, sd["id"].isin(names), "y", -size)))
        (hit,) = [f for f in found if f.code == "SENSOR_OFFSET"]
        assert (hit.severity, hit.object) == ("warning", told)
        assert hit.value == pytest.approx(size, abs=0.4 if told == "ego" else 1.0)
        assert f"{hit.text.split(' m to the right')[0].split()[-1]}" in {
            f"{size - 0.2:.1f}",
            f"{size - 0.3:.1f}",
        }


def test_a_sensor_that_strays_for_a_while_only_is_told(tables: Read, look: Look) -> None:
    before = tables("overtake")
    assert before.sd is not None
    sd = before.sd
    bump = -3.0 * np.sin(0.25 * np.pi * (sd["t"].clip(3.0, 7.0) - 3.0)) ** 2
    (hit,) = [f for f in look(replace(before, sd=add(sd, own(sd), "y", bump))) if f.code == "SENSOR_OFFSET"]
    assert hit.object == "1"
    assert 3.0 <= hit.start < hit.end <= 7.0


def test_a_delay_that_sensors_have_is_a_note(tables: Read, look: Look) -> None:
    before = tables("overtake")
    assert before.sd is not None
    (late_sd,) = look(replace(before, sd=before.sd.assign(t=before.sd["t"] + 0.24)))
    assert (late_sd.code, late_sd.severity, late_sd.source) == ("CLOCK_OFFSET", "note", "sd")
    assert late_sd.value == pytest.approx(0.24, abs=0.06)


def test_worst_comes_first_and_the_same_comes_again(tables: Read, look: Look) -> None:
    before = tables("overtake")
    frame = add(before.gt, own(before.gt) & late(before.gt), "x", 30.0)
    frame = frame[~(own(frame, "2") & frame["t"].between(3.0, 3.1))]
    faulty = replace(before, gt=add(frame, own(frame, "3") & (frame["t"] == 7.0), "y", 3.0))
    findings = look(faulty)
    assert [f.code for f in findings] == ["POSITION_JUMP", "OUTLIER", "MISSING_SAMPLES"]
    ranks = [SEVERITIES.index(f.severity) for f in findings]
    assert ranks == sorted(ranks)
    assert look(faulty) == findings


def test_reversing_and_standing_are_no_faults(tables: Read) -> None:
    t = np.arange(0.0, 10.0, 0.1)
    v = np.where(t < 4.0, 0.0, -1.5)
    rest = pd.DataFrame({"t": t, "id": "ego", "x": 10.0 + np.cumsum(v) * 0.1, "y": 0.0, "heading": 0.3, "v": v,
                         "length": 4.7, "width": 1.9, "kind": "car"})  # fmt: skip
    rest["x"], rest["y"] = 10.0 + np.cumsum(v) * 0.1 * np.cos(0.3), np.cumsum(v) * 0.1 * np.sin(0.3)
    assert examine(replace(tables("overtake"), gt=rest, sd=None), None) == ()


@settings(deadline=None, max_examples=12)
@given(st.data())
def test_no_table_that_can_be_read_makes_it_fail(tables: Read, look: Look, data: st.DataObject) -> None:
    before = tables("rear_end")
    rng = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    frames = {}
    for name in ("gt", "sd"):
        frame = getattr(before, name)
        frame = frame.sample(
            n=data.draw(st.integers(1, 60)), replace=True, random_state=int(rng.integers(10**6))
        )
        frame = frame.copy()
        for column in ("x", "y", "heading", "v", "t"):
            kind = data.draw(st.sampled_from(["as is", "noise", "one", "huge", "nan"]))
            if kind == "noise":
                frame[column] += rng.normal(0.0, 10.0, len(frame))
            elif kind == "one":
                frame[column] = 0.0
            elif kind == "huge":
                frame[column] *= 1e6
            elif kind == "nan" and column != "t":
                frame[column] = np.where(rng.random(len(frame)) < 0.5, np.nan, frame[column])
        frames[name] = frame.reset_index(drop=True)
    findings = look(replace(before, **frames))
    assert all(f.code in CODES and "\n" not in f.text for f in findings)


def delayed(frame: pd.DataFrame, by: float) -> pd.DataFrame:
    return frame.assign(t=frame["t"] + by)


@pytest.mark.parametrize("name", ["cut_in_brake", "rear_end", "overtake"])
@pytest.mark.parametrize("by", [0.1, 0.12])
def test_a_usual_sensor_delay_is_told_once_and_stops_nothing(
    tables: Read, look: Look, name: str, by: float
) -> None:
    before = tables(name)
    assert before.sd is not None
    new = [f for f in look(replace(before, sd=delayed(before.sd, by))) if f.code != "SPEED_DISAGREES"]
    assert [(f.code, f.object) for f in new] == [("CLOCK_OFFSET", "")]
    assert new[0].severity in ("note", "warning")
    assert new[0].value == pytest.approx(by, abs=0.03)


def test_a_reference_point_is_told_from_a_delay_where_speeds_differ(tables: Read, look: Look) -> None:
    before = tables("cut_in_brake")
    assert before.sd is not None
    sd, half = before.sd, 0.5 * before.sd["length"]
    behind = sd.assign(x=sd["x"] - half * np.cos(sd["heading"]), y=sd["y"] - half * np.sin(sd["heading"]))
    found = look(replace(before, sd=behind))
    assert {(f.code, f.severity) for f in found if f.object == "ego"} == {("REFERENCE_POINT", "error")}
    assert not [f for f in found if f.code == "CLOCK_OFFSET"]


def driven_around(before: RecordingTables, seed: int, late: float = 0.0, off: str = "") -> RecordingTables:
    """Three cars around an EGO at 25 m/s, and what a sensor says of them that is so late [s], or names a bumper: always
    the "rear" one, or the one that it "sees"."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 10.0, 0.04)
    row = (
        before.gt[own(before.gt, "ego")].iloc[[0] * len(t)].assign(y=0.0, heading=0.0, length=4.7, kind="car")
    )
    ego = row.assign(t=t, x=25.0 * t, v=25.0, id="ego")
    gt, sd = [ego], [ego.assign(gt_id="ego")]
    for k in range(3):
        v0, a, w, p = rng.uniform(19, 31), rng.uniform(2, 4), rng.uniform(0.7, 1.5), rng.uniform(0, 6)
        begin, y = rng.uniform(-40.0, 60.0) + 40.0 * k, 3.5 * k + 3.5
        x, far = (begin + v0 * s - a / w * np.cos(w * s + p) for s in (t, t - late))
        v = v0 + a * np.sin(w * t + p)
        bumper = {"": 0.0, "rear": -1.0, "seen": -np.sign(x - ego["x"].to_numpy())}[off]
        gt.append(row.assign(t=t, x=x, y=y, v=v, id=f"c{k}"))
        noisy = far + 2.35 * bumper + rng.normal(0.0, 0.1, len(t))
        sd.append(row.assign(t=t, x=noisy, y=y, v=v, id=f"c{k}", gt_id=f"c{k}"))
    both = (pd.concat(parts).sort_values("t", kind="stable").reset_index(drop=True) for parts in (gt, sd))
    return replace(before, gt=next(both), sd=next(both))


def test_a_latency_of_all_but_the_ego_is_told_once_and_stops_nothing(tables: Read) -> None:
    told = [examine(driven_around(tables("overtake"), seed, 0.12), None) for seed in range(3)]
    assert [[(f.code, f.severity, f.object) for f in found] for found in told] == [
        [("CLOCK_OFFSET", "note", "")]
    ] * 3
    assert [found[0].value for found in told] == pytest.approx([0.12] * 3, abs=0.03)


@pytest.mark.parametrize("off", ["rear", "seen"])
def test_a_bumper_is_no_latency_of_all_but_the_ego(tables: Read, off: str) -> None:
    for seed in range(12):
        found = examine(driven_around(tables("overtake"), seed, off=off), None)
        assert "CLOCK_OFFSET" not in {f.code for f in found}, seed
        assert off == "seen" or "REFERENCE_POINT" in {f.code for f in found if f.severity == "error"}, seed


@pytest.mark.parametrize("off", [0.06, 0.15, 0.3])
def test_a_pedestrian_is_too_small_for_a_reference_point(tables: Read, look: Look, off: float) -> None:
    before = tables("overtake")
    assert before.sd is not None

    def walking(frame: pd.DataFrame, by: float) -> pd.DataFrame:
        rows = own(frame, "3")
        out = frame.assign(kind=frame["kind"].where(~rows, "pedestrian"))
        for column, value in (("length", 0.5), ("width", 0.6), ("v", 1.4), ("heading", 0.0), ("y", -15.0)):
            out = put(out, rows, column, value)
        return put(out, rows, "x", 300.0 + 1.4 * frame.loc[rows, "t"] + by)

    found = look(replace(before, gt=walking(before.gt, 0.0), sd=walking(before.sd, off)))
    assert "REFERENCE_POINT" not in {f.code for f in found}


CONVENTIONS: dict[str, tuple[str, Callable[[np.ndarray], np.ndarray]]] = {
    "degrees": ("HEADING_UNIT", np.degrees),
    "turned by pi": ("HEADING_TURNED", lambda h: h + np.pi),
    "turned the other way": ("HEADING_TURNED", lambda h: h - np.pi),
    "turned by 180 degrees": ("HEADING_TURNED", lambda h: np.degrees(h) + 180.0),
    "clockwise from north": ("HEADING_CONVENTION", lambda h: 0.5 * np.pi - h),
    "clockwise from north in degrees": ("HEADING_CONVENTION", lambda h: np.degrees(0.5 * np.pi - h) % 360.0),
    "anticlockwise from north": ("HEADING_CONVENTION", lambda h: h - 0.5 * np.pi),
    "clockwise from +x": ("HEADING_CONVENTION", lambda h: -h),
}


@pytest.mark.parametrize("name", CONVENTIONS)
@pytest.mark.parametrize("table", ["gt", "sd"])
@pytest.mark.parametrize("turned", [0.0, -0.6])
def test_conventions_of_headings_are_told_apart_and_repaired(
    tables: Read, table: str, name: str, turned: float
) -> None:
    """On a straight road to the east, and to the south-east, where each convention is another one."""
    code, convention = CONVENTIONS[name]
    if turned == 0.0 and name == "clockwise from +x":
        return  # the same there
    before = tables("cut_in_brake")
    c, s = np.cos(turned), np.sin(turned)
    frames = {
        n: f.assign(x=c * f["x"] - s * f["y"], y=s * f["x"] + c * f["y"], heading=f["heading"] + turned)
        for n, f in (("gt", before.gt), ("sd", before.sd))
    }
    good = replace(before, **frames)
    bad = replace(
        good, **{table: frames[table].assign(heading=convention(frames[table]["heading"].to_numpy()))}
    )
    if (name, table, turned) == (
        "degrees",
        "sd",
        0.0,
    ):  # no more than 0.03 rad off: noise in radians looks like that
        (one,) = (f for f in examine(bad, None) if f.code == code)
        assert (one.severity, one.repair) == ("warning", "")
        return
    found = [f for f in examine(bad, None) if f.severity == "error"]
    assert [(f.code, f.source, f.object) for f in found] == [(code, table, "")], [f.text for f in found]
    again = getattr(repair(bad, None).tables, table)["heading"].to_numpy()
    off = again - frames[table]["heading"].to_numpy()
    assert np.abs(np.angle(np.exp(1j * off))).max() < 1e-9


def drifting(frame: pd.DataFrame, slip: float, kept: float = 2.0) -> pd.DataFrame:
    """Object 3 goes straight on at 15 m/s; from `kept` s on its heading swings by `slip` [rad] off its course."""
    rows = own(frame, "3")
    t = frame.loc[rows, "t"]
    out = put(put(put(frame, rows, "v", 15.0), rows, "x", 300.0 + 15.0 * t), rows, "y", -12.25)
    return put(out, rows, "heading", np.where(t > kept, slip * np.abs(np.sin(t - kept)), 0.0))


@pytest.mark.parametrize("slip", [0.4, 0.6, 0.8])
def test_the_headings_of_who_skids_are_not_divided_by_57(tables: Read, look: Look, slip: float) -> None:
    before = tables("overtake")
    found = look(replace(before, gt=drifting(before.gt, slip)))
    about = [f for f in found if f.object == "3" and f.code.startswith("HEADING")]
    assert [(f.code, f.severity, f.repair) for f in about] == [("HEADING_UNIT", "warning", "")]
    assert about[0].text.endswith("the course cannot decide")


def test_the_heading_of_who_skids_for_a_while_is_not_taken_from_the_positions(
    tables: Read, look: Look
) -> None:
    before = tables("overtake")
    brief = drifting(before.gt, 0.4, kept=float(before.gt["t"].max()) - 2.0)
    (hit,) = [f for f in look(replace(before, gt=brief)) if f.object == "3" and f.code.startswith("HEADING")]
    assert (hit.code, hit.severity, hit.repair) == ("HEADING_DISAGREES", "warning", "")
    rows = own(brief, "3") & (brief["t"] > float(before.gt["t"].max()) - 2.0)
    leaps = put(brief, rows, "heading", 0.3)
    (hit,) = [f for f in look(replace(before, gt=leaps)) if f.object == "3" and f.code.startswith("HEADING")]
    assert (hit.code, bool(hit.repair)) == ("HEADING_DISAGREES", True)


def test_one_heading_in_degrees_is_sure_where_it_follows_the_course(tables: Read, look: Look) -> None:
    before = tables("cut_in_brake")  # 1 changes lanes
    gt = put(before.gt, own(before.gt), "heading", np.degrees(before.gt["heading"]))
    (hit,) = [f for f in look(replace(before, gt=gt)) if f.code.startswith("HEADING")]
    assert (hit.code, hit.object, hit.severity) == ("HEADING_UNIT", "1", "error")
    assert hit.repair


def test_one_vehicle_that_drives_against_its_lane_does_not_turn_the_map(tables: Read, look: Look) -> None:
    before = tables("rear_end")
    alone = before.gt[before.gt["id"] == "ego"]
    against = alone.assign(heading=alone["heading"] + np.pi, x=2.0 * alone["x"].mean() - alone["x"])
    codes = {f.code for f in look(replace(before, gt=against, sd=None))}
    assert "WRONG_WAY" in codes
    assert "MIRRORED_Y" not in codes


def test_speeds_that_are_wrong_by_chance_have_no_unit(tables: Read, look: Look) -> None:
    before = tables("overtake")
    rows = own(before.gt)
    swing = 3.6 + 1.6 * np.sin(2.0 * before.gt["t"])
    found = look(replace(before, gt=put(before.gt, rows, "v", swing * before.gt["v"])))
    assert "SPEED_UNIT" not in {f.code for f in found}
    assert "SPEED_DISAGREES" in {f.code for f in found}


def test_one_heading_that_is_turned_is_found(tables: Read, look: Look) -> None:
    before = tables("overtake")
    for by in (np.pi, -np.pi):
        faulty = replace(before, gt=add(before.gt, own(before.gt), "heading", by))
        assert [(f.code, f.source, f.object) for f in look(faulty)] == [("HEADING_TURNED", "gt", "1")]


NGSIM = Path(__file__).parents[3].parent / "shared" / "data" / "ngsim"


def real(name: str, ego: str) -> RecordingTables:
    return RecordingTables.of(read_commonroad(NGSIM / f"{name}.xml", map=NGSIM / f"{name}.xodr", ego=ego))


def sensed(gt: pd.DataFrame, seed: int = 0) -> pd.DataFrame:
    """GT as a sensor sees it: 5 cm of noise, and each object up to 0.3 m off."""
    rng = np.random.default_rng(seed)
    bias = {name: rng.normal(0.0, 0.15, 2) for name in dict.fromkeys(gt["id"])}
    noise = rng.normal(0.0, 0.05, (2, len(gt)))
    off = np.array([bias[name] for name in gt["id"]]).T + noise
    return gt.assign(x=gt["x"] + off[0], y=gt["y"] + off[1])


def short_tracks(before: RecordingTables) -> pd.DataFrame:
    """The EGO for 40 s, and every second another car for 4 s: they brake and accelerate, each in its own way."""
    row = before.gt[own(before.gt, "ego")].iloc[0]
    parts = []
    for k in range(-1, 37):
        t = np.arange(0.0 if k < 0 else k, 40.0 if k < 0 else k + 4.0, 0.04).round(3)
        v = 14.0 + 4.0 * np.sin(0.9 * t + 1.3 * k)
        way = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * 0.04)])
        told = {"t": t, "x": 300.0 + 25.0 * (k + 1) + way, "y": -1.75 - 3.5 * (k % 2), "heading": 0.0, "v": v}
        parts.append(pd.DataFrame({**row.to_dict(), **told, "id": "ego" if k < 0 else f"c{k}"}))
    return pd.concat(parts, ignore_index=True).sort_values(["t", "id"], ignore_index=True)


@pytest.mark.parametrize("rate", [0.02, -0.02])
@pytest.mark.parametrize("source", ["gt", "sd"])
def test_a_drift_is_found_in_short_tracks_of_our_own(tables: Read, rate: float, source: str) -> None:
    """2 %, of which no track alone shows enough."""
    before = tables("overtake")
    gt = short_tracks(before)
    clean = replace(before, gt=gt, sd=sensed(gt))
    codes = {f.code for f in examine(clean, None)}
    assert "CLOCK_DRIFT" not in codes
    frame = gt if source == "gt" else clean.sd
    assert frame is not None
    found = examine(replace(clean, **{source: frame.assign(t=(1.0 + rate) * frame["t"])}), None)
    drifts = [f for f in found if f.code == "CLOCK_DRIFT"]
    assert [(f.severity, f.object) for f in drifts] == [("error", "")]
    assert abs(drifts[0].value) == pytest.approx(0.02 * 40.0, rel=0.15)


needs_ngsim = pytest.mark.skipif(not NGSIM.is_dir(), reason="needs the NGSIM scenarios beside the project")


@needs_ngsim
@pytest.mark.parametrize("rate", [0.02, -0.02])
@pytest.mark.parametrize("source", ["gt", "sd"])
@pytest.mark.slow
def test_a_drift_is_found_in_real_traffic_of_short_tracks(rate: float, source: str) -> None:
    """2 % on US-101, tracks of which hardly one is there for all of it: each cut to its 4 s."""
    before = real("USA_US101-22_1_T-1", "659")
    begins = before.gt.groupby("id")["t"].transform("min")
    gt = before.gt[(before.gt["t"] - begins <= 4.0) | (before.gt["id"] == "659")]
    clean = replace(before, gt=gt, sd=sensed(gt))
    assert [f for f in examine(clean, None) if f.severity == "error"] == []
    frame = clean.gt if source == "gt" else clean.sd
    assert frame is not None
    found = examine(replace(clean, **{source: frame.assign(t=(1.0 + rate) * frame["t"])}), None)
    drifts = [f for f in found if f.code == "CLOCK_DRIFT"]
    assert [(f.severity, f.object) for f in drifts] == [("error", "")]
    lasts = float(frame["t"].max() - frame["t"].min())
    assert abs(drifts[0].value) == pytest.approx(abs(rate) * lasts, rel=0.15)


@needs_ngsim
def test_a_delay_is_found_in_real_traffic(look: Look) -> None:
    before = real("USA_US101-22_1_T-1", "659")
    late_sd = replace(before, sd=delayed(sensed(before.gt), 0.1))
    found = [
        f for f in examine(late_sd, None) if f.code in ("CLOCK_OFFSET", "REFERENCE_POINT", "CLOCK_DRIFT")
    ]
    assert [(f.code, f.severity, f.object) for f in found] == [("CLOCK_OFFSET", "note", "")]
    assert found[0].value == pytest.approx(0.1, abs=0.02)


def test_tracks_that_are_shifted_to_start_together_are_an_error(tables: Read, look: Look) -> None:
    """Ten cars that enter one after another, every 2 s in one of two lanes."""
    before = tables("overtake")
    one = before.gt[own(before.gt, "ego")]
    many = [
        one.assign(id=f"c{k}", t=one["t"] + 1.0 * k, y=one["y"] + 3.5 * (k % 2), v=one["v"])
        for k in range(10)
    ]
    gt = pd.concat([one.assign(t=one["t"] + 20.0), *many]).sort_values("t", kind="stable")
    gt = gt[gt["t"] < 25.0].reset_index(drop=True)
    right = replace(before, gt=gt, sd=None)
    assert "OVERLAP" not in {f.code for f in look(right)}
    together = gt.assign(t=np.round(gt["t"] - gt.groupby("id")["t"].transform("min"), 6))
    found = look(replace(right, gt=together.sort_values("t", kind="stable")))
    assert ("OVERLAP", "error", "") in {(f.code, f.severity, f.object) for f in found}
    assert sum(f.code == "OVERLAP" and f.severity == "error" for f in found) == 1


@pytest.mark.parametrize(("vehicles", "severity"), [(1, "warning"), (2, "warning"), (3, "error")])
def test_few_that_drive_on_the_wrong_side_are_no_mirror(
    tables: Read, tmp_path: Path, vehicles: int, severity: str
) -> None:
    """Where both sides of the road lie alike, these may be right as they stand."""
    lanes = "".join(
        f'<{side}><lane id="{n}" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></{side}>'
        for side, n in (("left", 1), ("right", -1))
    )
    path = tmp_path / "straight.xodr"
    path.write_text(
        '<OpenDRIVE><road id="1" junction="-1"><planView><geometry s="0" x="0" y="0" hdg="0" length="500"><line/>'
        f'</geometry></planView><lanes><laneSection s="0">{lanes}</laneSection></lanes></road></OpenDRIVE>'
    )
    t = np.arange(0.0, 5.01, 0.1)
    frames = [
        pd.DataFrame(
            {"t": t, "id": name, "x": 20.0 + 60.0 * n + v * t, "y": 1.75, "heading": 0.0, "v": v, "length": length,
             "width": 1.8, "kind": kind}
        )
        for n, (name, v, length, kind) in enumerate(
            [("b", 5.0, 1.8, "bicycle"), ("ego", 15.0, 4.5, "car"), ("c", 15.0, 4.5, "car"), ("d", 15.0, 4.5, "truck")][
                : vehicles + 1
            ]
        )
    ]  # fmt: skip
    gt = pd.concat(frames).sort_values("t", kind="stable").reset_index(drop=True)
    before = tables("overtake")
    settings = before.settings.model_copy(update={"ego": "ego"})
    findings = examine(replace(before, gt=gt, sd=None, settings=settings), load(path))
    (hit,) = [f for f in findings if f.code == "MIRRORED_Y"]
    assert (hit.severity, bool(hit.repair)) == (severity, severity == "error")


@pytest.mark.parametrize("name", ["cut_in_brake", "overtake"])
def test_a_list_whose_left_is_right_in_the_egos_frame_is_mirrored(
    tables: Read, look: Look, name: str
) -> None:
    """Not one whose places are far off: what would have been told as offsets."""
    before = tables(name)
    assert before.sd is not None
    ego = before.gt[before.gt["id"] == before.settings.ego]
    t = before.sd["t"]
    x, y, h = (np.interp(t, ego["t"], ego[c]) for c in ("x", "y", "heading"))
    ahead, left = to_frame(before.sd["x"].to_numpy(), before.sd["y"].to_numpy(), x, y, h)
    at = from_frame(ahead, -left, x, y, h)
    turned = before.sd.assign(x=at[0], y=at[1], heading=2.0 * h - before.sd["heading"])
    found = look(replace(before, sd=turned))
    (hit,) = [f for f in found if f.code == "MIRRORED_Y"]
    assert (hit.source, hit.severity, hit.repair) == ("sd", "error", "")
    assert "SENSOR_OFFSET" not in {f.code for f in found}


@pytest.mark.parametrize("noise", [0.02, 0.05, 0.1, 0.2])
def test_noisy_headings_on_a_straight_road_are_not_degrees(tables: Read, look: Look, noise: float) -> None:
    before = tables("overtake")
    assert before.sd is not None
    heading = before.sd["heading"] + np.random.default_rng(1).normal(0.0, noise, len(before.sd))
    found = look(replace(before, sd=before.sd.assign(heading=heading)))
    assert [f.text for f in found if f.severity == "error"] == []


def test_a_convention_that_the_course_cannot_tell_is_not_repaired(tables: Read) -> None:
    """To the north, on a map whose north is 2.5 degrees off true north, compasses turn either way for all one knows."""
    before = tables("cut_in_brake")
    turned = {
        name: frame.assign(x=-frame["y"], y=frame["x"], heading=frame["heading"] + 0.5 * np.pi)
        for name, frame in (("gt", before.gt), ("sd", before.sd))
    }
    compass = turned["gt"].assign(heading=0.5 * np.pi - turned["gt"]["heading"] + np.radians(2.5))
    bad = replace(before, gt=compass, sd=turned["sd"])
    found = [f for f in examine(bad, None) if f.code == "HEADING_CONVENTION"]
    assert [f.repair for f in found] == [""]
    assert "fit as well" in found[0].text
