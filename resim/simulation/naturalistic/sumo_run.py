"""SUMO drives the vehicles: its input files, its run as a program of its own, and what it says of each vehicle."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import tempfile
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.simulation.naturalistic.demand import SpawnedVehicle

STEP = 0.2
"""Time [s] of SUMO's steps; speeds are linear between (ballistic), so that any rate can be sampled exactly."""
TIME_LIMIT = 7200.0
LOOKS_AHEAD = "5"
"""SUMO's lcStrategic: how much earlier than usual vehicles leave a lane that ends (our choice: they merge moving)."""


@dataclass(frozen=True, eq=False)
class SumoTrack:
    """What SUMO says of one vehicle at times t (K,) [s].

    lanes: names of the net's lanes (K,). x, y: front bumper [m]. v: m/s. changes: when [s] it began to change lane, and
    by how many lanes to the left.
    """

    vehicle: SpawnedVehicle
    t: Floats
    x: Floats
    y: Floats
    v: Floats
    lanes: tuple[str, ...]
    changes: tuple[tuple[float, int], ...]


def run_sumo(
    net: Path, vehicles: Sequence[SpawnedVehicle], *, end: float, change_lasts: float, seed: int
) -> list[SumoTrack]:
    """Let SUMO drive vehicles until `end` [s], and give what it says of each, by id.

    change_lasts: how long [s] SUMO keeps both lanes for who changes. Raises ResimError where SUMO does not end well.
    """
    with _folder() as folder:
        _write_vehicles(folder / "vehicles.rou.xml", vehicles)
        options = [
            "-n", str(net), "-r", str(folder / "vehicles.rou.xml"), "--step-length", f"{STEP:g}",
            "--default.action-step-length", f"{STEP:g}", "--step-method.ballistic", "true", "--end", f"{end:g}",
            "--lanechange.duration", f"{change_lasts:g}", "--time-to-teleport", "-1", "--collision.action", "remove",
            "--fcd-output", str(folder / "fcd.xml"), "--fcd-output.attributes", "x,y,speed,lane",
            "--lanechange-output", str(folder / "changes.xml"), "--precision", "6", "--seed", str(seed % 2**31),
            "--no-step-log", "true", "--no-warnings", "true", "--xml-validation", "never",
        ]  # fmt: skip
        _run(options)
        return _tracks(folder, {one.id: one for one in vehicles})


@contextmanager
def _folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix=f"resim-{os.getpid()}-") as name:
        yield Path(name)


def _run(options: Sequence[str]) -> None:
    found = importlib.util.find_spec("sumo")
    home = Path(found.origin).parent if found and found.origin else None
    if home is None or not (home / "bin").is_dir():
        raise ResimError("SUMO is not installed. Install eclipse-sumo of the version in pyproject.toml.")
    environment = {**os.environ, "SUMO_HOME": str(home)}
    try:
        done = subprocess.run(
            [str(home / "bin" / "sumo"), *options], env=environment, capture_output=True, text=True, errors="replace",
            timeout=TIME_LIMIT, stdin=subprocess.DEVNULL, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise ResimError(f"SUMO was stopped after {TIME_LIMIT:g} s. Ask for fewer hours.") from None
    if done.returncode != 0:
        last = [line for line in done.stderr.splitlines() if line.strip()][-3:]
        raise ResimError(f"SUMO ended with {done.returncode}: {' '.join(last) or 'without a word'}")


def _write_vehicles(path: Path, vehicles: Sequence[SpawnedVehicle]) -> None:
    root = etree.Element("routes")
    for one in vehicles:
        told = {name: f"{value:g}" for name, value in one.parameters.items()}
        told |= {
            "id": f"t{one.id}",
            "length": f"{one.length:g}",
            "width": f"{one.width:g}",
            "vClass": "passenger",
        }
        told |= {"carFollowModel": "IDM", "speedDev": "0", "lcStrategic": LOOKS_AHEAD}
        etree.SubElement(root, "vType", {**told, "desiredMaxSpeed": told["maxSpeed"]})
        vehicle = etree.SubElement(root, "vehicle", id=one.id, type=f"t{one.id}", depart=f"{one.depart:g}",
                                   departLane="best", departSpeed="avg", departPos="base")  # fmt: skip
        etree.SubElement(vehicle, "route", edges=" ".join(one.edges))
    etree.ElementTree(root).write(str(path))


def _tracks(folder: Path, vehicles: dict[str, SpawnedVehicle]) -> list[SumoTrack]:
    numbers: dict[str, array[float]] = {}
    passed: dict[str, list[str]] = {}
    names: dict[str, str] = {}  # each lane's name once, however often it is passed
    now = 0.0
    told = etree.iterparse(str(folder / "fcd.xml"), events=("start", "end"), tag=("timestep", "vehicle"))
    for event, element in told:
        if event == "start":
            if element.tag == "timestep":
                now = float(element.get("time", "0"))
        elif element.tag == "vehicle":
            own = numbers.setdefault(element.get("id", ""), array("d"))
            own.extend((now, *(float(element.get(name, "nan")) for name in ("x", "y", "speed"))))
            lane = element.get("lane", "")
            passed.setdefault(element.get("id", ""), []).append(names.setdefault(lane, lane))
        else:
            element.clear()
            while element.getprevious() is not None:
                del element.getparent()[0]
    changes = _changes(folder / "changes.xml")
    out = []
    for name, flat in numbers.items():
        t, x, y, v = np.array(flat).reshape(-1, 4).T
        out.append(SumoTrack(vehicles[name], t, x, y, v, tuple(passed[name]), tuple(changes.get(name, ()))))
    return sorted(out, key=lambda one: int(one.vehicle.id))


def _changes(path: Path) -> dict[str, list[tuple[float, int]]]:
    out: dict[str, list[tuple[float, int]]] = {}
    for element in etree.parse(str(path)).getroot().iterfind("change"):
        out.setdefault(element.get("id", ""), []).append(
            (float(element.get("time", "0")), int(element.get("dir", "0")))
        )
    return out
