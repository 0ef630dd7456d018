"""The one place that talks to SUMO, and the one conversion between its conventions and ours.

SUMO: front bumper, degrees clockwise from north. Ours: box centre, radians anticlockwise from east.
Nets are converted without an offset, so that positions are the same. SUMO knows no negative speed: an object
that rolls backwards is given its amount, and the caller keeps the sign.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.simulation.function.interface import EgoState
from resim.simulation.turn import turn

EGO = "ego"
"""SUMO's name of the EGO."""

VehiclePose: TypeAlias = tuple[str, float, float, float, float]
"""What SUMO is told of an object: name, front bumper x, y [m], angle [deg from north], speed >= 0 [m/s]."""

_TYPE, _DRIVEN = "guided", "driven"
_MATCH = 5.0  # m; moveToXY scans every lane within this distance
_NEVER = 100_000  # s between two decisions of SUMO's driver models: nobody needs them, and they take most of a step
_TYPES = f"""<additional>
    <vType id="{_TYPE}" minGap="0" accel="50" decel="50" maxSpeed="10000" speedFactor="10000" speedDev="0" sigma="0"
        actionStepLength="{_NEVER}"/>
    <vType id="{_DRIVEN}" carFollowModel="IDM" laneChangeModel="LC2013" stepping="{_NEVER}" speedFactor="10000"
        speedDev="0" sigma="0"/>
</additional>
"""


class _Calls(NamedTuple):
    """The calls of every step, in the order of `_STEP_CALLS`."""

    move: Callable[..., None]
    speed: Callable[[str, float], None]
    place: Callable[[str], tuple[float, float]]
    turn: Callable[[str], float]
    pace: Callable[[str], float]


_STEP_CALLS = ("moveToXY", "setSpeed", "getPosition", "getAngle", "getSpeed")


class DriverParameters(NamedTuple):
    """What SUMO knows of a driver: accel and decel [m/s²], tau [s], min_gap [m], max_speed [m/s]."""

    accel: float
    decel: float
    tau: float
    min_gap: float
    max_speed: float


class Session:
    """A SUMO simulation of one net, kept loaded: `reset` goes back to its start for the next run.

    libsumo holds one simulation in a process. `held_session` gives the one there is.
    """

    def __init__(self, net: Path, step: float, *, gui: bool = False) -> None:
        self.net, self.step_length, self.gui = net, step, gui
        self._length: dict[str, float] = {}
        own = f"resim-{os.getpid()}-"  # who kills this process can tell what it leaves
        self._folder = tempfile.TemporaryDirectory(prefix=own)
        folder = Path(self._folder.name)
        types = folder / "types.add.xml"
        types.write_text(_TYPES, encoding="utf-8")
        self._sumo = _load(gui)
        options = [
            "-n", str(net), "-a", str(types), "--step-length", f"{step:g}", "--time-to-teleport", "-1",
            "--collision.action", "none", "--precision", "15", "--no-step-log",
            "--no-warnings", "--xml-validation", "never",
        ]  # fmt: skip
        if gui:
            _start_window(self._sumo, [*options, "--start", "--quit-on-end", "--delay", f"{1000.0 * step:g}"])
        else:
            with self._explain_sumo_errors():
                self._sumo.start(["sumo", *options])
        self._state = str(folder / "start.xml")
        if not gui:
            self._sumo.simulation.saveState(self._state)
        self._vehicle = self._sumo.vehicle
        self._calls = _Calls(*(_native(self._sumo, "vehicle", call) for call in _STEP_CALLS))
        self._step = self._sumo.simulationStep if gui else _native(self._sumo, "simulation", "step")

    def reset(self) -> None:
        """Go back to the start with no vehicle on the road."""
        for name in list(self._length):
            self.remove(name)
        if not self.gui:
            self._sumo.simulation.loadState(self._state)

    def add(self, name: str, length: float, width: float, v: float) -> None:
        """Bring a vehicle into being; `advance` puts it somewhere before the next step."""
        vehicle = self._vehicle
        with self._explain_sumo_errors():
            vehicle.add(name, "", _TYPE, departSpeed=repr(max(v, 0.0)))
        vehicle.setLength(name, length)
        vehicle.setWidth(name, width)
        vehicle.setSpeedMode(name, 0)
        vehicle.setLaneChangeMode(name, 0)
        self._length[name] = length

    @contextlib.contextmanager
    def _explain_sumo_errors(self) -> Iterator[None]:
        """Say in our own words what SUMO refuses."""
        try:
            yield
        except self._sumo.TraCIException as e:
            raise ResimError(f"SUMO refused: {e} (net {self.net})") from e

    def remove(self, name: str) -> None:
        """Take a vehicle off the road."""
        self._vehicle.remove(name)
        del self._length[name]

    def advance(self, commands: Sequence[VehiclePose], ego: EgoState) -> list[float]:
        """Put objects and EGO where they are told to be, let SUMO do one step, and read all back.

        Gives front bumper x, y [m], angle [deg from north], speed [m/s] of the EGO, then of the objects.
        """
        move, speed, place, turn, pace = self._calls
        for name, x, y, angle, v in commands:
            move(name, "", -1, x, y, angle, 2, _MATCH)
            speed(name, v)
        half, v = 0.5 * self._length[EGO], abs(ego.v)
        x, y = ego.x + half * math.cos(ego.heading), ego.y + half * math.sin(ego.heading)
        move(EGO, "", -1, x, y, math.remainder(90.0 - math.degrees(ego.heading), 360.0), 2, _MATCH)
        speed(EGO, v)
        self._step()
        read = [*place(EGO), turn(EGO), v if pace(EGO) == v else self._insist(EGO, v)]
        for name, _, _, _, v in commands:
            read += place(name)
            read += turn(name), v if pace(name) == v else self._insist(name, v)
        return read

    def let_decide(self, name: str, length: float, width: float, driver: DriverParameters) -> None:
        """Let SUMO's models (IDM, LC2013) decide for a vehicle at every step; where it is, `advance` still says."""
        vehicle = self._vehicle
        vehicle.setType(name, self._type(driver))
        vehicle.setLength(name, length)
        vehicle.setWidth(name, width)
        vehicle.setActionStepLength(name, self.step_length)

    def _type(self, driver: DriverParameters) -> str:
        """Give SUMO's type of a driver. SUMO keeps 2 sqrt(accel decel) from a type's making: a copy is made anew."""
        types = self._sumo.vehicletype
        name = " ".join((_DRIVEN, *map(repr, driver)))
        if name not in types.getIDList():
            types.setAccel(_DRIVEN, driver.accel)
            types.setDecel(_DRIVEN, driver.decel)
            types.setTau(_DRIVEN, driver.tau)
            types.setMinGap(_DRIVEN, driver.min_gap)
            types.setMaxSpeed(_DRIVEN, driver.max_speed)
            types.copy(_DRIVEN, name)
        return name

    def decide_no_longer(self, name: str) -> None:
        """Let SUMO's models rest again."""
        self._vehicle.setActionStepLength(name, _NEVER)

    def lane(self, name: str) -> str:
        """Give the lane on which SUMO has a vehicle, "" for none: it is off the road as SUMO knows it."""
        return str(self._vehicle.getLaneID(name))

    def set_route(self, name: str, edges: Sequence[str]) -> bool:
        """Say where a vehicle goes, from the edge on which it is; False where SUMO finds no way along these edges."""
        try:
            self._vehicle.setRoute(name, list(edges))
        except self._sumo.TraCIException:
            return False
        return True

    def followed(self, name: str, v: float, gap: float, lead_v: float, driver: DriverParameters) -> float:
        """Give the speed [m/s] that SUMO's model has after a step, at v [m/s] and gap [m] behind who drives lead_v."""
        found = self._vehicle.getFollowSpeed(name, v, gap - driver.min_gap, lead_v, driver.decel)
        return float(found)

    def changes(self, name: str, direction: int) -> bool:
        """Say whether SUMO's model wants to change to the lane on the left (1) or right (-1), and could."""
        return bool(self._vehicle.wantsAndCouldChangeLane(name, direction))

    def _insist(self, name: str, v: float) -> float:
        """Say the speed again: where SUMO finds no way from place to place it keeps the one before."""
        self._vehicle.setPreviousSpeed(name, v)
        return float(self._vehicle.getSpeed(name))

    def close(self) -> None:
        """End the simulation."""
        self._sumo.close()
        self._folder.cleanup()


def to_sumo(x: Floats, y: Floats, heading: Floats, length: Floats) -> tuple[Floats, Floats, Floats]:
    """Turn box centres [m] and headings [rad] into front bumpers [m] and angles [deg from north, clockwise]."""
    return x + 0.5 * length * np.cos(heading), y + 0.5 * length * np.sin(heading), 90.0 - np.degrees(heading)


def from_sumo(
    front_x: Floats, front_y: Floats, angle: Floats, length: Floats
) -> tuple[Floats, Floats, Floats]:
    """Turn front bumpers and angles back into box centres [m] and headings [rad]; inverse of `to_sumo`."""
    heading = np.radians(90.0 - angle)
    return front_x - 0.5 * length * np.cos(heading), front_y - 0.5 * length * np.sin(heading), heading


_open: Session | None = None


@contextlib.contextmanager
def held_session(net: Path, step: float, *, gui: bool = False) -> Iterator[Session]:
    """Give the session (`open_session`) to this thread alone, once those are done that had it before.

    Raises ResimError within a drive of this thread: code under test cannot drive another one meanwhile.
    """
    with turn():
        yield open_session(net, step, gui=gui)


def open_session(net: Path, step: float, *, gui: bool = False) -> Session:
    """Give this process's session of the net, reset; a new one only where net or step is another.

    step: s, whole milliseconds.
    """
    global _open
    if abs(1000.0 * step - round(1000.0 * step)) > 1e-9 or step <= 0.0:
        raise ResimError(f"step {step:g} s: SUMO wants whole milliseconds, such as 0.04")
    if _open is not None and (_open.net, _open.step_length, _open.gui) == (net, step, gui):
        _open.reset()
        return _open
    close_session()
    _open = Session(net, step, gui=gui)
    return _open


def close_session() -> None:
    """End this process's session, if there is one."""
    global _open
    if _open is not None:
        _open.close()
        _open = None


def _load(gui: bool) -> Any:
    """Import libsumo, or TraCI for the window; both have the same calls."""
    if gui:
        import traci

        return traci
    try:
        from resim.simulation.sumo.library import libsumo
    except ImportError as e:
        raise ResimError(
            f"libsumo cannot be loaded: {e}. It needs system libraries: "
            "libX11, libXext, libXrender, libGL, libatomic, libexpat."
        ) from e
    return libsumo


def _native(sumo: Any, domain: str, call: str) -> Callable[..., Any]:
    """The call of a domain without libsumo's Python wrapper around it, which costs as much as the call."""
    native = getattr(getattr(sumo, "libsumo", None), "_libsumo", None)
    found: Callable[..., Any] = getattr(native, f"{domain}_{call}", None) or getattr(
        getattr(sumo, domain), call
    )
    return found


def _start_window(traci: Any, options: list[str]) -> None:
    """Start sumo-gui and connect to it."""
    import sumolib

    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        raise ResimError(
            "--gui: there is no display to show sumo-gui on (DISPLAY is not set). Run without --gui."
        )
    try:
        with warnings.catch_warnings(action="ignore"):
            traci.start([sumolib.checkBinary("sumo-gui"), *options], numRetries=20)
    except traci.exceptions.FatalTraCIError as e:
        raise ResimError(f"--gui: sumo-gui did not start: {e}. Run without --gui.") from e
