from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pandas.testing import assert_frame_equal

from resim.core.errors import InputError
from resim.core.geometry import wrap_angle
from resim.recordings import RecordingTables
from resim.recordings.checks import CODES, examine
from resim.recordings.repairs import REPAIRS, repair
from resim.road.opendrive import RoadNetwork

Read = Callable[[str], RecordingTables]
Change = Callable[[pd.DataFrame], pd.DataFrame]
REPAIRED = "repaired"


def own(f: pd.DataFrame, name: str = "1") -> pd.Series:
    return f["id"] == name


def put(f: pd.DataFrame, rows: pd.Series, **values: object) -> pd.DataFrame:
    out = f.copy()
    for column, value in values.items():
        out.loc[rows, column] = value
    return out


def add(f: pd.DataFrame, rows: pd.Series, **values: float) -> pd.DataFrame:
    return put(f, rows, **{c: f.loc[rows, c] + v for c, v in values.items()})


def hold(f: pd.DataFrame) -> pd.DataFrame:
    rows = own(f) & (f["t"] > 4.0) & (f["t"] < 4.5)
    return put(f, rows, x=f.loc[rows, "x"].iloc[0], y=f.loc[rows, "y"].iloc[0])


def out_of_order(f: pd.DataFrame) -> pd.DataFrame:
    order = np.arange(len(f))
    order[[40, 140]] = order[[140, 40]]
    return f.iloc[order]


def exchanged(f: pd.DataFrame) -> pd.DataFrame:
    swap = {"1": "2", "2": "1"}
    return f.assign(id=[swap.get(i, i) if t > 5.0 else i for i, t in zip(f["id"], f["t"], strict=True)])


def broken(f: pd.DataFrame) -> pd.DataFrame:
    f = f[~(own(f) & f["t"].between(5.0, 5.3))]
    f = put(f, own(f) & (f["t"] > 5.0), id="9")
    return put(f, own(f, "9"), gt_id="") if "gt_id" in f else f


def spiked(f: pd.DataFrame) -> pd.DataFrame:
    return add(f, own(f) & f["t"].isin([3.0, 6.0]), v=6.0)


# code, source, change; planted in `overtake`; what repaired rows may be off: x and y [m], heading [rad], v [m/s], t [s]
EXACT = (1e-6, 1e-9, 1e-9, 1e-9)
ALONG = (0.1, 0.03, 0.2, 1e-9)  # of GT, between samples with 0.01 m of noise
PLANTS: tuple[tuple[str, str, Change, tuple[float, ...]], ...] = (
    ("MISSING_VALUES", "gt", lambda f: put(f, own(f) & f["t"].between(3.0, 3.2), x=np.nan, v=np.nan), ALONG),
    ("MISSING_SAMPLES", "gt", lambda f: f[~(own(f) & f["t"].between(3.0, 3.1))], ALONG),
    ("MISSING_SAMPLES", "sd", lambda f: f[~(own(f) & f["t"].between(3.0, 3.1))], (0.3, 0.06, 1.0, 1e-9)),
    ("GAP", "gt", lambda f: f[~(own(f) & f["t"].between(3.0, 3.5))], ALONG),
    ("GAP", "gt", lambda f: f[~f["t"].between(3.0, 3.9)], ALONG),
    ("DUPLICATE_SAMPLES", "gt", lambda f: pd.concat([f, f[own(f) & (f["t"] == 3.0)]]), EXACT),
    ("REPEATED_SAMPLES", "gt", hold, ALONG),
    ("TIME_BACKWARDS", "sd", out_of_order, EXACT),
    ("CLOCK_JUMP", "gt", lambda f: add(f, f["t"] > 5.0, t=0.3), (1e-6, 1e-9, 1e-9, 0.01)),
    ("CLOCK_JUMP", "sd", lambda f: add(f, f["t"] > 5.0, t=-0.3), (1e-6, 1e-9, 1e-9, 0.01)),
    ("CLOCK_DRIFT", "sd", lambda f: f.assign(t=1.05 * f["t"]), (1e-6, 1e-9, 1e-9, 0.05)),
    ("CLOCK_OFFSET", "sd", lambda f: f.assign(t=f["t"] + 0.6), (1e-6, 1e-9, 1e-9, 0.1)),
    ("CLOCK_OFFSET", "gt", lambda f: add(f, own(f), t=0.6).sort_values("t", kind="stable"), (1e-6, 1e-9, 1e-9, 0.1)),
    ("ID_SWITCH", "gt", exchanged, EXACT),
    ("ID_SWITCH", "sd", exchanged, EXACT),
    ("TRACK_BROKEN", "gt", broken, ALONG),
    ("TRACK_BROKEN", "sd", broken, (0.3, 0.06, 1.0, 1e-9)),
    ("OUTLIER", "gt", lambda f: add(f, own(f) & (f["t"] == 3.0), y=4.0), (0.1, 1e-9, 1e-9, 1e-9)),
    ("ACCELERATION", "gt", spiked, (1e-6, 1e-9, 0.2, 1e-9)),
    ("SPEED_DISAGREES", "gt", lambda f: put(f, own(f), v=0.8 * f["v"]), (1e-6, 1e-9, 0.3, 1e-9)),
    ("SPEED_DISAGREES", "gt", lambda f: add(f, own(f) & f["t"].between(3.0, 5.0), v=3.0), (1e-6, 1e-9, 0.3, 1e-9)),
    ("HEADING_DISAGREES", "gt", lambda f: add(f, own(f), heading=0.2), (1e-6, 0.01, 1e-9, 1e-9)),
    ("HEADING_DISAGREES", "gt", lambda f: add(f, own(f) & f["t"].between(3.0, 5.0), heading=0.4),
     (1e-6, 0.03, 1e-9, 1e-9)),
    ("SIZE_CHANGES", "gt", lambda f: put(f, own(f) & (f["t"] > 8.0), length=6.0), EXACT),
    ("SIZE_SWAPPED", "gt", lambda f: f.assign(length=f["width"], width=f["length"]), EXACT),
    ("TIME_UNIT", "gt", lambda f: f.assign(t=1e3 * f["t"]), EXACT),
    ("TIME_UNIT", "sd", lambda f: f.assign(t=1e3 * f["t"], v=3.6 * f["v"]), EXACT),
    ("EGO_DETECTION", "sd", lambda f: put(f, own(f, "ego"), gt_id=""), EXACT),
    ("SPEED_UNIT", "gt", lambda f: f.assign(v=3.6 * f["v"]), EXACT),
    ("SPEED_UNIT", "sd", lambda f: put(f, own(f, "2"), v=2.236936 * f["v"]), EXACT),
    ("HEADING_UNIT", "gt", lambda f: f.assign(heading=np.degrees(f["heading"]) % 360.0), EXACT),
    ("HEADING_TURNED", "gt", lambda f: f.assign(heading=f["heading"] + np.pi), EXACT),
    ("HEADING_TURNED", "sd", lambda f: put(f, own(f), heading=f["heading"] - np.pi), EXACT),
    ("HEADING_CONVENTION", "sd", lambda f: f.assign(heading=90.0 - np.degrees(f["heading"])), EXACT),
    ("MIRRORED_Y", "gt", lambda f: f.assign(y=-f["y"], heading=-f["heading"]), EXACT),
)  # fmt: skip


def planted(before: RecordingTables, source: str, change: Change) -> RecordingTables:
    return replace(before, **{source: change(getattr(before, source)).reset_index(drop=True)})


def by_row(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.sort_values(["id", "t"], kind="stable").reset_index(drop=True)


@pytest.mark.parametrize(
    ("code", "source", "change", "off"), PLANTS, ids=[f"{n}-{p[0]}-{p[1]}" for n, p in enumerate(PLANTS)]
)
def test_a_planted_fault_is_repaired(
    tables: Read, network: RoadNetwork, code: str, source: str, change: Change, off: tuple[float, ...]
) -> None:
    truth = tables("overtake")
    before = planted(truth, source, change)
    assert code in {f.code for f in examine(before, network) if f.repair}
    result = repair(before, network)
    assert result.left == ()
    assert result.left == examine(result.tables, network)
    after, true = by_row(getattr(result.tables, source)), by_row(getattr(truth, source))
    assert after["id"].tolist() == true["id"].tolist()  # nobody is lost, nobody is new
    for columns, limit in zip((["x", "y"], ["heading"], ["v"], ["t"]), off, strict=True):
        wrong = after[columns] - true[columns]
        wrong = wrap_angle(wrong) if columns == ["heading"] else wrong.to_numpy()
        assert np.abs(wrong).max() < limit, columns
    others = [c for c in ("length", "width", "kind", "gt_id") if c in true]
    assert_frame_equal(after[others], true[others])


@pytest.mark.parametrize(
    ("code", "source", "change"),
    [
        pytest.param(*p[:3], id=f"{n}-{p[0]}-{p[1]}", marks=[pytest.mark.slow] if n % 2 else [])
        for n, p in enumerate(PLANTS)
    ],
)
def test_what_is_not_marked_is_what_it_was(
    tables: Read, network: RoadNetwork, code: str, source: str, change: Change
) -> None:
    before = planted(tables("overtake"), source, change)
    kept = {name: getattr(before, name).copy() for name in ("gt", "sd")}
    result = repair(before, network)
    for name in ("gt", "sd"):
        assert_frame_equal(getattr(before, name), kept[name])  # what was given stays as it was
        after = getattr(result.tables, name)
        if REPAIRED not in after:
            assert name != source or code == "TIME_BACKWARDS"
            after = after.assign(repaired="")
        rows = after.loc[after[REPAIRED] == "", kept[name].columns]
        same = rows.merge(kept[name].drop_duplicates(), how="left", indicator=True)
        assert (same["_merge"] == "both").all()
        marks = {mark for text in after[REPAIRED] for mark in text.split()}
        done = {d.code for d in result.done if d.source == name}
        assert marks == done - {"TIME_BACKWARDS"}  # a row that only moved is none that was changed
        for one in result.done:
            touched = after[REPAIRED].str.split().map(lambda codes, code=one.code: code in codes)
            if one.source == name and one.code != "TIME_BACKWARDS":
                assert int(touched.sum()) == one.count.changed + one.count.added
    assert code in {d.code for d in result.done}


@pytest.mark.parametrize(("code", "source", "change"), [p[:3] for p in PLANTS[1::4]])
def test_repairing_again_changes_nothing_and_the_same_comes_again(
    tables: Read, network: RoadNetwork, code: str, source: str, change: Change
) -> None:
    before = planted(tables("overtake"), source, change)
    once, again = repair(before, network), repair(before, network)
    twice = repair(once.tables, network)
    assert twice.done == ()
    for name in ("gt", "sd"):
        assert_frame_equal(getattr(once.tables, name), getattr(again.tables, name))
        assert_frame_equal(getattr(once.tables, name), getattr(twice.tables, name))


@pytest.mark.parametrize("name", ["cut_in_brake", "overtake", "rear_end"])
def test_what_ships_comes_back_unchanged(tables: Read, network: RoadNetwork, name: str) -> None:
    before = tables(name)
    result = repair(before, network)
    assert result.done == ()
    assert_frame_equal(result.tables.gt, before.gt)
    assert before.sd is not None
    assert_frame_equal(result.tables.sd, before.sd)
    assert result.left == examine(before, network)  # a sensor's late speed stays


def test_every_code_with_a_repair_has_one_and_a_plant() -> None:
    assert {code for code, terms in CODES.items() if terms.repair} == set(REPAIRS)
    assert set(REPAIRS) - {p[0] for p in PLANTS} == {"ID_REUSED", "YAW_RATE"}


def test_the_second_object_of_an_id_gets_its_own(tables: Read, network: RoadNetwork) -> None:
    def reused(f: pd.DataFrame) -> pd.DataFrame:
        f = f[~(own(f) & f["t"].between(5.0, 6.0))]
        return add(f, own(f) & (f["t"] > 5.0), x=60.0)

    result = repair(planted(tables("overtake"), "sd", reused), network)
    assert result.tables.sd is not None
    later = result.tables.sd[own(result.tables.sd, "1_2")]
    assert later["t"].min() > 6.0
    assert set(later["gt_id"]) == {""}
    assert set(later[REPAIRED]) == {"ID_REUSED"}
    assert [f.code for f in result.left] == ["SD_WITHOUT_GT"]


def test_a_spike_of_the_heading_goes(tables: Read, network: RoadNetwork) -> None:
    truth = tables("overtake")
    faulty = planted(truth, "gt", lambda f: add(f, own(f) & f["t"].isin([3.0, 6.0]), heading=0.6))
    result = repair(faulty, network)
    assert {d.code for d in result.done} == {"YAW_RATE"}
    assert np.abs(result.tables.gt["heading"].to_numpy() - truth.gt["heading"].to_numpy()).max() < 0.02


def test_gaps_are_filled_up_to_the_length_that_is_asked_for(tables: Read, network: RoadNetwork) -> None:
    faulty = planted(tables("overtake"), "gt", lambda f: f[~(own(f) & f["t"].between(3.0, 4.5))])
    assert [f.code for f in repair(faulty, network).left] == ["GAP"]
    wide = repair(faulty, network, max_gap=2.0)
    assert wide.left == ()
    assert [(d.code, d.count.added) for d in wide.done] == [("GAP", 38)]
    short = planted(tables("overtake"), "gt", lambda f: f[~(own(f) & f["t"].between(3.0, 3.1))])
    assert repair(short, network, max_gap=0.0).done == ()


@pytest.mark.parametrize("outliers", ["robust", "moving-average"])
def test_both_filters_take_an_outlier_out(tables: Read, network: RoadNetwork, outliers: str) -> None:
    faulty = planted(tables("overtake"), "gt", lambda f: add(f, own(f) & (f["t"] == 3.0), y=4.0))
    result = repair(faulty, network, outliers=outliers)
    assert result.left == ()
    assert result.done[0].code == "OUTLIER"


@pytest.mark.parametrize("setting", [{"max_gap": -1.0}, {"max_gap": np.nan}, {"outliers": "none"}])
def test_settings_that_are_none_are_refused(tables: Read, setting: dict[str, object]) -> None:
    with pytest.raises(InputError, match=r"--max-gap|--outliers"):
        repair(tables("rear_end"), None, **setting)  # type: ignore[arg-type]


LEFT: dict[str, Change] = {
    "POSITION_JUMP": lambda f: add(f, own(f) & (f["t"] > 5.0), x=5.0),
    "REFERENCE_POINT": lambda f: f.assign(x=f["x"] + 0.5 * f["length"], y=f["y"] + 0.5 * f["width"]),
    "DUPLICATE_SAMPLES": lambda f: pd.concat([f, add(f[own(f) & (f["t"] == 3.0)], own(f)[own(f)], y=2.0)]),
}


@pytest.mark.parametrize("code", LEFT)
def test_what_is_not_safe_is_left_and_told(tables: Read, network: RoadNetwork, code: str) -> None:
    faulty = planted(tables("overtake"), "gt", LEFT[code])
    result = repair(faulty, network)
    assert code not in {d.code for d in result.done}
    assert code in {f.code for f in result.left}


def test_faults_on_top_of_each_other(tables: Read, network: RoadNetwork) -> None:
    truth = tables("overtake")

    def much(f: pd.DataFrame) -> pd.DataFrame:
        f = put(f, own(f, "2") & (f["t"] == 7.0), x=np.nan)
        f = f[~(own(f) & f["t"].between(3.0, 3.5))]
        f = add(f, own(f, "3") & (f["t"] == 4.0), y=3.0)
        f = add(f, f["t"] > 5.0, t=0.3).assign(v=3.6 * f["v"])
        return pd.concat([f, f[own(f, "ego") & (f["t"] == 2.0)]])

    result = repair(planted(truth, "gt", much), network)
    assert result.left == ()
    after, true = by_row(result.tables.gt), by_row(truth.gt)
    assert (after["id"] == true["id"]).all()
    assert np.hypot(after["x"] - true["x"], after["y"] - true["y"]).max() < 0.1
    assert np.abs(after["t"] - true["t"]).max() < 0.01
    assert {"SPEED_UNIT", "CLOCK_JUMP", "GAP"} <= {m for text in after[REPAIRED] for m in text.split()}


@settings(deadline=None, max_examples=4)
@given(st.data())
def test_no_table_that_can_be_read_makes_it_fail(
    tables: Read, network: RoadNetwork, data: st.DataObject
) -> None:
    before = tables("rear_end")
    rng = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    frames = {}
    for name in ("gt", "sd"):
        frame = getattr(before, name)
        frame = frame.sample(n=data.draw(st.integers(1, 60)), replace=True, random_state=rng.integers(10**6))
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
    result = repair(replace(before, **frames), network)
    assert set(result.tables.gt["id"]) <= {
        *frames["gt"]["id"],
        *(f"{i}_{k}" for i in frames["gt"]["id"] for k in range(2, 9)),
    }
