"""What is counted over recordings: Kaefer's statistics (Table 4.4), kinds, and scenarios by bucket (Wagner, Table 6.1).

Recordings are counted one after the other, so that memory does not grow with them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from resim.mining.catalog import ScenarioKind, count_kinds

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
BIN, LONGEST = 0.5, 12
"""s of a bar of the durations; scenarios that are kept as the longest."""


class LongScenario(NamedTuple):
    """A scenario that was written, by what orders the longest first."""

    minus_duration: float
    name: str
    folder: str
    labels: str
    ego: str


class Counted:
    """Maneuvers and scenarios of recordings, counted.

    kinds: for which scenarios are counted as well. labels: how many of each. vehicles: with a label of VEHICLES.
    found: of each kind. cells: scenarios by map, bucket and vehicles. tags: by vehicles and tag. durations: by bar.
    """

    def __init__(self, kinds: Sequence[ScenarioKind] = ()) -> None:
        self.kinds = kinds
        self.labels: Counter[str] = Counter()
        self.vehicles: Counter[str] = Counter()
        self.found: Counter[int] = Counter()
        self.cells: Counter[tuple[str, str, int]] = Counter()
        self.tags: Counter[tuple[int, str]] = Counter()
        self.durations: Counter[int] = Counter()
        self.most_changes, self.written = 0, 0
        self.longest: list[LongScenario] = []
        self._seconds = 0.0

    def add(self, road: str, maneuvers: pd.DataFrame, scenarios: pd.DataFrame) -> None:
        """Count one recording, on the map of this name; rows as of maneuvers.parquet and scenarios.parquet."""
        self._add_maneuvers(maneuvers)
        way = scenarios["along_s"].map({True: "with s", False: "against s"})
        column = scenarios["road"].where(scenarios["road"] != "", "no road")
        column = column + ", " + way + ", " + scenarios["lanes"].astype(str) + " lanes"
        vehicles = scenarios["vehicles"].tolist()
        self.cells.update(zip([road] * len(column), column.tolist(), vehicles, strict=True))
        self.tags.update(zip(vehicles, scenarios["tag"].tolist(), strict=True))
        duration = scenarios["duration"].to_numpy(float)
        self.durations.update(np.floor(duration / BIN).astype(int).tolist())
        self._seconds += float(duration.sum())
        written = scenarios[scenarios["folder"] != ""]
        self.written += len(written)
        told = written[["scenario", "folder", "labels", "ego"]].astype(str)
        rows = [
            LongScenario(-d, *row)
            for d, row in zip(written["duration"].tolist(), told.itertuples(index=False), strict=True)
        ]
        self.longest = sorted([*self.longest, *rows])[:LONGEST]

    def _add_maneuvers(self, maneuvers: pd.DataFrame) -> None:
        label = maneuvers["label"]
        self.labels.update(label.tolist())
        changes = maneuvers["object"][label.isin(["lane_change_left", "lane_change_right"])]
        self.most_changes = max([self.most_changes, *Counter(changes.tolist()).values()])
        for _, name in VEHICLES:
            self.vehicles[name] += maneuvers["object"][label == name].nunique()
        if self.kinds:
            self.found.update({k: one.found or 0 for k, one in enumerate(count_kinds(self.kinds, maneuvers))})

    @property
    def scenarios(self) -> int:
        """How many there are."""
        return self.tags.total()

    @property
    def mean_duration(self) -> float:
        """Of the scenarios [s]."""
        return self._seconds / self.scenarios

    @property
    def mean_vehicles(self) -> float:
        """Of the scenarios, with the EGO."""
        return sum(vehicles * n for (vehicles, _), n in self.tags.items()) / self.scenarios


def statistics(counted: Counted) -> list[tuple[str, int]]:
    """Give Kaefer's Table 4.4."""
    out = [(name, sum(counted.labels[label] for label in labels)) for name, labels in SUMS]
    out.insert(3, ("Maximum lane changes", counted.most_changes))
    return [*out, *((name, counted.vehicles[label]) for name, label in VEHICLES)]


def buckets(counted: Counted) -> tuple[list[str], list[list[str]]]:
    """Give Wagner's Table 6.1: a column per map, road and direction, a row per number of vehicles with the EGO.

    The map is told where there are several: roads of two maps may share ids.
    """
    several = len({road for road, _, _ in counted.cells}) > 1
    named: Counter[tuple[str, int]] = Counter()
    for (road, column, vehicles), n in counted.cells.items():
        named[f"{road}, road {column}" if several else column, vehicles] += n
    columns, rows = sorted({column for column, _ in named}), sorted({vehicles for _, vehicles in named})
    return ["vehicles", *columns], [[str(n), *_cells(named[column, n] for column in columns)] for n in rows]


def _cells(row: Iterator[int]) -> list[str]:
    return [str(n) if n else "–" for n in row]
