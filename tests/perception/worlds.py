"""Worlds whose truth is known, models, and what sensors perceive of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from resim.perception.model import QUANTITIES, PerceptionModel
from resim.perception.runtime.sensor import Sensor
from resim.simulation.function.interface import EgoState, Perceived
from resim.simulation.perception import Perception, World, worlds_of

MODELS = Path(__file__).parents[2] / "adfunc" / "perception"
STEP = 0.04
COLUMNS = ("x_ego", "y_ego", "heading_ego", "v", "length", "width")
"""Of `Perceived`, in the order of QUANTITIES but for heading and speed."""
PLACES = dict(zip(("longitudinal", "lateral", "heading", "speed", "length", "width"), COLUMNS, strict=True))

Motion = Callable[[float], tuple[Any, Any, Any]]


def model(**parts: Any) -> PerceptionModel:
    return PerceptionModel.model_validate({"schema": "resim-perception-1", "name": "test", **parts})


def steps(duration: float, dt: float = STEP) -> list[float]:
    return [round(k * dt, 9) for k in range(round(duration / dt) + 1)]


def world(t: float, position: Any, heading: Any, v: Any, ego: EgoState, ids: Sequence[str] = ()) -> World:
    place = np.atleast_1d(np.asarray(position, dtype=complex))
    n = len(place)
    names = np.array(list(ids) or [f"{k}" for k in range(n)], dtype=str)
    heading, v = (np.broadcast_to(np.asarray(c, dtype=float), n).copy() for c in (heading, v))
    return World(t, ego, names, np.full(n, "car"), place, heading, v, np.full(n, 4.7), np.full(n, 1.9))


def ego_at(t: float) -> EgoState:
    return EgoState(23.0 * t, 5.0, 0.02 * t, 23.0)


def standing(t: float) -> EgoState:
    return EgoState(0.0, 0.0, 0.0, 0.0)


def look(
    perception: Perception,
    motion: Motion,
    times: Sequence[float],
    ego: Callable[[float], EgoState] = ego_at,
    seed: int = 1,
) -> list[Perceived]:
    rng = np.random.default_rng(seed)
    if isinstance(perception, Sensor):
        perception.reset(rng)
        return [perception.perceive(world(t, *motion(t), ego(t))) for t in times]
    batch = perception.together((), [rng])
    assert batch is not None
    return [batch.perceive(worlds_of(world(t, *motion(t), ego(t)))).of(0) for t in times]


def column(seen: list[Perceived], name: str) -> np.ndarray:
    return np.array([getattr(p, name) for p in seen])


def same(one: Perceived, two: Perceived) -> bool:
    return (
        one.t == two.t
        and one.ego == two.ego
        and all(np.array_equal(getattr(one, f.name), getattr(two, f.name)) for f in fields(Perceived)[2:-1])
        and np.array_equal(one.z_ego, two.z_ego, equal_nan=True)
    )


def ring(n: int, distance: float = 30.0) -> Motion:
    """Objects that stand around the EGO."""
    place = distance * np.exp(1j * np.linspace(-3.0, 3.0, n))
    return lambda t: (place, np.zeros(n), np.zeros(n))


def changing(t: float) -> World:
    """Objects that come, go and turn round."""
    ids = [
        name
        for name, first, last in (("a", 0, 9), ("b", 1, 3), ("c", 2, 9), ("b", 5, 9))
        if first <= t < last
    ]
    n = len(ids)
    k = np.arange(n) + 1.0
    return world(
        t, 20 * t * k + 1j * k, np.angle(np.exp(1j * (t * k + 1.0))), 20 + np.sin(k * t), ego_at(t), ids
    )


def ramp(t: float) -> tuple[Any, Any, Any]:
    return 30.0 + 20.0 * t + t * t + 3.5j + 1j * t, 0.3 * t + 2.9, 20.0 + 2.0 * t


def correlation(x: np.ndarray, y: np.ndarray, lag: int) -> float:
    return float(np.mean(x[: len(x) - lag] * y[lag:]) / np.sqrt(np.mean(x * x) * np.mean(y * y)))


def everything() -> PerceptionModel:
    spread = {"constant": 0.1, "range": 0.005}
    error: dict[str, Any] = {
        q: {"bias": {"constant": 0.1}, "drift": spread, "noise": spread} for q in QUANTITIES
    }
    own = {"bias": 0.1, "drift": 0.05, "noise": 0.05}
    return model(
        latency={"position": 0.1, "speed": 0.5, "heading": 0.5},
        averaging={"speed": 1.0, "heading": 0.4},
        errors=error,
        maneuvers={"braking": {"errors": error, "latency": {"position": 0.12}}},
        detection={
            "range_edges": (0, 50, 200), "bearing_edges": (0, 1, 4), "occlusion_edges": (0, 0.5, 1),
            "loss": (((0.1, 0.5),) * 2, ((0.4, 1.0),) * 2), "gain": (((5.0, 2.0),) * 2, ((3.0, 1.0),) * 2),
        },
        field_of_view={"range": 150.0},
        update={"period": 0.08, "jitter": 0.01},
        id_switch=0.05,
        false_objects={"rate": 0.3},
        ego={"longitudinal": own, "heading": {"noise": 1e-3}},
        validity={"range": (0.0, 100.0), "relative_speed": (-15.0, 15.0)},
    )  # fmt: skip


def traffic(n: int) -> Motion:
    k = np.arange(n)

    def motion(t: float) -> tuple[Any, Any, Any]:
        v = 22.0 + k + np.sin(t + k)
        return 20.0 * k - 40.0 + (22.0 + k) * t - np.cos(t + k) + 3.5j * (k % 3), 0.02 * np.sin(t + k), v

    return motion


def as_bytes(seen: list[Perceived]) -> list[bytes]:
    return [b"".join(np.asarray(getattr(p, f.name)).tobytes() for f in fields(Perceived)[2:]) for p in seen]
