"""A measured drive as an environment of gymnasium: an agent at the wheel, in the loop that a function drives in.

Needs the extra `gym`. `docs/guides/outside.md` has an example.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any, cast

import numpy as np

from resim.core.errors import InputError
from resim.core.geometry import Floats
from resim.jobs.given import File, the_perception, the_recording
from resim.perception.model import PerceptionModel
from resim.perception.runtime.sensor import Sensor
from resim.recordings import Recording
from resim.resimulation.result import Basis
from resim.resimulation.run import prepare
from resim.simulation.case import STEP, Case
from resim.simulation.direct import Direct
from resim.simulation.function.interface import Build
from resim.simulation.perception import IdealPerception
from resim.simulation.stepped import SteppedDrive
from resim.simulation.vehicles.registry import vehicle_model

try:
    import gymnasium
    from gymnasium import spaces
except ImportError as e:
    raise InputError("resim.gym", "needs gymnasium", "In resim's own folder: pip install '.[gym]'") from e

HARDEST, TIGHTEST = 10.0, 0.2
MOST = np.array([HARDEST, TIGHTEST])
"""m/s² and 1/m: bounds of actions."""
FAR = 1e9
"""Bound of all that is observed [m, rad, m/s]."""
LONGEST_STEP = 1.0
"""s between two actions at most."""
CRASH = -100.0
"""Reward for a collision, and for leaving the road."""
OBJECT = ("x_ego", "y_ego", "heading_ego", "v", "length", "width")
"""Columns of an observed object."""
Observation = dict[str, Any]


class DriveEnvironment(gymnasium.Env[Observation, Floats]):
    """The ground truth of a recording, with the EGO driven by actions from its start on.

    Observation: `ego` (6,): x, y [m], heading [rad] in the map, v [m/s], a [m/s²], yaw rate [rad/s]. `objects`
    (objects, 6): of the nearest, nearest first, x, y [m] and heading [rad] in the EGO's frame, v [m/s], length, width
    [m]; 0 where there is none. `present` (objects,): 1 where there is one.

    Action (2,): acceleration [m/s²] and curvature [1/m, left positive], up to HARDEST and TIGHTEST.

    Reward: metres driven in the step, and CRASH for one that ends in a collision or off the road, which terminates the
    episode. It is truncated where the recording ends. `info` has `t` [s], and at the end `end` and `collisions`.
    """

    metadata = {"render_modes": []}  # noqa: RUF012  gymnasium's

    def __init__(
        self,
        recording: str | Path | Recording,
        *,
        objects: int = 8,
        perception: File | PerceptionModel | None = None,
        vehicle: str = "kinematic",
        step: float = STEP,
        accept: Collection[str] = (),
    ) -> None:
        """Describe a recording.

        Args:
            recording: A recording, or its folder.
            objects: How many of them are observed.
            perception: What the agent sees the truth through; each episode draws a seed of its own.
            vehicle: Vehicle model of the EGO.
            step: s between two actions.
            accept: Codes of findings to continue despite.

        Raises:
            ResimError: The recording or the model cannot be used, or a number is none of these.
        """
        if isinstance(objects, bool) or not isinstance(objects, int | np.integer) or objects < 1:
            raise InputError("objects", f"is {objects!r}, expected a whole number from 1 on")
        if isinstance(step, bool) or not isinstance(step, int | float) or not 0.0 < step <= LONGEST_STEP:
            raise InputError("step", f"is {step!r}, expected more than 0 and up to {LONGEST_STEP:g} s")
        measured = the_recording(recording, accept)
        bases: tuple[Basis] = ("GT",)
        prepared = prepare(measured, bases, accept)
        seen = the_perception(perception, 0)
        nobody = cast(Build, None)  # an agent is no build, and a stepped drive asks none
        self._case: dict[str, Any] = {
            "scenario": prepared.described["GT"], "network": prepared.checked.network, "build": nobody,
            "engine": Direct(), "vehicle": vehicle_model(vehicle), "step": step,
            "perception": IdealPerception() if seen is None else Sensor(seen.model),
        }  # fmt: skip
        self._drive: SteppedDrive | None = None
        self._objects = objects
        self.observation_space = spaces.Dict({
            "ego": spaces.Box(-FAR, FAR, (6,), np.float64),
            "objects": spaces.Box(-FAR, FAR, (objects, len(OBJECT)), np.float64),
            "present": spaces.MultiBinary(objects),
        })  # fmt: skip
        self.action_space = spaces.Box(-MOST, MOST, dtype=np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin at the recording's start.

        Args:
            seed: Of this episode's perception, and of those to come.
            options: None are known.

        Returns:
            Observation and info.
        """
        super().reset(seed=seed)
        self.close()
        self._drive = SteppedDrive(Case(**self._case, seed=int(self.np_random.integers(1 << 31))))
        return self._observed(self._drive), self._info(self._drive)

    def step(self, action: Floats) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive a step.

        Args:
            action: Acceleration [m/s²] and curvature [1/m].

        Returns:
            Observation, reward, terminated, truncated, info.

        Raises:
            ResimError: The episode is over, or the action is none.
        """
        drive = self._drive
        if drive is None:
            raise InputError("resim.gym", "there is no episode", "Call reset first.")
        acceleration, curvature = np.clip(_numbers(action), -MOST, MOST).tolist()
        before = drive.position
        drive.step(acceleration, curvature)
        x, y = np.subtract(drive.position, before)
        crashed = drive.end != "duration"
        reward = float(np.hypot(x, y)) + CRASH * crashed
        return self._observed(drive), reward, crashed, drive.is_over and not crashed, self._info(drive)

    def close(self) -> None:
        """Let go of the episode."""
        if self._drive is not None:
            self._drive.close()
            self._drive = None

    def _observed(self, drive: SteppedDrive) -> Observation:
        p, table, present = (
            drive.perceived,
            np.zeros((self._objects, len(OBJECT))),
            np.zeros(self._objects, np.int8),
        )
        near = np.lexsort((p.ids, np.hypot(p.x_ego, p.y_ego)))[: self._objects]
        for column, name in enumerate(OBJECT):
            table[: len(near), column] = getattr(p, name)[near]
        present[: len(near)] = 1
        return {"ego": np.array(p.ego), "objects": table, "present": present}

    def _info(self, drive: SteppedDrive) -> dict[str, Any]:
        if not drive.is_over:
            return {"t": drive.perceived.t}
        collisions = [(one.t, one.id) for one in drive.collisions]
        return {"t": drive.perceived.t, "end": drive.end, "collisions": collisions}


def _numbers(action: Any) -> Floats:
    """An action as two finite numbers. Raises InputError for what is none."""
    try:
        found = np.asarray(action)
    except ValueError:  # lists of different lengths
        found = np.empty(0)
    if found.shape != (2,) or found.dtype.kind not in "fiu" or not np.isfinite(found).all():
        raise InputError("action", f"is {action!r:.60}, expected two finite numbers")
    return found.astype(float)
