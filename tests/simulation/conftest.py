from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from resim.road.opendrive import RoadNetwork
from resim.road.sumo import SumoNet
from resim.scenario.scenario import RoadPosition, Scenario, ScenarioObject
from resim.simulation.case import Case, SimulatedDrive
from resim.simulation.function.interface import Build, load_build
from resim.simulation.sumo.engine import Sumo

Member = Callable[..., ScenarioObject]
LANE = 3.5


@pytest.fixture
def member() -> Member:
    """Make an object on road 1 (straight, along +x) by its splines' values at even knots."""

    def make(
        name: str, s: float, v: object = 20.0, heading: object = 0.0, *, lane: int = -2, t: float = 0.0,
        start: float = 0.0, end: float = 4.0, length: float = 4.7, width: float = 1.9,
    ) -> ScenarioObject:  # fmt: skip
        def spline(values: object) -> CubicSpline:
            y = np.atleast_1d(np.asarray(values, dtype=float))
            y = np.repeat(y, 2) if len(y) == 1 else y
            return CubicSpline(np.linspace(start, end, len(y)), y, bc_type="natural")

        return ScenarioObject(
            name, "car", length, width, RoadPosition("1", lane, s, t), spline(v), spline(heading)
        )

    return make


@pytest.fixture
def drive(network: RoadNetwork, net: SumoNet) -> Callable[..., SimulatedDrive]:
    """Simulate EGO and objects with a build, as long as the EGO's trace."""

    def run(build: Build, ego: ScenarioObject, *objects: ScenarioObject, **options: Any) -> SimulatedDrive:
        scenario = Scenario("proving_ground.xodr", float(ego.v.x[-1] - ego.v.x[0]), ego, objects)
        return Case(scenario, network, build, Sumo(), **options).drive()

    return run


HEAD = """import math
import time
from resim.simulation.function.interface import Command, EgoState, Placement

class Own:
{members}
    def __init__(self, **parameters):
        self.__dict__.update(parameters)
        self.calls = []

    def reset(self, setup):
        {reset}

    def step(self, perceived):
        {step}

    def close(self):
        {close}
"""


@pytest.fixture
def function(write_build: Callable[..., Path]) -> Callable[..., Build]:
    """Make a build of a function whose methods have these bodies."""

    def make(step: str = "return Command(0.0, 0.0)", *, reset: str = "self.setup = setup", close: str = "pass",
             members: str = "", top: str = "", parameters: str = "") -> Build:  # fmt: skip
        bodies = {"members": "    " + members, "reset": reset, "step": step, "close": close}
        source = HEAD.format(
            **{k: v.replace("\n", "\n        ") if k != "members" else v for k, v in bodies.items()}
        )
        return load_build(write_build(source, top=top, parameters=parameters))

    return make
