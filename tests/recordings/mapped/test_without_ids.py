"""A sensor's list without ids, and what a sensor is off by as a whole: known drives of straight lines."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT

from resim.core.errors import InputError
from resim.recordings.mapped.reader import read_mapped
from resim.recordings.mapped.tracking import tracked

MAP = ROOT / "networks" / "proving_ground.xodr"
MAPPING = """
[gt]
id = "id"
t = "t"
x = "x"
y = "y"
v = "v"
heading = "heading"
length = {{ value = 4.7 }}
width = {{ value = 1.9 }}
[sd]
file = "sd.csv"
t = "t"
x = "x"
y = "y"
{more}
"""
CARS = {
    "ego": (20.0, -1.75, 20.0),
    "a": (60.0, -1.75, 17.0),
    "b": (10.0, -5.25, 24.0),
    "c": (110.0, -5.25, 12.0),
}
"""x at t = 0 [m], y [m], v [m/s]."""


def truth() -> pd.DataFrame:
    t = np.round(np.arange(0.0, 10.001, 0.05), 6)
    rows = [
        pd.DataFrame({"t": t, "id": name, "x": x + v * t, "y": y, "v": v, "heading": 0.0})
        for name, (x, y, v) in CARS.items()
    ]
    return pd.concat(rows).sort_values("t", kind="stable")


def detections(
    *, ahead: float = 0.0, left: float = 0.0, lag: float = 0.0, noise: float = 0.1
) -> pd.DataFrame:
    """What a radar on the EGO lists every 0.1 s: who is 5 m behind to 90 m ahead of it."""
    rng, out = np.random.default_rng(3), []
    x0, y0, v0 = CARS["ego"]
    for t in np.arange(0.1, 10.0, 0.1):
        for x, y, v in (CARS[name] for name in "abc"):
            far = x - x0 + (v - v0) * (t - lag)
            if -5.0 < far < 90.0:
                at = far + ahead + rng.normal(0.0, noise), y - y0 + left + rng.normal(0.0, noise)
                out.append({"t": round(t, 6), "x": at[0], "y": at[1], "v": v, "heading": 0.0})
    return pd.DataFrame(out)


def imported(folder: Path, sd: pd.DataFrame, more: str):
    truth().to_csv(folder / "gt.csv", index=False)
    sd.to_csv(folder / "sd.csv", index=False)
    (folder / "mapping.toml").write_text(MAPPING.format(more=more))
    return read_mapped(folder / "gt.csv", map=MAP, columns=folder / "mapping.toml", ego="ego")


MOVED = 'v = "v"\nheading = "heading"\nframe = "ego"'


@pytest.mark.parametrize("more", [MOVED, 'frame = "ego"'])
def test_objects_are_followed_from_list_to_list(tmp_path: Path, more: str) -> None:
    """By what the list says of their velocities, or by how they moved."""
    tables = imported(tmp_path, detections(), more)
    sd = tables.sd
    assert sd is not None
    assert set(sd.groupby("id")["gt_id"].first()) == {"a", "b", "c"}
    assert sd["id"].nunique() == 3
    assert tables.settings.provenance["sd_ids"].startswith("none: 3 objects followed")


def test_who_crosses_stays_who_he_is_and_who_is_lost_for_long_is_somebody_else() -> None:
    t = np.repeat(np.arange(0.0, 6.0, 0.1), 2)
    first = np.arange(len(t)) % 2 == 0
    places = np.where(first, 10.0 * t + 0j, 60.0 - 10.0 * t + 1.5j)
    velocity = np.where(first, 10.0 + 0j, -10.0 + 0j)
    order = np.random.default_rng(1).permutation(len(t))
    for moved in (velocity, np.full(len(t), np.nan + 0j)):
        ids = np.empty(len(t), dtype="<U8")
        ids[order] = tracked(t[order], places[order], moved[order], 3.0)
        assert len(set(ids[first])) == len(set(ids[~first])) == 1
        assert ids[0] != ids[1]
    faster = np.where(t > 3.0, 16.0 + 0j, 10.0)
    assert len(set(tracked(t[first], places[first], faster[first], 3.0))) == 2, "another stands in its place"
    for gap, objects in ((0.4, 1), (0.8, 2)):
        kept = first & ~((t > 2.0) & (t < 2.0 + gap))
        assert len(set(tracked(t[kept], places[kept], velocity[kept], 3.0))) == objects


@pytest.mark.parametrize(
    ("off", "told"),
    [
        ({"ahead": 1.4}, {"ahead": 1.4}),
        ({"ahead": -0.9, "left": 0.5}, {"behind": 0.9, "to the left": 0.5}),
        ({"lag": 0.12}, {"late": 0.12}),
        ({"ahead": 1.4, "lag": 0.06}, {"ahead": 1.4, "late": 0.06}),
        ({}, {}),
    ],
)
def test_what_the_whole_sensor_is_off_by_is_told(tmp_path: Path, off: dict, told: dict) -> None:
    tables = imported(tmp_path, detections(**off), MOVED)
    text = tables.settings.provenance.get("sd_bias", "")
    found = {word: float(value) for value, word in re.findall(
        r"([\d.]+) m?s? ?(ahead|behind|to the left|to the right|late)", text)}  # fmt: skip
    assert found == pytest.approx(told, abs=0.03)
    assert ("mounting" in text) is bool({"ahead", "behind", "to the left"} & set(told))


def test_a_wrong_sign_of_y_is_told_as_that_and_not_as_an_offset(tmp_path: Path) -> None:
    for more, told in ((MOVED, True), (MOVED + "\nmirrored = true", False)):
        notes = imported(tmp_path, detections().assign(y=lambda f: -f["y"]), more).settings.provenance
        assert ("left and right of the EGO are swapped" in notes.get("sd_sides", "")) is told
        assert "sd_bias" not in notes


def test_what_needs_ids_says_so(tmp_path: Path) -> None:
    for more, message in (
        (MOVED + '\ngt_id = "v"', "gt_id in sd needs id"),
        (MOVED + '\n[match]\nby = "id"', r'match\.by = "id" needs id in sd'),
    ):
        with pytest.raises(InputError, match=message):
            imported(tmp_path, detections(), more)
    (tmp_path / "mapping.toml").write_text('[gt]\nt = "t"\nx = "x"\ny = "y"\n')
    with pytest.raises(InputError, match=r"gt\.id is missing: the column of ids"):
        read_mapped(tmp_path / "gt.csv", map=MAP, columns=tmp_path / "mapping.toml", ego="ego")
    (tmp_path / "mapping.toml").write_text(MAPPING.format(more=MOVED + "\nlatency = 0.06"))
    with pytest.raises(InputError, match=r"sd\.latency: there is no such field(?!, did)"):
        read_mapped(tmp_path / "gt.csv", map=MAP, columns=tmp_path / "mapping.toml", ego="ego")


def test_cars_of_a_motorway_are_followed_from_their_first_sample_by_the_egos_velocity() -> None:
    t = np.repeat(np.arange(0.0, 1.05, 0.1), 3)
    start, speed = np.tile([0.0, 40.0, 300.0], 11), np.tile([35.0, 38.0, 0.0], 11)
    places, unknown = start + speed * t + 0j, np.full(len(t), np.nan, dtype=complex)
    ego = np.full(len(t), 36.0, dtype=complex)
    assert tracked(t, places, unknown, 3.0, ego).tolist() == ["1", "2", "3"] * 11
    assert len(set(tracked(t, places, unknown, 3.0, unknown))) > 3  # 3.5 m from list to list
