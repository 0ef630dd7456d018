from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resim.core.tracks import KINDS, Tracks
from resim.recordings import Recording, read_recording, write_recording

numbers, headings = st.floats(-1e12, 1e12), st.floats(-1e4, 1e4)
sizes = st.floats(min_value=1e-3, max_value=1e3)
names = st.text(st.characters(codec="utf-8", categories=["L", "N", "P", "S", "Zs"]), min_size=1, max_size=8)
times = st.lists(
    st.floats(-7e3, 7e3).map(lambda t: round(t, 3) + 0.0), min_size=2, max_size=6, unique=True
).map(sorted)


@st.composite
def tracks(draw: st.DrawFn, first: str | None = None) -> Tracks:
    """Tracks whose first object is valid at all times, and every other one somewhere."""
    t = np.array(draw(times))
    others = draw(st.lists(names, min_size=1, max_size=3, unique=True))
    ids = [first, *(i for i in others if i != first)] if first is not None else others
    shape = (len(ids), len(t))
    valid = np.array(
        draw(st.lists(st.booleans(), min_size=shape[0] * shape[1], max_size=shape[0] * shape[1]))
    )
    valid = valid.reshape(shape)
    valid[0] = True
    valid[:, draw(st.integers(0, len(t) - 1))] = True

    def values(of: st.SearchStrategy[float] = numbers) -> np.ndarray:
        flat = draw(st.lists(of, min_size=shape[0] * shape[1], max_size=shape[0] * shape[1]))
        return np.where(valid, np.array(flat).reshape(shape), np.nan)

    per_object = st.lists(sizes, min_size=len(ids), max_size=len(ids))
    return Tracks(
        t=t, ids=np.array(ids), valid=valid, x=values(), y=values(), heading=values(headings), v=values(),
        kind=np.array(draw(st.lists(st.sampled_from(KINDS), min_size=len(ids), max_size=len(ids)))),
        length=np.array(draw(per_object)), width=np.array(draw(per_object)),
        a=draw(st.none() | st.just(values())),
    )  # fmt: skip


def table(t: Tracks) -> pd.DataFrame:
    return t.to_frame().sort_values(["t", "id"], ignore_index=True)


def content(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


@settings(deadline=None, max_examples=60)
@given(
    gt=tracks(first="ego"), sd=st.none() | tracks(),
    text=st.dictionaries(names, st.text(st.characters(codec="utf-8"), max_size=12), max_size=3),
    data=st.data(),
)  # fmt: skip
def test_write_read_round_trip(
    gt: Tracks, sd: Tracks | None, text: dict[str, str], data: st.DataObject
) -> None:
    with tempfile.TemporaryDirectory() as name:
        base = Path(name)
        (base / "road.xodr").write_text("<OpenDRIVE/>")
        recording = Recording(
            name="drive", map=base / "road.xodr", ego="ego", gt=gt, gt_rate=12.5, provenance=text,
            build="b-1.0", build_hash="sha256:0", environment={"fogDensity": "0.25"},
        )  # fmt: skip
        if sd is not None:
            known = data.draw(
                st.lists(  # who is the EGO is examined: tests/recordings/mapped/test_judged.py
                    st.sampled_from(["", *(i for i in gt.ids.tolist() if i != "ego")]),
                    min_size=len(sd),
                    max_size=len(sd),
                )
            )
            chance = np.where(sd.valid, np.linspace(0.0, 1.0, sd.valid.size).reshape(sd.valid.shape), np.nan)
            recording = replace(
                recording, sd=sd, sd_rate=10.0, sd_gt_id=np.array(known), existence_probability=chance
            )
        write_recording(recording, base / "one")
        back = read_recording(base / "one")
        pd.testing.assert_frame_equal(table(back.gt), table(gt), check_exact=True)
        for field in (
            "name",
            "ego",
            "gt_rate",
            "sd_rate",
            "build",
            "build_hash",
            "environment",
            "provenance",
        ):
            assert getattr(back, field) == getattr(recording, field)
        if sd is not None:
            assert back.sd is not None
            assert back.sd_gt_id is not None
            assert back.existence_probability is not None
            pd.testing.assert_frame_equal(table(back.sd), table(sd), check_exact=True)
            assert dict(zip(back.sd.ids, back.sd_gt_id, strict=True)) == dict(zip(sd.ids, known, strict=True))
            row, there = back.sd.index(sd.ids[-1]), sd.valid[-1]
            kept = back.existence_probability[row][np.isin(back.sd.t, sd.t[there])]
            np.testing.assert_array_equal(kept, chance[-1, there])
        write_recording(back, base / "two")
        assert content(base / "two") == content(base / "one")


def straight(ids: str, t: np.ndarray, valid: np.ndarray, y: float = 0.0) -> Tracks:
    """Objects, one letter each, that drive 10 m/s along x, their lengths 1, 2, 3... m."""
    shape = (len(ids), len(t))
    valid = np.broadcast_to(np.asarray(valid, dtype=bool), shape)
    x = np.where(valid, 10.0 * t, np.nan)
    flat = np.where(valid, 0.0, np.nan)
    return Tracks(
        t=t, ids=np.array(list(ids)), kind=np.full(shape[0], "car"), x=x, y=flat + y, heading=flat,
        v=np.where(valid, 10.0, np.nan), length=np.arange(1.0, shape[0] + 1), width=np.ones(shape[0]),
        valid=valid,
    )  # fmt: skip


@pytest.fixture
def recording() -> Recording:
    """The EGO e and the object a; a is seen as 1 (3 samples), then as 2 (2), which overlap at t 0.2."""
    t = np.arange(4) * 0.1
    sd = straight("123", t, np.array([[1, 1, 1, 0], [0, 0, 1, 1], [1, 0, 0, 0]]), y=0.5)
    gt = straight("ea", np.arange(31) * 0.01, np.array(True))
    return Recording(
        name="r", map=Path("m.xodr"), ego="e", gt=gt, gt_rate=100.0, sd=sd, sd_rate=10.0,
        sd_gt_id=np.array(["a", "a", ""]),
    )  # fmt: skip


def test_sensor_fragments_of_one_object_become_one_track(recording: Recording) -> None:
    merged = recording.sd_by_gt()
    assert merged is not None
    assert merged.ids.tolist() == ["a", "sd:3", "e"]
    assert merged.valid[0].all()
    assert merged.length[0] == 1.0
    np.testing.assert_array_equal(merged.valid[1], [True, False, False, False])


def test_the_ground_truth_stands_in_for_an_ego_nobody_measured(recording: Recording) -> None:
    merged = recording.sd_by_gt()
    assert merged is not None
    np.testing.assert_allclose(merged.x[2], [0.0, 1.0, 2.0, 3.0], atol=1e-12)
    np.testing.assert_array_equal(merged.y[2], 0.0)
    assert recording.sd is not None
    own = replace(recording, sd_gt_id=np.array(["e", "", ""])).sd_by_gt()
    assert own is not None
    np.testing.assert_array_equal(own.select(["e"]).y[0, :3], 0.5)


@pytest.mark.parametrize(("second", "expected"), [(0.9, 7.0), (0.2, 0.5), (0.5, 0.5), (np.nan, 0.5)])
def test_the_likelier_fragment_stands_else_the_longer(
    recording: Recording, second: float, expected: float
) -> None:
    assert recording.sd is not None
    y = recording.sd.y.copy()
    y[1, 2:] = 7.0
    existence = np.where(recording.sd.valid, 0.5, np.nan)
    existence[1, 2:] = second
    merged = replace(recording, sd=replace(recording.sd, y=y), existence_probability=existence).sd_by_gt()
    assert merged is not None
    np.testing.assert_array_equal(merged.y[0], [0.5, 0.5, expected, 7.0])
