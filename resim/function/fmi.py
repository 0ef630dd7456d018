"""Serves a co-simulation unit (FMI 2 or 3) as a function, by FMPy, in the process that resim starts for its run.

resim has read the unit's description, and gives what is needed of it as JSON: `Wiring`.
"""

from __future__ import annotations

import ctypes
import functools
import json
import math
import sys
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

SIGNALS = {
    "ego.x": "m", "ego.y": "m", "ego.heading": "rad", "ego.v": "m/s", "ego.a": "m/s2", "ego.yaw_rate": "rad/s",
    "lead.gap": "m", "lead.v": "m/s", "lead.exists": "",
}  # fmt: skip
"""What a unit may get, with its unit."""
OF_OBJECT = {"x": "m", "y": "m", "heading": "rad", "v": "m/s", "length": "m", "width": "m", "exists": ""}
"""What it may get of the object that is nearest but k, as `object[k].x`."""
_ALIKE = 1e-6
"""Part of a step by which the time that a unit says it reached may miss the step's end."""
_SLOW = 1.0
"""m/s up to which the EGO's corridor is straight."""


class Wiring(NamedTuple):
    """A unit and how it is connected.

    file: where it lies. version: of FMI, 2 or 3. identifier, token: of its library. inputs: signal, value reference and
    type of each variable. outputs: name, value reference, type. parameters: value reference and type of each, by name.
    reach: m up to which there is a lead vehicle. osmp: of each message of OSMP the value reference of its variable, or
    of the three of its address, low and high, and its size; none of a unit that does not speak OSI.
    """

    file: str
    version: int
    identifier: str
    token: str
    inputs: tuple[tuple[str, int, str], ...]
    outputs: tuple[tuple[str, int, str], ...]
    parameters: Mapping[str, tuple[int, str]]
    reach: float
    osmp: Mapping[str, tuple[int, ...]]


class BinaryVariable:
    """A variable of bytes: one of FMI 3, or three integers, by which OSMP passes an address and a size."""

    def __init__(self, unit: Any, references: Sequence[int]) -> None:
        self._unit, self._references = unit, [*references]
        self._lent: Any = None

    def put(self, value: bytes) -> None:
        """Set it; the bytes stay where they are until it is set again."""
        if len(self._references) == 1:
            self._unit.setBinary(self._references, [value])
            return
        self._lent = ctypes.create_string_buffer(value, max(len(value), 1))
        address = ctypes.addressof(self._lent)
        halves = (address & 0xFFFFFFFF, address >> 32, len(value))
        self._unit.setInteger(self._references, [ctypes.c_int32(half).value for half in halves])

    def get(self) -> bytes:
        """Give a copy of it, b"" where there is nothing."""
        if len(self._references) == 1:
            return self._unit.getBinary(self._references)[0] or b""
        low, high, size = (int(half) for half in self._unit.getInteger(self._references))
        address = (high & 0xFFFFFFFF) << 32 | low & 0xFFFFFFFF
        return ctypes.string_at(address, size) if address and size > 0 else b""


def refuse_undone(told: tuple[bool, bool, bool, float], end: float, cycle: float) -> None:
    """Raise RuntimeError where a unit of FMI 3 says that it did not do its step of `cycle` [s] until `end` [s].

    told: eventHandlingNeeded, terminateSimulation, earlyReturn, lastSuccessfulTime [s]. resim allows neither events nor
    early returns when it instantiates the unit (FMI 3.0, 4.2.1), so the unit may not ask for them.
    """
    event, terminate, early, last = told
    if terminate:
        raise RuntimeError("the unit asked to terminate the simulation")
    if early or not abs(last - end) <= _ALIKE * cycle:
        which = f"earlyReturn = {str(bool(early)).lower()}, lastSuccessfulTime = {last:g} s"
        raise RuntimeError(f"the unit did not do its whole step until {end:g} s: it said {which}")
    if event:
        raise RuntimeError(
            "the unit asked for its event mode (eventHandlingNeeded), which resim does not use"
        )


def lead_of(p: Any, length: float, width: float, reach: float) -> tuple[float, float, bool]:
    """Give gap [m], bumper to bumper, and speed [m/s] of the next object in the EGO's corridor, and whether it exists.

    The corridor is as wide as the EGO, and bent as it drives; an object counts whose box, as it is turned, reaches into
    it ahead of the EGO's centre. The gap is to the box's nearest point in the corridor, and 0 or less where the boxes
    are beside each other. Without one the gap is `reach`, and the speed the EGO's.
    """
    bend = p.ego.yaw_rate / p.ego.v if p.ego.v > _SLOW else 0.0
    found = (reach, p.ego.v, False)
    columns = (p.x_ego, p.y_ego, p.heading_ego, p.v, p.length, p.width)
    for x, y, heading, v, *size in zip(*(column.tolist() for column in columns)):  # noqa: B905
        within = _within(x, y - 0.5 * bend * x * x, heading - bend * x, size, 0.5 * width)
        if within and max(within) > 0.0 and min(within) - 0.5 * length < found[0]:
            found = (min(within) - 0.5 * length, v, True)
    return found


def _within(x: float, y: float, heading: float, size: Sequence[float], half: float) -> list[float]:
    """Give x [m] of the corners of the part of a box that is between y = -half and half; [] where there is none.

    x, y: of the box's centre [m]. heading: rad. size: its length and width [m].
    """
    if heading == 0.0:
        return [x - 0.5 * size[0], x + 0.5 * size[0]] if abs(y) < half + 0.5 * size[1] else []
    c, s, a, b = math.cos(heading), math.sin(heading), 0.5 * size[0], 0.5 * size[1]
    corners = [
        (x + i * a * c - j * b * s, y + i * a * s + j * b * c)
        for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))
    ]
    sides = [*zip(corners, (*corners[1:], corners[0]))]  # noqa: B905
    return [px for px, py in corners if abs(py) < half] + [
        x0 + (x1 - x0) * (edge - y0) / (y1 - y0)
        for (x0, y0), (x1, y1) in sides
        for edge in (-half, half)
        if (y0 - edge) * (y1 - edge) < 0.0
    ]


class FmuFunction:
    """A unit, as an AD function: each step is one of its communication steps, of the function's cycle."""

    def __init__(self, wiring: Wiring, **parameters: Any) -> None:
        self._wiring, self._given = wiring, parameters
        self._steps = 0
        self._unit: Any = None
        self._binary: dict[str, BinaryVariable] = {}

    def reset(self, setup: Any) -> None:
        """Load the unit and initialise it."""
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        from resim.function.unit_log import UnitLog

        w = self._wiring
        with zipfile.ZipFile(w.file) as packed:
            packed.extractall("unit")
        self._length, self._width, self._cycle = setup.length, setup.width, setup.cycle
        kind = FMU2Slave if w.version == 2 else FMU3Slave
        unit = kind(
            guid=w.token, modelIdentifier=w.identifier, unzipDirectory=str(Path("unit").absolute()),
            instanceName="function",
        )  # fmt: skip
        log = UnitLog()
        log.raise_failures(unit)
        log.instantiate(unit, w.version)
        for name, value in self._given.items():
            if name not in w.parameters:
                raise ValueError(f"the unit has no parameter {name!r}")
            reference, form = w.parameters[name]
            getattr(unit, f"set{form}")([reference], [value])
        if w.version == 2:
            unit.setupExperiment(startTime=0.0)
            unit.enterInitializationMode()
        else:
            unit.enterInitializationMode(startTime=0.0)
        self._binary = {name: BinaryVariable(unit, references) for name, references in w.osmp.items()}
        if self._binary:
            self._introduce(setup)
        unit.exitInitializationMode()
        self._unit = unit
        forms = sorted({form for _, _, form in w.inputs})
        self._sets: list[tuple[Callable[..., None], list[int], list[str]]] = [
            (getattr(unit, f"set{form}"), [r for _, r, f in w.inputs if f == form],
             [signal for signal, _, f in w.inputs if f == form])
            for form in forms
        ]  # fmt: skip
        self._gets = {name: (getattr(unit, f"get{form}"), [reference]) for name, reference, form in w.outputs}

    def step(self, p: Any) -> Any:
        """Set the inputs, do a step, and give the outputs."""
        from resim.function import Command

        time = self._steps * self._cycle
        signals = self._signals(p)
        for put, references, names in self._sets:
            put(references, [signals[name] for name in names])
        if self._binary:
            self._binary["OSMPSensorViewIn"].put(self._lanes + self._osi.view(p, time))
        told = self._unit.doStep(time, self._cycle)
        self._steps += 1
        if (command := self._binary.get("OSMPTrafficCommandIn")) is not None:
            command.put(b"")  # given once
        if told is not None:  # FMI 3; a unit of FMI 2 says it by its status
            refuse_undone(told, time + self._cycle, self._cycle)
        if self._binary:
            return Command(*self._osi.answer(self._binary["OSMPTrafficUpdateOut"].get(), p, time))
        values = {name: float(get(references)[0]) for name, (get, references) in self._gets.items()}
        return Command(values["acceleration"], values.get("curvature", 0.0))

    def close(self) -> None:
        """Terminate the unit and let go of it."""
        if self._unit is not None:
            self._unit.terminate()
            self._unit.freeInstance()

    def _introduce(self, setup: Any) -> None:
        """Tell a unit that speaks OSI of the map, and where to go, as far as it listens."""
        from resim.function.osmp import TrafficParticipant, within_view

        self._osi = TrafficParticipant(setup)
        asked, told = (self._binary.get(f"OSMPSensorViewInConfig{part}") for part in ("Request", ""))
        if told is not None:
            told.put(self._osi.configuration(b"" if asked is None else asked.get()))
        static = self._osi.static()
        if (lanes := self._binary.get("OSMPGroundTruthInit")) is not None:
            lanes.put(static)
        self._lanes = within_view(static) if lanes is None else b""
        if (command := self._binary.get("OSMPTrafficCommandIn")) is not None:
            command.put(self._osi.command())

    def _signals(self, p: Any) -> dict[str, Any]:
        gap, v, exists = lead_of(p, self._length, self._width, self._wiring.reach)
        found = {f"ego.{name}": value for name, value in p.ego._asdict().items()}
        found |= {"lead.gap": gap, "lead.v": v, "lead.exists": exists}
        if any(signal.startswith("object") for signal, *_ in self._wiring.inputs):
            far = [math.hypot(x, y) for x, y in zip(p.x_ego.tolist(), p.y_ego.tolist())]  # noqa: B905
            order = sorted(range(len(far)), key=lambda k: (far[k], p.ids[k]))
            for signal, *_ in self._wiring.inputs:
                if signal.startswith("object["):
                    k, name = int(signal[7 : signal.index("]")]), signal.rpartition(".")[2]
                    found[signal] = self._of_object(p, order[k] if k < len(order) else None, name)
        return found

    def _of_object(self, p: Any, row: int | None, name: str) -> Any:
        if name == "exists":
            return row is not None
        if row is None:
            return self._wiring.reach if name == "x" else 0.0
        column = getattr(p, f"{name}_ego") if name in ("x", "y", "heading") else getattr(p, name)
        return float(column[row])


def wiring_of(text: str) -> Wiring:
    """Give a wiring from JSON."""
    told = json.loads(text)
    for name in ("inputs", "outputs"):
        told[name] = tuple(map(tuple, told[name]))
    return Wiring(**told)


if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).parents[2])  # not this folder
    from resim.function import serve

    serve(functools.partial(FmuFunction, wiring_of(sys.argv[1])))
