"""Recordings of the same traffic are one drive, whoever recorded it, by whichever clock and with whichever noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from space.spaces import KINDS, source

from resim.space.build import build_space, grow_space
from resim.space.draws import drive_numbers
from resim.space.folder import read_space, write_space
from resim.space.shared_traffic import COLUMNS, moments, recordings_of_one_traffic
from resim.space.sources import MinedSource

LENGTH = 5000.0
"""m of a road in x."""
LANES = (0.0, 3.5, 7.0)


def maneuvers(seed: int, minutes: float = 2.0, vehicles: int = 60) -> pd.DataFrame:
    """Lane changes and passes of vehicles on a straight road, each with a speed of its own, as mining writes them."""
    rng = np.random.default_rng(seed)
    n = 3 * vehicles
    who = np.repeat(np.arange(vehicles), 3)
    v = rng.uniform(20.0, 35.0, vehicles)[who]
    t, x = rng.uniform(5.0, 60.0 * minutes - 5.0, n), rng.uniform(100.0, LENGTH - 100.0, n)
    lane = rng.integers(0, 3, n)
    y, left = np.array(LANES)[lane], rng.random(n) < 0.5
    return pd.DataFrame(
        {
            "recording": "0", "object": who.astype(str), "label": np.where(left, "lane_change_left", "pass"),
            "start": t - 2.0, "end": t + 2.0, "t": t, "x_from": x - 2.0 * v, "x_to": x + 2.0 * v, "y_from": y,
            "y_to": y + np.where(left, 3.5, 0.0), "v_mps": v,
        }
    )  # fmt: skip


def again(
    of: pd.DataFrame, seed: int, noise: float = 0.3, clock: float = 0.0, seen: float = 1.0
) -> pd.DataFrame:
    """What another recorder found of it: some of the vehicles by other names, earlier or later on their way."""
    rng = np.random.default_rng(seed)
    names = rng.permutation(200)
    late = rng.normal(0.0, noise, len(of))
    out = of.assign(
        object=[f"v{names[int(one)]}" for one in of["object"]], t=of["t"] + late + clock,
        start=of["start"] + late + clock, end=of["end"] + late + clock, x_from=of["x_from"] + of["v_mps"] * late,
        x_to=of["x_to"] + of["v_mps"] * late, y_from=of["y_from"] + rng.normal(0.0, noise, len(of)),
        v_mps=of["v_mps"] + rng.normal(0.0, 0.1, len(of)),
    )  # fmt: skip
    return out[names[of["object"].astype(int)] < 200 * seen]


def mined(name: str, found: pd.DataFrame, hours: float = 1.0) -> MinedSource:
    own = source(name, list(KINDS[:2]), sum(map(ord, name)), hours, each=2)
    recording = own.recordings[0].name
    return replace(
        own, moments=moments(found.assign(recording=recording), pd.Series({recording: "m-1"})), hash=name
    )


@pytest.mark.parametrize(
    "how", [{"noise": 0.0}, {"clock": 37.3}, {"seen": 0.3}, {"clock": -512.0, "seen": 0.4}]
)
def test_recorders_of_one_traffic_are_one_drive(how: dict[str, float], tmp_path: Path) -> None:
    """Their hours are those of the longest, and a space that grows by one of them knows it."""
    day, night = maneuvers(0), maneuvers(1)
    drives = [mined("day", day, 2.0), mined("night", night, 1.0)]
    other = mined("other", again(day, 5, **how), 0.5)
    built = build_space([*drives, other])
    write_space(build_space(drives), tmp_path)
    grown = grow_space(read_space(tmp_path)[0], [other])
    for space in (built, grown):
        assert drive_numbers(space.rows).tolist() == [0, 0, 1, 1, 0, 0]
        assert space.driven[0] == 3.0
        assert [set(one.drives.values()) for one in space.sources] == [
            {"day/day/0"},
            {"night/night/0"},
            {"day/day/0"},
        ]


def test_a_recording_without_a_scenario_is_known_as_well() -> None:
    """In its hours nothing comes: twice they would make every rate smaller."""
    day = maneuvers(0)
    whole = mined("day", day)
    quiet = mined("quiet", again(day, 3))
    quiet = replace(quiet, rows=quiet.rows.iloc[:0], traces=quiet.traces.take([]))
    assert build_space([whole, quiet]).driven[0] == 1.0


def test_other_traffic_is_another_drive() -> None:
    """Also on the same road at the same speeds: of 1,225 pairs of recordings none agrees on a time."""
    every = [moments(maneuvers(k).assign(recording=str(k)), pd.Series({str(k): "m"})) for k in range(50)]
    found = pd.concat(every, ignore_index=True)
    assert recordings_of_one_traffic(found, set(found["recording"])) == []
    copy = moments(again(maneuvers(7), 1, clock=3.0).assign(recording="copy"), pd.Series({"copy": "m"}))
    both = pd.concat([found, copy], ignore_index=True)
    assert recordings_of_one_traffic(both, {"copy"}) == [("7", "copy")]
    assert recordings_of_one_traffic(both, {"9"}) == []
    assert recordings_of_one_traffic(both.assign(map=both["recording"]), {"copy"}) == []
    assert (
        recordings_of_one_traffic(
            both.assign(course=np.where(both["recording"] == "copy", 3.0, 0.0)), {"copy"}
        )
        == []
    )


def test_vehicles_that_come_at_equal_intervals_do_not_agree_on_one_time() -> None:
    """Who came into sight at the same place tells nothing: simulated traffic begins at one."""
    found = maneuvers(0).assign(label="follow_lane")
    assert list(moments(found, pd.Series({"0": "m"}))) == list(COLUMNS)
    assert not len(moments(found, pd.Series({"0": "m"})))
    assert not len(moments(maneuvers(0).assign(x_to=np.nan), pd.Series({"0": "m"})))
    assert not recordings_of_one_traffic(moments(found, pd.Series({"0": "m"})), {"0"})
