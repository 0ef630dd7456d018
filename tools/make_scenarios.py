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
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.geometry import Floats, from_frame, to_frame, wrap_angle
from resim.core.tracks import Tracks
from resim.ingest import Recording, write_recording
from resim.road.opendrive import RoadNetwork, load
from resim.road.path import Path as LanePath
from resim.road.path import lane_path
from resim.road.sumo import sumo_net
from resim.scenario.scenario import Scenario, describe
from resim.sim.adfunction import EgoState, Perceived, load_build
from resim.sim.loop import simulate
from resim.sim.perception import World
from resim.sim.run import Run

ROOT = Path(__file__).parents[1]
MAP = ROOT / "networks" / "proving_ground.xodr"
STEP = 0.04
LANE = 3.5
REFERENCE_NOISE = {"x": 0.01, "v": 0.05 / 3.6, "heading": np.radians(0.1)}
"""Standard deviations of the reference system: 1 cm, 0.05 km/h, 0.1° (the source's OxTS RT3000)."""


@dataclass(frozen=True)
class SensorErrors:
    """Errors of the virtual sensors, of the sizes of Wagner 2021, Section 5.2.1.

    too_far, drift [m]: mean and standard deviation of an object's distance error, forwards, and drift_time [s]
    its correlation time. noise [m]: white noise of an object's position. window [s]: speed and heading of
    objects are the slope of a line through their positions over this time, so they are half of it late.
    ego_x, ego_y, ego_noise [m]: localisation error of the EGO, mean forwards and left, and white noise;
    ego_v [m/s] its mean speed error and ego_v_noise its white noise; ego_heading_noise [rad].
    """

    too_far: float = 1.53
    drift: float = 0.25
    drift_time: float = 2.0
    noise: float = 0.03
    window: float = 1.6
    ego_x: float = -0.10
    ego_y: float = 0.19
    ego_noise: float = 0.05
    ego_v: float = 0.036
    ego_v_noise: float = 0.042
    ego_heading_noise: float = 1.8e-4


class Sensor:
    """A perception whose objects are too far ahead, and whose speeds and headings are derived, hence late."""

    def __init__(self, errors: SensorErrors = SensorErrors()) -> None:
        self.errors = errors

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last drive."""
        self.rng = rng
        self.drift: dict[str, float] = {}
        self.seen: dict[str, list[tuple[float, float, float]]] = {}

    def perceive(self, world: World) -> Perceived:
        """Give what the sensors make of the world."""
        ego = self.localise(world.ego)
        true = world.ego
        x, y = to_frame(world.position.real, world.position.imag, true.x, true.y, true.heading)
        x = x + np.array([self.wander(name) for name in world.ids.tolist()])
        x = x + self.errors.noise * self.rng.standard_normal(len(x))
        y = y + self.errors.noise * self.rng.standard_normal(len(y))
        map_x, map_y = from_frame(x, y, ego.x, ego.y, ego.heading)
        motion = [
            self.derive(name, world.t, px, py, h, v)
            for name, px, py, h, v in zip(
                world.ids.tolist(),
                map_x.tolist(),
                map_y.tolist(),
                world.heading.tolist(),
                world.v.tolist(),
                strict=True,
            )
        ]
        v, heading = np.array(motion).reshape(len(motion), 2).T
        turned = wrap_angle(heading - ego.heading)
        return Perceived(world.t, ego, world.ids, world.kind, x, y, turned, v, world.length, world.width)

    def localise(self, ego: EgoState) -> EgoState:
        """Give the EGO's state as its own sensors have it."""
        e, rng = self.errors, self.rng
        x, y = from_frame(
            e.ego_x + e.ego_noise * rng.standard_normal(), e.ego_y + e.ego_noise * rng.standard_normal(),
            ego.x, ego.y, ego.heading,
        )  # fmt: skip
        v = ego.v + e.ego_v + e.ego_v_noise * rng.standard_normal()
        heading = ego.heading + e.ego_heading_noise * rng.standard_normal()
        return replace(ego, x=float(x), y=float(y), v=v, heading=heading)

    def wander(self, name: str) -> float:
        """Give the object's distance error [m]: a first-order autoregression about its mean."""
        e = self.errors
        keep = np.exp(-STEP / e.drift_time)
        last = self.drift.get(name, e.drift * self.rng.standard_normal())
        self.drift[name] = keep * last + e.drift * np.sqrt(1.0 - keep**2) * self.rng.standard_normal()
        return e.too_far + self.drift[name]

    def derive(
        self, name: str, t: float, x: float, y: float, heading: float, v: float
    ) -> tuple[float, float]:
        """Give speed and heading from the positions of the last `window` seconds."""
        track = self.seen.setdefault(name, [])
        track.append((t, x, y))
        while track[0][0] < t - self.errors.window - 1e-9:
            track.pop(0)
        if t - track[0][0] < 0.5 * self.errors.window:
            return v, heading
        times, xs, ys = np.array(track).T
        times = times - times.mean()
        vx, vy = (float(times @ c / (times @ times)) for c in (xs, ys))
        return float(np.hypot(vx, vy)), float(np.arctan2(vy, vx))


@dataclass(frozen=True)
class Drive:
    """A test drive to make: what the traffic does, who drives, what it sees."""

    description: str
    build: str
    duration: float
    ego_lane: int
    ego_v: float
    traffic: Callable[[LanePath, Floats], dict[str, tuple[Floats, Floats]]]
    sensor: SensorErrors | None
    seed: int = 1


START_S = 300.0


def profile(t: Floats, v: float, *changes: tuple[float, float, float]) -> Floats:
    """Distance [m] at times t of an object at speed v [m/s] that accelerates by a [m/s²] from t0 to t1 [s].

    Accelerations build up and fade over 0.3 s.
    """
    fine = np.arange(t[0], t[-1] + 1e-3, 1e-3)
    a = np.zeros_like(fine)
    for t0, t1, amount in changes:
        a += amount * np.clip(np.minimum((fine - t0) / 0.3, (t1 - fine) / 0.3), 0.0, 1.0)
    speed = np.maximum(v + np.concatenate([[0.0], np.cumsum(0.5e-3 * (a[1:] + a[:-1]))]), 0.0)
    way = np.concatenate([[0.0], np.cumsum(0.5e-3 * (speed[1:] + speed[:-1]))])
    return np.interp(t, fine, way)


def swerve(t: Floats, begin: float, duration: float, to: float) -> Floats:
    """Lateral offset [m] of a lane change to `to` [m] that begins at `begin` [s]."""
    u = np.clip((t - begin) / duration, 0.0, 1.0)
    return to * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)


def cut_in_brake(path: LanePath, t: Floats) -> dict[str, tuple[Floats, Floats]]:
    """The traffic object comes from 11 m behind at 32.5 m/s on the left, cuts in, brakes at 4 m/s²."""
    return {
        "1": (-11.0 + profile(t, 32.5, (CUT_BRAKE, 20.0, -4.0)), LANE - swerve(t, CUT_BEGIN, CUT_TIME, LANE))
    }


CUT_BEGIN, CUT_TIME, CUT_BRAKE = 2.0, 3.0, 3.7


def rear_end(path: LanePath, t: Floats) -> dict[str, tuple[Floats, Floats]]:
    """A slow traffic object 52 m ahead (bumper to bumper)."""
    return {"1": (52.0 + 4.7 + profile(t, 10.0), np.zeros_like(t))}


def overtake(path: LanePath, t: Floats) -> dict[str, tuple[Floats, Floats]]:
    """One overtakes on the left and goes on; one drives well ahead, one well behind."""
    return {
        "1": (-25.0 + profile(t, 30.0), LANE * np.ones_like(t)),
        "2": (90.0 + profile(t, 26.0), np.zeros_like(t)),
        "3": (-60.0 + profile(t, 24.5), np.zeros_like(t)),
    }


DRIVES = {
    "cut_in_brake": Drive(
        "Cut-in and braking of an overtaking object: the corner case of Wagner 2021, Section 5.2",
        "highway_pilot-1.0", 9.2, -2, 23.7, cut_in_brake, SensorErrors(),
    ),
    "rear_end": Drive(
        "Rear-end collision with a slow object that the function ignores: Wagner 2021, Section 4.2.2.1",
        "constant_velocity-1.0", 4.84, -2, 21.0, rear_end, SensorErrors(),
    ),
    "overtake": Drive(
        "An uncritical overtaking on the left", "highway_pilot-1.0", 10.0, -2, 25.0, overtake, SensorErrors()
    ),
}  # fmt: skip


def stage(drive: Drive, network: RoadNetwork) -> Scenario:
    """Describe the drive before it is driven: the traffic's traces, and an EGO that keeps lane and speed."""
    road = next(iter(network.roads))
    path = lane_path(network, road, drive.ego_lane, START_S, 600.0, behind=200.0)
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


def record(name: str, drive: Drive, folder: Path) -> Run:
    """Drive, and write the recording into the folder, which is replaced."""
    network = load(MAP)
    scenario = stage(drive, network)
    build = load_build(ROOT / "adfunc" / "builds" / f"{drive.build}.toml")
    sensor = Sensor(drive.sensor) if drive.sensor else None
    run = simulate(
        scenario, network, sumo_net(network).path, build, step=STEP, seed=drive.seed, perception=sensor,
        stop_at_collision=False,
    )  # fmt: skip
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


def planned(run: Run) -> pd.DataFrame | None:
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


def sensed(run: Run) -> Tracks:
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


if __name__ == "__main__":
    for wanted in sys.argv[1:] or DRIVES:
        result = record(wanted, DRIVES[wanted], ROOT / "scenarios" / wanted)
        ended = f"ended by {result.end}, {len(result.collisions)} collisions"
        print(f"scenarios/{wanted}: {len(result.truth.t)} samples, {ended}")
