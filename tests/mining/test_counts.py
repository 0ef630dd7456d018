"""Wagner's Table 6.1 as mined.html has it."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from conftest import ROOT

from resim.jobs.mine import MineOptions, mine
from resim.mining.catalog import count_kinds, read_kinds
from resim.mining.page.counts import Counted, buckets, statistics


def counted(**found: list[tuple[str, bool, int, int]]) -> Counted:
    """Count scenarios (road, along s, lanes, vehicles), by maps."""
    out = Counted()
    for road, rows in found.items():
        told = pd.DataFrame(rows, columns=["road", "along_s", "lanes", "vehicles"])
        told = told.assign(scenario="a+1+1", tag="left", labels="", ego="1", folder="", duration=3.0)
        out.add(road, pd.DataFrame({"label": [], "object": []}), told)
    return out


def test_scenarios_are_counted_by_road_direction_lanes_and_vehicles() -> None:
    heads, rows = buckets(
        counted(m=[("1", True, 3, 2), ("1", True, 3, 2), ("1", False, 3, 4), ("", True, 2, 2)])
    )
    assert heads == ["vehicles", "1, against s, 3 lanes", "1, with s, 3 lanes", "no road, with s, 2 lanes"]
    assert rows == [["2", "–", "2", "1"], ["4", "1", "–", "–"]]


def test_roads_of_two_maps_that_share_an_id_are_two() -> None:
    heads, rows = buckets(counted(m=[("1", True, 3, 2)], n=[("1", True, 3, 2)]))
    assert heads == ["vehicles", "m, road 1, with s, 3 lanes", "n, road 1, with s, 3 lanes"]
    assert rows == [["2", "1", "1"]]


@pytest.mark.slow
def test_what_is_counted_of_several_recordings_is_what_their_tables_hold(tmp_path: Path) -> None:
    """Counted recording by recording, and at once from the tables of all."""
    found = mine(
        sorted((ROOT / "scenarios" / "neighbours").iterdir())[:6],
        tmp_path / "out",
        MineOptions(fit=False),
    )
    kinds = read_kinds(ROOT / "scenarios" / "catalog" / "kinds.toml")
    out = Counted(kinds)
    for part in found.report.parts:
        own = [frame[frame["recording"] == part.recording] for frame in (found.maneuvers, found.scenarios)]
        out.add(part.map or "", *own)
    told = dict(statistics(out))
    changes = found.maneuvers[found.maneuvers["label"].isin(["lane_change_left", "lane_change_right"])]
    assert told["Total lane changes"] == len(changes) > 0
    assert told["Maximum lane changes"] == changes.groupby(["recording", "object"]).size().max()
    assert out.scenarios == len(found.scenarios) > 0
    assert out.mean_duration == pytest.approx(found.scenarios["duration"].mean())
    assert out.mean_vehicles == pytest.approx(found.scenarios["vehicles"].mean())
    assert [out.found[k] for k in range(len(kinds))] == [
        one.found or 0 for one in count_kinds(kinds, found.maneuvers)
    ]
    assert [-one.minus_duration for one in out.longest] == sorted(found.scenarios["duration"], reverse=True)[
        :12
    ]
