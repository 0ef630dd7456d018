"""Compare traffic that `resim traffic` makes with figures published of highD, and its truth with the lanes of the map.

    python tools/validate_traffic.py [HOURS [SEED]]

Krajewski et al. 2018: 110,000 vehicles, 45,000 km, 5,600 complete lane changes; each vehicle is visible for 13.6 s
(median) on 420 m. highD has no ramps: lane changes a km are those of road 3, behind the off-ramp, and of all roads.
"""

from __future__ import annotations

import sys
import tempfile
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.overlaps import first_overlaps
from resim.core.tracks import Tracks
from resim.jobs.check import check
from resim.jobs.traffic import make_traffic
from resim.recordings import read_recording
from resim.road.opendrive import RoadNetwork, load

ROOT = Path(__file__).parents[1]
MAP = ROOT / "networks" / "motorway.xodr"
PLAIN = ("3",)
"""Roads without ramps, and without lanes that end."""
VISIBLE, SECTION = 13.6, 420.0
HIGHD_HOURS, HIGHD_VEHICLES, HIGHD_LANES = 16.5, 110_500, (4, 6)
"""Of all recordings; lanes of both ways together, two or three each."""
STEP = 25
"""Samples between those of which gaps are taken: one a second."""


def main() -> int:
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 0.5
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    network = load(MAP)
    with tempfile.TemporaryDirectory() as name:
        made = [*make_traffic(MAP, Path(name) / "traffic", hours=hours, seed=seed)]
        rows = [measured(network, one.folder) for one in made]
    table = pd.DataFrame(rows)
    left = {vehicle for one in made for vehicle, _ in one.left_out}
    report(table, len(left), hours)
    return 0


def measured(network: RoadNetwork, folder: Path) -> dict[str, object]:
    """Figures of one recording."""
    tracks = read_recording(folder).gt
    truth = pd.read_csv(folder / "truth.csv")
    changes = truth[truth["label"].str.startswith("lane_change")]
    own = Tracks(**{name: getattr(tracks, name) for name in Tracks.__dataclass_fields__})
    row, k = np.nonzero(own.valid)
    at = network.to_road(own.x[row, k], own.y[row, k], heading=own.heading[row, k])
    plain = np.isin(at.road, PLAIN)
    km = np.abs(own.v[row, k]) / 25.0 / 1000.0
    here = changes["lane_from"].str.partition("/")[0].isin(PLAIN)
    v = own.v[row, k]
    car = own.kind[row] == "car"
    found = [f"{one.code} of {one.object}" for one in check(folder).findings]
    lanes = sum(len(np.unique(at.lane[at.road == name])) * network.roads[name].length for name in PLAIN)
    return {
        "km": km.sum(), "plain_km": km[plain].sum(), "changes": len(changes), "plain_changes": int(here.sum()),
        "cars": float(v[plain & car].mean()), "trucks": float(v[plain & ~car].mean()),
        "plain_v": pd.Series(v[plain]).groupby(row[plain]).mean().tolist(), "headway": headways(own, at, row, k, plain),
        "lasts": (changes["end"] - changes["start"]).tolist(), "findings": found,
        "overlaps": len(first_overlaps(own)), "vehicles": len(own), "truck_share": float((own.kind == "truck").mean()),
        "late": crossed(network, own, changes), "lane_km_s": float(np.ptp(own.t)) * lanes / 1000.0,
    }  # fmt: skip


def headways(tracks: Tracks, at: object, row: np.ndarray, k: np.ndarray, plain: np.ndarray) -> list[float]:
    """Time gaps [s], front to rear, of who follows in a lane, below 4 s; on plain roads, one a second."""
    take = plain & (k % STEP == 0)
    table = pd.DataFrame({
        "k": k[take], "lane": at.lane[take], "s": at.s[take], "v": tracks.v[row[take], k[take]],
        "half": 0.5 * tracks.length[row[take]],
    }).sort_values(["k", "lane", "s"])  # fmt: skip
    ahead = table.groupby(["k", "lane"])[["s", "half"]].shift(-1)
    gap = (ahead["s"] - table["s"] - ahead["half"] - table["half"]) / table["v"]
    return gap[(gap > 0.0) & (gap < 4.0)].tolist()


def crossed(network: RoadNetwork, tracks: Tracks, changes: pd.DataFrame) -> list[float]:
    """By how much [s] the first sample in another lane is later than the truth says: 0 to one sample."""
    out = []
    for one in changes.itertuples():
        n = tracks.index(str(one.object))
        near = np.flatnonzero(tracks.valid[n] & (np.abs(tracks.t - one.t) < 1.0))
        if len(near) < 40:
            continue
        at = network.to_road(tracks.x[n, near], tracks.y[n, near], heading=tracks.heading[n, near])
        target = int(str(one.lane_to).partition("/")[2])
        changed = np.flatnonzero(at.lane == target)
        out.append(float(tracks.t[near[changed[0]]] - one.t) if len(changed) else np.inf)
    return out


def report(table: pd.DataFrame, left: int, hours: float) -> None:
    def pooled(name: str) -> np.ndarray:
        return np.concatenate([np.array(one, dtype=float) for one in table[name]])

    late, lasts, gaps, v = (pooled(name) for name in ("late", "lasts", "headway", "plain_v"))
    print(f"{hours:g} h, {table['km'].sum():.0f} km; left out: {left} vehicles\n")
    print("| figure | here | highD |\n|---|---|---|")
    print(
        f"| speed, median of the vehicles [m/s] | {np.median(v):.1f} | {SECTION / VISIBLE:.1f} (420 m in 13.6 s) |"
    )
    print(f"| speed of cars, of trucks [m/s] | {table['cars'].mean():.1f}, {table['trucks'].mean():.1f} | |")
    print(f"| trucks | {table['truck_share'].mean():.2f} | |")
    print(
        f"| lane changes a km, without ramps | {table['plain_changes'].sum() / table['plain_km'].sum():.3f} | 0.124 |"
    )
    print(f"| lane changes a km, all | {table['changes'].sum() / table['km'].sum():.3f} | |")
    print(
        f"| time gaps under 4 s: median, 10 % [s] | {np.median(gaps):.2f}, {np.quantile(gaps, 0.1):.2f} | |"
    )
    gross = table["lane_km_s"].sum() / table["plain_km"].sum()
    published = " to ".join(f"{3600.0 * HIGHD_HOURS * n / HIGHD_VEHICLES:.1f}" for n in HIGHD_LANES)
    print(
        f"| time from vehicle to vehicle in a lane, mean [s] | {gross:.1f} | {published} (16.5 h, 110,500 vehicles) |"
    )
    print(f"| duration of lane changes: mean, sd [s] | {lasts.mean():.2f}, {lasts.std():.2f} | |")
    print(
        f"\nfindings: {', '.join(chain(*table['findings'])) or 'none'}; overlaps: {table['overlaps'].sum()}"
    )
    ms = late * 1e3
    print(
        f"first sample beyond the border: {ms.min():.1f} to {ms.max():.1f} ms after the truth's moment ({len(ms)})"
    )


if __name__ == "__main__":
    sys.exit(main())
