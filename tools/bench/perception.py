"""A cycle of a perception model in the loop: with all of its parts, and with less; beside
`IdealPerception` and the sensor of tools/virtual_sensor.py.

Ten objects around the EGO on a motorway at 25 Hz; some of them brake, some change lane, some hide others.

    python tools/bench/perception.py [--repeat 15]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from resim.perception.model import FEATURES, QUANTITIES, PerceptionModel
from resim.perception.runtime.sensor import Sensor
from resim.scenario.maneuvers import MANEUVERS
from resim.simulation.function.interface import EgoState
from resim.simulation.perception import IdealPerception, Perception, World

sys.path.insert(0, str(Path(__file__).parents[1]))
from virtual_sensor import Sensor as VirtualSensor

STEP, DURATION, OBJECTS, LANE = 0.04, 20.0, 10, 3.5


def motorway(n: int) -> list[World]:
    """The truth, step by step: n objects in three lanes, 25 m apart in each; one brakes, one changes lane."""
    t = np.arange(0.0, DURATION, STEP)
    k = np.arange(n)
    lane, place = k % 3, 25.0 * (k // 3) - 30.0 + 8.0 * (k % 3)
    v = np.broadcast_to(25.0 + 1.5 * lane, (len(t), n)).copy()
    v[:, 1] -= np.clip(t - 5.0, 0.0, 2.5) * 3.0 - np.clip(t - 12.0, 0.0, 5.0) * 1.5
    v += 0.3 * np.sin(0.3 * t[:, None] + k)
    u = np.clip((t - 8.0) / 4.0, 0.0, 1.0)
    y = np.broadcast_to(LANE * (lane - 1.0), (len(t), n)).copy()
    y[:, 4] += LANE * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    heading = np.arctan2(np.gradient(y, t, axis=0), v)
    position = place + np.cumsum(v, axis=0) * STEP + 1j * y
    ids, kind = np.array([f"{n}" for n in k]), np.full(n, "car")
    length, width = np.full(n, 4.7), np.full(n, 1.9)
    return [
        World(now, EgoState(25.0 * now, 0.0, 0.0, 25.0), ids, kind, p, h, s, length, width)
        for now, p, h, s in zip(t.tolist(), position, heading, v, strict=True)
    ]


def parts() -> dict[str, Any]:
    """A model with all parts, of the sizes of the sensor of tools/virtual_sensor.py."""
    slopes = dict.fromkeys(FEATURES, 0.003)
    error = {
        q: {
            "bias": {"constant": 0.1, **slopes}, "drift": {"constant": 0.1, **slopes},
            "noise": {"constant": 0.03, **slopes}, "correlation_time": 2.0,
        }
        for q in QUANTITIES
    }  # fmt: skip
    late = {"position": 0.07, "speed": 0.8, "heading": 0.8}
    objects = {
        "latency": late,
        "averaging": {"speed": 1.6, "heading": 1.6},
        "errors": error | {"coupling": (0.7 * np.eye(6) + 0.3).tolist()},
    }
    own = {"bias": 0.1, "drift": 0.1, "noise": 0.05}
    return {
        **objects,
        "maneuvers": dict.fromkeys(MANEUVERS, objects),
        "detection": {
            "range_edges": (0, 30, 60, 90, 150), "bearing_edges": (0, 0.3, 1, 3.2), "occlusion_edges": (0, 0.3, 0.7, 1),
            "loss": np.full((4, 3, 3), 0.2).tolist(), "gain": np.full((4, 3, 3), 3.0).tolist(),
        },
        "field_of_view": {"range": 120.0, "bearing": 2.5},
        "id_switch": 0.02,
        "false_objects": {"rate": 0.1},
        "ego": {"longitudinal": own, "lateral": own, "heading": {"noise": 2e-4}, "speed": own},
        "validity": {"range": (0, 150), "relative_speed": (-10, 10), "ego_speed": (0, 40)},
    }  # fmt: skip


def cases() -> dict[str, Perception]:
    """What to measure, by name."""

    def sensor(**other: Any) -> Sensor:
        return Sensor(
            PerceptionModel.model_validate({"schema": "resim-perception-1", "name": "bench", **other})
        )

    whole = parts()

    def without(*names: str, **other: Any) -> Sensor:
        return sensor(**{k: v for k, v in whole.items() if k not in names} | other)

    flat = whole["detection"] | {"occlusion_edges": (0, 1)}
    flat |= {name: [[row[:1] for row in table] for table in flat[name]] for name in ("loss", "gain")}
    return {
        "Ideal": IdealPerception(),
        "virtual sensor": VirtualSensor(),
        "model: nothing": sensor(),
        "model: latency": sensor(latency=whole["latency"]),
        "model: errors": sensor(errors=whole["errors"]),
        "all parts": sensor(**whole),
        "all, a list each 0.08 s": sensor(**whole, update={"period": 0.08, "jitter": 0.01}),
        "all but maneuvers": without("maneuvers"),
        "all but detection": without("detection"),
        "all but occlusion": without(detection=flat),
        "all but errors": without("errors", "maneuvers"),
        "all but latency": without("latency", "averaging", "maneuvers"),
        "all but the EGO's own": without("ego"),
    }


def measure(
    perceptions: dict[str, Perception], worlds: list[World], repeat: int
) -> dict[str, tuple[float, float]]:
    """Give the median over `repeat` runs, in turns, of the time [µs] of a cycle, and that of the fastest run."""
    took: dict[str, list[float]] = {name: [] for name in perceptions}
    for seed in range(repeat + 1):
        for name, perception in perceptions.items():
            perception.reset(np.random.default_rng(seed))
            perceive = perception.perceive
            begin = time.perf_counter()
            for world in worlds:
                perceive(world)
            took[name].append(1e6 * (time.perf_counter() - begin) / len(worlds))
    return {name: (float(np.median(each[1:])), min(each[1:])) for name, each in took.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=15)
    repeat = parser.parse_args().repeat
    worlds = motorway(OBJECTS)
    took = measure(cases(), worlds, repeat)
    print(f"{OBJECTS} objects, {len(worlds)} cycles at {1 / STEP:.0f} Hz, {repeat} runs of each in turns")
    print(f"{'µs a cycle':26} {'median':>8} {'fastest':>8}")
    for name, (median, fastest) in took.items():
        print(f"{name:26} {median:8.1f} {fastest:8.1f}")
    figures = {"cycle_us": "all parts", "ideal_us": "Ideal", "virtual_sensor_us": "virtual sensor"}
    medians = {figure: round(took[name][0], 2) for figure, name in figures.items()}
    print(json.dumps(medians | {"cycle_fastest_us": round(took["all parts"][1], 2)}))


if __name__ == "__main__":
    main()
