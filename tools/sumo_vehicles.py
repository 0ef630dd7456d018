"""Real vehicles of SUMO on a straight road, some driven as told and the others by SUMO's own models.

    python tools/sumo_vehicles.py < scene.json

scene.json: `folder` for SUMO's files, `lanes`, `step` [s], `steps`, and `vehicles`, of which each has `s` [m] of its
front, `lane` (0 is the right one), `length` [m], `speeds` [m/s] that it drives at the times 0, step, 2 step, ..., and
`driver`, the attributes of its type. Beyond its speeds it is let go of: SUMO's models drive it. Prints, by vehicle, s,
v and lane at these times as JSON. It is a process of its own, as SUMO is one for the whole process.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

ROAD = 3000.0
"""m."""
FREE = 31, 1621
"""SUMO's own modes of speeds and lane changes: with all checks."""


def drive(scene: dict[str, Any]) -> list[dict[str, list[float]]]:
    """Give by vehicle s [m], v [m/s] and lane over time; in a process of its own."""
    done = subprocess.run(
        [sys.executable, __file__], input=json.dumps(scene), capture_output=True, text=True, check=True
    )
    found: list[dict[str, list[float]]] = json.loads(done.stdout.splitlines()[-1])
    return found


def _drive(scene: dict[str, Any]) -> list[dict[str, list[float]]]:
    import libsumo

    vehicles = scene["vehicles"]
    order = [
        "sumo", "-n", str(_net(Path(scene["folder"]), scene["lanes"])), "-r", str(_routes(scene)),
        "--step-length", str(scene["step"]), "--step-method.ballistic", "true", "--collision.action", "none",
        "--time-to-teleport", "-1", "--no-step-log", "--no-warnings", "--seed", "1",
    ]  # fmt: skip
    libsumo.start(order)
    libsumo.simulationStep()
    for k in range(len(vehicles)):
        libsumo.vehicle.setSpeedMode(str(k), 0)
        libsumo.vehicle.setLaneChangeMode(str(k), 0)
    found: list[dict[str, list[float]]] = [{"s": [], "v": [], "lane": []} for _ in vehicles]
    for n in range(scene["steps"]):
        for k, one in enumerate(vehicles):
            if n + 1 < len(one["speeds"]):
                libsumo.vehicle.setSpeed(str(k), one["speeds"][n + 1])
            elif n + 1 == len(one["speeds"]):
                libsumo.vehicle.setSpeed(str(k), -1)
                libsumo.vehicle.setSpeedMode(str(k), FREE[0])
                libsumo.vehicle.setLaneChangeMode(str(k), FREE[1])
            found[k]["s"].append(libsumo.vehicle.getLanePosition(str(k)))
            found[k]["v"].append(libsumo.vehicle.getSpeed(str(k)))
            found[k]["lane"].append(libsumo.vehicle.getLaneIndex(str(k)))
        libsumo.simulationStep()
    libsumo.close()
    return found


def _net(folder: Path, lanes: int) -> Path:
    """The road as a net of SUMO."""
    import sumo

    nodes, edges, net = (folder / f"road.{name}.xml" for name in ("nod", "edg", "net"))
    nodes.write_text(f'<nodes><node id="a" x="0" y="0"/><node id="b" x="{ROAD}" y="0"/></nodes>')
    edges.write_text(f'<edges><edge id="e" from="a" to="b" numLanes="{lanes}" speed="60"/></edges>')
    program = Path(sumo.SUMO_HOME, "bin", "netconvert")
    order = [program, "-n", nodes, "-e", edges, "-o", net, "--no-turnarounds"]
    subprocess.run(order, check=True, capture_output=True)
    return net


def _routes(scene: dict[str, Any]) -> Path:
    """The vehicles as SUMO's file of routes."""
    told = []
    for k, one in enumerate(scene["vehicles"]):
        of_type = {
            "length": one["length"],
            "speedDev": 0,
            "emergencyDecel": 9,
            "maxSpeed": 70,
            **one.get("driver", {}),
        }
        words = " ".join(f'{key}="{value}"' for key, value in of_type.items())
        told.append(
            f'<vType id="t{k}" {words}/><vehicle id="{k}" type="t{k}" depart="0" departPos="{one["s"]}" '
            f'departSpeed="{one["speeds"][0]}" departLane="{one["lane"]}" insertionChecks="none"><route edges="e"/>'
            "</vehicle>"
        )
    path = Path(scene["folder"], "road.rou.xml")
    path.write_text(f"<routes>{''.join(told)}</routes>")
    return path


if __name__ == "__main__":
    print(json.dumps(_drive(json.load(sys.stdin))))
