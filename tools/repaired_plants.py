"""What is left of planted faults after a repair: whether their finding is gone, and how far the samples are off."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from resim.core.finding import Finding
from resim.core.geometry import wrap_angle
from resim.core.schema import REPAIRED
from resim.recordings import RecordingTables
from resim.recordings.repairs import Repaired, repair
from resim.road.opendrive import RoadNetwork

HEAD = " | ".join([
    "repairable", "gone", "share", "GT position, median [m]", "95 % [m]", "speed, 95 % [m/s]",
    "heading, 95 % [rad]", "SD position, median [m]", "95 % [m]",
])  # fmt: skip
"""The columns: what is left is told of GT and SD rows, these with their noise on both sides."""
NO_TRUTH = ("id_reused",)
"""Kinds that move the object to where it never was: there is no truth to compare with."""


@dataclass
class Remains:
    """Counts of one kind, and what the rows that a repair touched are off the untouched recording."""

    repairable: int = 0
    gone: int = 0
    off: dict[str, list[np.ndarray]] = field(default_factory=lambda: defaultdict(list))

    def row(self, kind: str) -> str:
        """The cells of the table."""
        if not self.repairable:
            return "0" + " |" * (HEAD.count("|"))
        share = f"{100.0 * self.gone / self.repairable:.1f} %"
        cells = []
        for source, column, share_of in (
            ("gt", "p", 0.5), ("gt", "p", 0.95), ("gt", "v", 0.95), ("gt", "heading", 0.95), ("sd", "p", 0.5),
            ("sd", "p", 0.95),
        ):  # fmt: skip
            off = np.concatenate([np.zeros(0), *self.off[source + column]])
            value = f"{np.quantile(off, share_of):.2g}" if len(off) else ""
            cells.append("" if kind in NO_TRUTH else value)
        return f"{self.repairable} | {self.gone} | {share} | " + " | ".join(cells)

    def add(
        self, tables: RecordingTables, truth: RecordingTables, network: RoadNetwork, hit: list[Finding]
    ) -> Repaired:
        """Repair the tables in which these findings tell the plant."""
        result = repair(tables, network)
        if not any(_repairable(f) for f in hit):
            return result
        self.repairable += 1
        left = {(f.code, f.source, f.object) for f in result.left}
        gone = not any((f.code, f.source, f.object) in left for f in hit if _repairable(f))
        self.gone += gone
        for source in ("gt", "sd") if gone else ():
            frame, true = getattr(result.tables, source), getattr(truth, source)
            if REPAIRED in frame:
                rows = frame[frame[REPAIRED] != ""]
                if source == "sd":
                    rows = _with_gt(rows, result.tables.gt, truth.gt)
                for column, values in _off(rows, true).items():
                    self.off[source + column].append(values)
        return result


def _repairable(f: Finding) -> bool:
    """Whether a repair is offered: of notes for holes alone, of gaps up to 1 s."""
    asked = f.severity != "note" or f.code.startswith("MISSING")
    return bool(f.repair) and asked and (f.code != "GAP" or f.value < 1.0 + 1e-6)


def _with_gt(rows: pd.DataFrame, gt: pd.DataFrame, truth: pd.DataFrame) -> pd.DataFrame:
    """SD rows with the shift taken out that the GT, as it stands, has: clocks are only right beside each other."""
    out = rows.copy()
    for name, own in gt.groupby("id", sort=False):
        true = truth[truth["id"] == name]
        if len(true) == len(own):
            late = np.median(np.sort(own["t"].to_numpy()) - np.sort(true["t"].to_numpy()))
            out.loc[out["id"] == name, "t"] -= late if abs(late) > 0.2 else 0.0
    return out


def _off(rows: pd.DataFrame, truth: pd.DataFrame) -> dict[str, np.ndarray]:
    """How far the rows are off the true tracks of their ids, at their times."""
    out: dict[str, list[np.ndarray]] = defaultdict(list)
    for name, own in rows.groupby("id", sort=False):
        true = truth[truth["id"] == name]
        own = own[(own["t"] >= true["t"].min() - 0.02) & (own["t"] <= true["t"].max() + 0.02)]
        if not len(true) or not len(own):
            continue
        at = {c: np.interp(own["t"], true["t"], true[c]) for c in ("x", "y", "v")}
        heading = np.interp(own["t"], true["t"], np.unwrap(true["heading"]))
        out["p"].append(np.hypot(own["x"] - at["x"], own["y"] - at["y"]).to_numpy())
        out["v"].append(np.abs(own["v"] - at["v"]).to_numpy())
        out["heading"].append(np.abs(wrap_angle(own["heading"] - heading)))
    return {c: np.concatenate(values) for c, values in out.items()}
