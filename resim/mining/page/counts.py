"""Kaefer's statistics (Table 4.4), and how many scenarios each bucket holds (Wagner 2021, Table 6.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

SUMS = (
    ("Total lane changes left", ("lane_change_left",)), ("Total lane changes right", ("lane_change_right",)),
    ("Total lane changes", ("lane_change_left", "lane_change_right")),
    ("Total cut-ins left", ("cut_in_left",)), ("Total cut-ins right", ("cut_in_right",)),
    ("Total cut-ins", ("cut_in_left", "cut_in_right")),
    ("Total cut-outs left", ("cut_out_left",)), ("Total cut-outs right", ("cut_out_right",)),
    ("Total cut-outs", ("cut_out_left", "cut_out_right")),
    ("Total minor tail-gates", ("tailgating_minor",)), ("Total moderate tail-gates", ("tailgating_moderate",)),
    ("Total severe tail-gates", ("tailgating_severe",)),
)  # fmt: skip
"""Rows of Table 4.4 that count labels."""
VEHICLES = (("Total speeding vehicles", "speeding"), ("Total standing vehicles", "standing"))
"""... and those that count vehicles with a label."""


def statistics(maneuvers: pd.DataFrame) -> list[tuple[str, int]]:
    """Give Kaefer's Table 4.4. maneuvers: rows as of maneuvers.parquet, of one recording or several."""
    count = maneuvers["label"].value_counts().to_dict()
    changes = maneuvers[maneuvers["label"].isin(["lane_change_left", "lane_change_right"])]
    by_vehicle = changes.groupby(["recording", "object"]).size()
    out = [(name, sum(int(count.get(label, 0)) for label in labels)) for name, labels in SUMS[:3]]
    out.append(("Maximum lane changes", int(by_vehicle.max()) if len(by_vehicle) else 0))
    out += [(name, sum(int(count.get(label, 0)) for label in labels)) for name, labels in SUMS[3:]]
    for name, label in VEHICLES:
        own = maneuvers[maneuvers["label"] == label]
        out.append((name, len(own.drop_duplicates(["recording", "object"]))))
    return out


def buckets(scenarios: pd.DataFrame, maps: Mapping[str, str]) -> tuple[list[str], list[list[str]]]:
    """Give Wagner's Table 6.1: a column per map, road and direction, a row per number of vehicles with the EGO.

    maps: of each recording the name of its map, which is told where there are several: roads of two maps may share ids.
    """
    roads = scenarios["road"].where(scenarios["road"] != "", "no road")
    way = scenarios["along_s"].map({True: "with s", False: "against s"})
    column = roads + ", " + way + ", " + scenarios["lanes"].astype(str) + " lanes"
    of = scenarios["recording"].map(maps)
    if of.nunique() > 1:
        column = of + ", road " + column
    table = pd.crosstab(scenarios["vehicles"], column)
    heads = ["vehicles", *map(str, table.columns)]
    return heads, [
        [str(n), *_cells(row)] for n, row in zip(table.index, table.to_numpy().tolist(), strict=True)
    ]


def _cells(row: Sequence[int]) -> list[str]:
    return [str(n) if n else "–" for n in row]
