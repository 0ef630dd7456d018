"""Wagner's Table 6.1 as mined.html has it."""

from __future__ import annotations

import pandas as pd

from resim.mining.page.counts import buckets


def scenarios(*rows: tuple[str, str, bool, int, int]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=["recording", "road", "along_s", "lanes", "vehicles"])


def test_scenarios_are_counted_by_road_direction_lanes_and_vehicles() -> None:
    found = scenarios(
        ("a", "1", True, 3, 2), ("a", "1", True, 3, 2), ("a", "1", False, 3, 4), ("a", "", True, 2, 2)
    )
    heads, rows = buckets(found, {"a": "m-1"})
    assert heads == ["vehicles", "1, against s, 3 lanes", "1, with s, 3 lanes", "no road, with s, 2 lanes"]
    assert rows == [["2", "–", "2", "1"], ["4", "1", "–", "–"]]


def test_roads_of_two_maps_that_share_an_id_are_two() -> None:
    found = scenarios(("a", "1", True, 3, 2), ("b", "1", True, 3, 2))
    heads, rows = buckets(found, {"a": "m-1", "b": "n-2"})
    assert heads == ["vehicles", "m-1, road 1, with s, 3 lanes", "n-2, road 1, with s, 3 lanes"]
    assert rows == [["2", "1", "1"]]
