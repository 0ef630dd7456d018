"""The drivers of traffic that reacts, held against real vehicles of SUMO that its own models drive."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

from resim.simulation.reactive.drivers import Following, TrafficDriver, followed

LENGTH = 4.7
DRIVERS = [
    TrafficDriver(30.0, 1.2, 2.0, 1.4, 2.0, reaction=0.0), TrafficDriver(22.0, 1.8, 3.0, 0.9, 1.5, reaction=0.0),
    TrafficDriver(35.0, 0.6, 1.5, 2.2, 3.0, reaction=0.0),
]  # fmt: skip


def in_sumo(
    folder: Path, vehicles: list[dict[str, Any]], *, lanes: int, step: float, steps: int
) -> list[Any]:
    scene = {"folder": str(folder), "lanes": lanes, "step": step, "steps": steps, "vehicles": vehicles}
    done = subprocess.run(
        [sys.executable, ROOT / "tools" / "sumo_vehicles.py"], input=json.dumps(scene), capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [{k: np.array(v) for k, v in one.items()} for one in json.loads(done.stdout.splitlines()[-1])]


def of_type(driver: TrafficDriver) -> dict[str, Any]:
    return {
        "carFollowModel": "IDM", "accel": driver.acceleration, "decel": driver.deceleration, "tau": driver.time_gap,
        "minGap": driver.standstill, "maxSpeed": driver.desired,
    }  # fmt: skip


@pytest.mark.parametrize("driver", DRIVERS, ids=["usual", "calm", "hasty"])
def test_a_driver_follows_as_a_vehicle_of_sumo_with_the_same_model(
    tmp_path: Path, driver: TrafficDriver
) -> None:
    """Over a minute behind a leader that brakes, stops and starts again, both by ballistic steps of 0.1 s, without a
    reaction time, which SUMO's model has none of."""
    t = np.arange(0.0, 60.0, 0.1)
    lead = np.interp(t, [0, 5, 12, 15, 20, 24, 30, 35, 45, 60], [20, 20, 9, 9, 24, 24, 0, 0, 15, 15])
    ahead, own = in_sumo(
        tmp_path,
        [
            {"s": 200.0, "lane": 0, "length": LENGTH, "speeds": lead.tolist()},
            {"s": 150.0, "lane": 0, "length": 5.0, "speeds": [20.0], "driver": {**of_type(driver), "stepping": 0.1}},
        ],
        lanes=1, step=0.1, steps=len(t),
    )  # fmt: skip
    gap = ahead["s"] - LENGTH - own["s"]
    assert np.ptp(gap) > 20.0
    given = Following(own["s"], own["v"], gap, ahead["v"], 0.1)
    np.testing.assert_allclose(followed(driver, given), gap, rtol=0, atol=1e-9)
    other = replace(driver, time_gap=1.1 * driver.time_gap)
    assert np.abs(followed(other, given) - gap).max() > 0.5


def test_it_changes_lanes_where_a_vehicle_of_sumo_does(tmp_path: Path) -> None:
    """In the first of the scenes of `tools/validate_drivers.py`, of which docs/validation.md has more."""
    order = [sys.executable, ROOT / "tools" / "validate_drivers.py", "--scenes", "8"]
    done = subprocess.run(order, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = {
        (ours, theirs): int(count)
        for ours, theirs, count in re.findall(
            r"^\| (changes|stays) \| (changes|stays) \| (\d+) \|", done.stdout, re.M
        )
    }
    assert len(found) == 4
    assert sum(found.values()) == 8
    assert found["changes", "changes"] + found["stays", "stays"] >= 7, done.stdout
