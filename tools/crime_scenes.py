"""Evaluate CommonRoad-CriMe on scenes of two cars: run by validate_crime.py in CriMe's own environment.

python crime_scenes.py IN.json OUT.json; nothing of resim is imported, nor is this imported by resim.
"""

from __future__ import annotations

import json
import logging
import math
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
from commonroad.geometry.shape import Rectangle
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
from commonroad.scenario.scenario import Scenario
from commonroad.scenario.state import InitialState, KSState
from commonroad.scenario.trajectory import Trajectory
from commonroad_crime.data_structure.configuration import CriMeConfiguration
from commonroad_crime.measure import DCE, THW, TTB, TTC, TTCE, TTK, TTR, TTS, WTTC, ALongReq, TTCStar

EGO, OTHER, CROSSING = 101, 102, 20
FIRST = 11  # id of the rightmost lane
BEHIND, AHEAD, SPACING = -300.0, 700.0, 10.0  # m; the road reaches far beyond what is driven
MEASURES = {
    m.measure_name.name: m for m in (TTC, TTCStar, THW, WTTC, TTB, TTK, TTS, TTR, ALongReq, DCE, TTCE)
}
"""By the names that the input asks for."""


def main() -> None:
    """Evaluate all scenes of the input."""
    logging.disable(logging.CRITICAL)
    given = json.loads(Path(sys.argv[1]).read_text())
    _evaluate(given, given["scenes"][0])  # what is paid once is not counted
    told = {s["name"]: _evaluate(given, s) for s in given["scenes"]}
    Path(sys.argv[2]).write_text(json.dumps({"version": version("commonroad-crime"), "scenes": told}))


def _evaluate(given: dict, scene: dict) -> dict:
    """Give value and seconds of each measure; a text where there is no number."""
    config = CriMeConfiguration()
    config.update(ego_id=EGO, sce=_scenario(given, scene))
    config.debug.draw_visualization = False
    config.time.steer_width = scene["steer_width"]
    return {name: _one(MEASURES[name], config) for name in scene["measures"]}


def _one(measure: type, config: CriMeConfiguration) -> dict:
    began = time.perf_counter()
    try:
        value = measure(config).compute_criticality(0, verbose=False)
        told = str(value) if value is None or not math.isfinite(value) else float(value)
    except Exception as error:
        told = f"{type(error).__name__}: {error}"
    return {"value": told, "seconds": time.perf_counter() - began}


def _scenario(given: dict, scene: dict) -> Scenario:
    scenario = Scenario(dt=given["step"])
    scenario.add_objects(LaneletNetwork.create_from_lanelet_list(_lanelets(given["lane_width"], scene)))
    for number, who in ((EGO, "ego"), (OTHER, "other")):
        scenario.add_objects(_car(number, scene[who], *given["size"]))
    scenario.assign_obstacles_to_lanelets()
    return scenario


def _lanelets(width: float, scene: dict) -> list[Lanelet]:
    """Lanes of one direction, the middle one along the scene's x axis; a lane across them where it is asked for."""
    x = np.arange(BEHIND, AHEAD + 0.5 * SPACING, SPACING)
    turn, n = scene["road_heading"], scene["lanes"]
    lanes = [
        _lanelet(
            FIRST + i, x, (i - n // 2) * width, width, turn,
            FIRST + i + 1 if i < n - 1 else None, FIRST + i - 1 if i else None,
        )
        for i in range(n)
    ]  # fmt: skip
    if scene["crossing_at"] is not None:
        lanes.append(_lanelet(CROSSING, x, -scene["crossing_at"], width, turn + 0.5 * math.pi, None, None))
    return lanes


def _lanelet(number: int, x: np.ndarray, middle: float, width: float, turn: float, left: int | None,
             right: int | None) -> Lanelet:  # fmt: skip
    def line(t: float) -> np.ndarray:
        c, s = math.cos(turn), math.sin(turn)
        return np.column_stack([c * x - s * t, s * x + c * t])

    return Lanelet(
        line(middle + 0.5 * width), line(middle), line(middle - 0.5 * width), number,
        adjacent_left=left, adjacent_left_same_direction=None if left is None else True,
        adjacent_right=right, adjacent_right_same_direction=None if right is None else True,
    )  # fmt: skip


def _car(number: int, states: list[list[float]], length: float, width: float) -> DynamicObstacle:
    shape = Rectangle(length=length, width=width)
    x, y, heading, v = states[0]
    first = InitialState(
        position=np.array([x, y]), orientation=heading, velocity=v, yaw_rate=0.0, slip_angle=0.0, time_step=0
    )
    later = [
        KSState(position=np.array([x, y]), orientation=heading, velocity=v, steering_angle=0.0, time_step=i)
        for i, (x, y, heading, v) in enumerate(states[1:], start=1)
    ]
    prediction = TrajectoryPrediction(Trajectory(1, later), shape)
    return DynamicObstacle(number, ObstacleType.CAR, shape, first, prediction)


if __name__ == "__main__":
    main()
