"""Make the recordings that ship in scenarios/: virtual test drives on the proving ground.

Each is a closed-loop run of an AD function whose truth is recorded as ground truth with the noise of a
reference system, and whose perception is recorded as sensor data. Same source, same bytes.

    python tools/make_scenarios.py [NAME ...]
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from drives import DRIVES, Drive
from neighbours import NEIGHBOURS
from virtual_sensor import STEP, Sensor

from resim.core.geometry import Floats, wrap_angle
from resim.core.tracks import Tracks
from resim.recordings import Recording, write_recording
from resim.road.opendrive import RoadNetwork, load
from resim.road.path import lane_path
from resim.scenario.scenario import Scenario, describe
from resim.simulation.case import Case, SimulatedDrive
from resim.simulation.function.interface import EgoState, load_build
from resim.simulation.perception import IdealPerception
from resim.simulation.sumo.engine import Sumo

ROOT = Path(__file__).parents[1]
MAP = ROOT / "networks" / "proving_ground.xodr"
REFERENCE_NOISE = {"x": 0.01, "v": 0.05 / 3.6, "heading": np.radians(0.1)}
"""Standard deviations of the reference system: 1 cm, 0.05 km/h, 0.1° (the source's OxTS RT3000)."""


def stage(drive: Drive, network: RoadNetwork) -> Scenario:
    """Describe the drive before it is driven: the traffic's traces, and an EGO that keeps lane and speed."""
    road = next(iter(network.roads))
    path = lane_path(network, road, drive.ego_lane, drive.start, 600.0, behind=200.0)
    t = np.arange(0.0, drive.duration + 1e-9, STEP)
    motion = {"ego": (drive.ego_v * t, np.zeros_like(t)), **drive.traffic(path, t)}
    x, y = (np.array(c) for c in zip(*(path.xy(s, d) for s, d in motion.values()), strict=True))
    vx, vy = np.gradient(x, t, axis=1, edge_order=2), np.gradient(y, t, axis=1, edge_order=2)
    n = len(motion)
    tracks = Tracks(
        t=t, ids=np.array(list(motion)), kind=np.array(["car"] * n), x=x, y=y, heading=np.arctan2(vy, vx),
        v=np.hypot(vx, vy), length=np.full(n, 4.7), width=np.full(n, 1.9), valid=np.ones((n, len(t)), dtype=bool),
    )  # fmt: skip
    return describe(tracks, network, ego="ego", map_name=MAP.name)


def record(name: str, drive: Drive, folder: Path) -> SimulatedDrive:
    """Drive, and write the recording into the folder, which is replaced."""
    network = load(MAP)
    scenario = stage(drive, network)
    build = load_build(ROOT / "adfunc" / "builds" / f"{drive.build}.toml")
    sensor = Sensor(drive.sensor) if drive.sensor else None
    run = Case(
        scenario,
        network,
        build,
        Sumo(),
        sensor or IdealPerception(),
        step=STEP,
        seed=drive.seed,
        stop_at_collision=False,
    ).drive()
    if run.failure:
        raise SystemExit(run.failure)
    recording = Recording(
        name=name,
        map=MAP,
        ego="ego",
        gt=referenced(run.truth, drive.seed),
        gt_rate=1.0 / STEP,
        sd=sensed(run),
        sd_rate=1.0 / STEP,
        sd_gt_id=run.truth.ids,
        build=build.label,
        build_hash=build.hash,
        plan=planned(run),
        environment={"fogDensity": "ExcellentVisibility", "precipitationDensity": "None"},
        provenance={
            "description": drive.description,
            "source": f"virtual test drive, tools/make_scenarios.py, seed {drive.seed}",
            "sensor": str(drive.sensor),
        },
    )
    shutil.rmtree(folder, ignore_errors=True)
    write_recording(recording, folder, map_reference=os.path.relpath(MAP, folder))
    return run


def planned(run: SimulatedDrive) -> pd.DataFrame | None:
    """Give the function's plans as a recording has them, or None for a function that has none."""
    if not run.plans:
        return None
    rows = np.concatenate([np.column_stack([np.full(len(plan), t), plan]) for t, plan in run.plans])
    return pd.DataFrame(rows.round(6), columns=["t", "t_plan", "x", "y", "v"])


def referenced(truth: Tracks, seed: int) -> Tracks:
    """Give the truth as the reference system measures it."""
    rng = np.random.default_rng([seed, 2])

    def noisy(values: Floats, sigma: float) -> Floats:
        return values + sigma * rng.standard_normal(values.shape)

    return replace(
        truth,
        x=noisy(truth.x, REFERENCE_NOISE["x"]),
        y=noisy(truth.y, REFERENCE_NOISE["x"]),
        v=noisy(truth.v, REFERENCE_NOISE["v"]),
        heading=wrap_angle(noisy(truth.heading, REFERENCE_NOISE["heading"])),
        a=None,
        yaw_rate=None,
    )


def sensed(run: SimulatedDrive) -> Tracks:
    """Give what the function perceived, EGO first, in map coordinates."""
    seen = run.perceived
    positions = [p.map_positions() for p in seen]

    def rows(ego: Callable[[EgoState], float], objects: list[Floats]) -> Floats:
        return np.vstack([[ego(p.ego) for p in seen], np.array(objects).T])

    truth = run.truth
    x = rows(lambda e: e.x, [x for x, _ in positions])
    return Tracks(
        t=np.array([p.t for p in seen]), ids=truth.ids, kind=truth.kind, x=x,
        y=rows(lambda e: e.y, [y for _, y in positions]),
        heading=wrap_angle(rows(lambda e: e.heading, [p.heading_ego + p.ego.heading for p in seen])),
        v=rows(lambda e: e.v, [p.v for p in seen]),
        length=truth.length, width=truth.width, valid=np.isfinite(x),
    )  # fmt: skip


SHIPPED = DRIVES | {f"neighbours/{name}": drive for name, drive in NEIGHBOURS.items()}
"""By folder in scenarios/."""

if __name__ == "__main__":
    for wanted in sys.argv[1:] or SHIPPED:
        result = record(Path(wanted).name, SHIPPED[wanted], ROOT / "scenarios" / wanted)
        ended = f"ended by {result.end}, {len(result.collisions)} collisions"
        print(f"scenarios/{wanted}: {len(result.truth.t)} samples, {ended}")
