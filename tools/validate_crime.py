"""Set our criticality measures beside CommonRoad-CriMe's on scenes of two cars, and say where and why they differ.

python tools/validate_crime.py --crime /path/to/crime/bin/python [--differences]

CriMe has an environment of its own: `python3.11 -m venv DIR && DIR/bin/pip install commonroad-crime==0.4.5`. The
reasons were read in the source of that version, and what they predict was computed apart: WTTC's roots, TTB and DRAC.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from resim.core.geometry import Floats
from resim.metrics import measures as c
from resim.metrics.measures import Pairs, State
from resim.metrics.measures.motion import ctra
from resim.metrics.risk import DEFAULTS

VERSION = "0.4.5"
SIZE = (4.7, 1.9)
LANE, STEP, HORIZON = 3.5, 0.1, 8.0
MOST = 0.9 * 9.81  # m/s², what `wttc` takes
SAME = 0.005 + 1e-9  # CriMe rounds to two digits at the finest
NONE, UNDEFINED = "none", "undefined"
Value = float | str

OURS = {
    "TTC": c.ttc, "ETTC": c.ettc, "THW": c.thw, "WTTC": c.wttc, "TTB": c.ttb, "TTK": c.ttk, "TTS": c.tts,
    "TTR": c.ttr, "DRAC": c.drac, "PMD": c.pmd, "TPMD": c.tpmd,
}  # fmt: skip
COMPARED = (
    ("TTC", "TTC"), ("ETTC", "TTC"), ("ETTC", "TTCStar"), ("THW", "THW"), ("WTTC", "WTTC"), ("TTB", "TTB"),
    ("TTK", "TTK"), ("TTS", "TTS"), ("TTR", "TTR"), ("DRAC", "ALongReq"), ("PMD", "DCE"), ("TPMD", "TTCE"),
)  # fmt: skip
"""Ours, CriMe's. Its TTC takes accelerations along, so it answers for our ETTC as well where somebody brakes."""
SEARCHED = ("TTB", "TTK", "TTS", "TTR")

REASONS = {
    "grid": "TTCStar, TTCE and THW walk along the given trajectory and give the first 0.1 s step after the event; "
    "whether touching on a step counts is left to the last bit. Ours is exact within the step.",
    "lane": "TTC, THW and ALongReq look along the lane: no value (inf; ALongReq 0) until the boxes touch a common "
    "lanelet, and then one whatever the lateral distance. Ours looks at boxes: a car that is coming over counts, one "
    "beside the path has no headway.",
    "behind": "TTC, THW and ALongReq see only who is ahead: a negative headway is inf (ALongReq 0), with boxes that "
    "overlap as with a car that comes from behind.",
    "sign of a": "TTC takes the object's acceleration as sqrt(ax² + ay²), never negative: a leader that brakes is "
    "computed as one that accelerates, and its TTC is inf.",
    "speed": "TTC and ALongReq take the object's velocity as sqrt(vx² + vy²) cos(heading of the lane on the map), "
    "whatever its own heading: an oncoming car drives ahead; on a road to the north-east speeds shrink by cos 45°, to "
    "the north they vanish, to the west TTC (whose EGO has the sign of vx besides) takes a leader for oncoming.",
    "half length": "The headway adds half a length to x and to y of the map, whatever the headings of road and cars: "
    "right for cars along roads to the east and north, 28.05 m for 30 m to the north-east, 39.4 m to the west.",
    "heading 0": "ALongReq asks `if not ego_orientation` to find who is off the map, and is 0 on every road due "
    "east; with the road turned by 0.001 rad it gives 2.02 at 30 m, as we do. (Its sign is turned in the table.)",
    "disc": "WTTC takes one disc of radius sqrt((l/6)² + (w/2)²) = 1.23 m at the centre, one of the three it takes to "
    "cover a car (so it is later: no bound), 11.5 m/s² (BMW 320i; ours 8.83: so it is earlier), rounded to 0.1 s.",
    "root": "WTTC takes the first positive root in the order of numpy.roots, not the least: of 2.96, 1.38 and 0.72 s "
    "it takes 2.96, four times later than the first contact.",
    "no root": "Where the discs overlap already there is no positive root, and `[...][0]` raises.",
    "braking": "8 m/s² along each axis of the map (11.3 to the north-east; ours 8.5 along the path), built up at "
    "25 m/s³, on the 0.1 s grid: earlier than ours. Against that, the drivability checker appends the evading EGO's "
    "initial state twice, so it is checked 0.1 s late: 2.8 s where its own braking needs 2.5 at the cut-ins (too "
    "late), 4.0 for 3.9 at 52 m, 2.0 for 1.9 at 30 m, 1.1 for 1.0 at the crossing.",
    "steering": "By default 0.8 m aside and straight on (1.30 m at 21 m/s, with its jerk limit): never past a car "
    "1.9 m wide straight ahead. Told to steer a lane aside it goes 4.58 m, off a road of three lanes, whose border "
    "counts as a collision. a_lat = 11.5 · 7.319 / v (4.0 m/s² at 21 m/s; ours 7 at once, no border), at most 8; jerk "
    "limit, grid and lateness as in braking.",
    "max": "The maximum of the three above.",
    "words": "Where nothing helps any more it says -inf and we 0; for no conflict inf and we NO_CONFLICT; for a "
    "headway at standstill inf and we NOT_DEFINED. inf, or ALongReq 0, for none does not count as a difference.",
}  # fmt: skip
BY_MEASURE = {
    "ETTC": "grid", "THW": "grid", "WTTC": "disc", "TTB": "braking", "TTS": "steering", "TTR": "max",
    "DRAC": "heading 0", "TPMD": "grid",
}  # fmt: skip
"""Why they differ, where the scene says nothing else."""


@dataclass(frozen=True)
class Scene:
    """Two cars: x, y [m], heading [rad], v [m/s], a [m/s²] on a road along x; closed forms by measure.

    why: reasons by measure, other than those that always hold. road_heading: rad, by which road and cars are turned.
    crossing_at: x [m] of a lane across. steer_width: CriMe's mode, 1: 0.8 m, 2: a lane. only: CriMe's measures asked.
    """

    name: str
    ego: tuple[float, ...]
    other: tuple[float, ...]
    analytic: dict[str, Value] = field(default_factory=dict)
    why: dict[str, str] = field(default_factory=dict)
    road_heading: float = 0.0
    crossing_at: float | None = None
    lanes: int = 3
    steer_width: int = 1
    only: tuple[str, ...] = ()

    def compared(self) -> list[tuple[str, str]]:
        """Give what to compare: our names and CriMe's."""
        brakes = self.ego[4] != 0.0 or self.other[4] != 0.0
        return [
            (a, b) for a, b in COMPARED
            if ((a, b) != ("ETTC", "TTC") or brakes) and (not self.only or b in self.only)
        ]  # fmt: skip

    def driven(self, who: str) -> Floats:
        """Give the motion (M + 1, 4) of one of them, as planned and as expected."""
        x, y, heading, v, a = getattr(self, who)
        cos, sin = math.cos(self.road_heading), math.sin(self.road_heading)
        state = [[cos * x - sin * y, sin * x + cos * y, heading + self.road_heading, v, a, 0.0]]
        return ctra(np.array(state), np.arange(round(HORIZON / STEP) + 1)[None] * STEP)[0]

    def pairs(self) -> Pairs:
        """Give our input: the EGO's motion as plan, the other's state."""
        other = [*self.driven("other")[0], self.other[4], 0.0]
        size = np.array([SIZE])
        return Pairs(self.driven("ego")[None], size, np.array([[other]]), size[None], STEP)

    def told(self) -> dict[str, Any]:
        """Give CriMe's input."""
        return {
            "name": self.name, "road_heading": self.road_heading, "crossing_at": self.crossing_at,
            "lanes": self.lanes, "steer_width": self.steer_width,
            "measures": sorted({b for _, b in self.compared()}),
            "ego": self.driven("ego").tolist(), "other": self.driven("other").tolist(),
        }  # fmt: skip


def following(d: float, v: float, v_lead: float) -> dict[str, Value]:
    """Give the closed forms where the EGO follows at clear distance d [m], both at constant speed."""
    told: dict[str, Value] = {"THW": d / v if v > 0.0 else UNDEFINED}
    closing = v - v_lead
    if closing <= 0.0:
        return told | dict.fromkeys(("TTC", "ETTC", *SEARCHED, "DRAC"), NONE) | {"PMD": d, "TPMD": 0.0}
    ttb = max((d - closing**2 / (2.0 * DEFAULTS.braking)) / closing, 0.0)
    told |= {"TTC": d / closing, "ETTC": d / closing, "TPMD": d / closing, "PMD": 0.0}
    return told | {"TTB": ttb, "TTK": 0.0, "DRAC": closing**2 / (2.0 * d)}


def circles(scene: Scene) -> float:
    """Give WTTC [s] with circles around the boxes (Wachenfeld et al. 2016, Eq. 5): ours is no earlier."""
    (x, y, heading, v, _), (x2, y2, heading2, v2, _) = scene.ego, scene.other
    d = np.array([x2 - x, y2 - y])
    u = np.array(
        [v2 * math.cos(heading2) - v * math.cos(heading), v2 * math.sin(heading2) - v * math.sin(heading)]
    )
    reach = math.hypot(*SIZE)
    poly = [-(MOST**2), 0.0, u @ u - 2.0 * MOST * reach, 2.0 * u @ d, d @ d - reach**2]
    if poly[-1] <= 0.0:
        return 0.0
    return min(float(r.real) for r in np.roots(poly) if abs(r.imag) < 1e-9 and r.real > 0.0)


def scenes() -> list[Scene]:
    """Give all scenes."""
    turned = ("TTC", "TTB", "ALongReq")
    return [
        behind("rear-end 52 m", 52.0, 21.0, 10.0),
        behind("rear-end 30 m", 30.0, 21.0, 10.0),
        behind("rear-end 12.1 m", 12.1, 21.0, 10.0),
        behind("equal speeds", 20.0, 20.0, 20.0),
        braking_leader(),
        behind("standing leader", 30.0, 15.0, 0.0),
        cut_in("cut-in before the border", 3.0, {"TTC": "lane", "DRAC": "lane"}),
        cut_in("cut-in over the border", 2.7, {"THW": "lane", "TTC": "speed, half length"}),
        *unusual(),
        Scene("side by side", (0, 0, 0, 20, 0), (0, LANE, 0, 20, 0), {"PMD": LANE - SIZE[1], "TPMD": 0.0}),
        behind("separating", 10.0, 10.0, 20.0),
        behind("at standstill", 10.0, 0.0, 0.0, why={"THW": "words"}),
        behind(
            "rear-end 30 m, road to the north-east", 30.0, 21.0, 10.0, road_heading=0.25 * math.pi, only=turned,
            why={"TTC": "speed, half length", "DRAC": "speed, half length"},
        ),
        behind(
            "rear-end 30 m, road to the north", 30.0, 21.0, 10.0, road_heading=0.5 * math.pi, only=turned,
            why={"TTC": "speed", "DRAC": "speed"},
        ),
        behind(
            "rear-end 30 m, road to the west", 30.0, 21.0, 10.0, road_heading=math.pi, only=turned,
            why={"TTC": "speed, half length", "DRAC": "speed, half length"},
        ),
        behind("rear-end 30 m, a lane aside", 30.0, 21.0, 10.0, steer_width=2, only=("TTS",)),
        behind("rear-end 30 m, a lane aside, 5 lanes", 30.0, 21.0, 10.0, steer_width=2, lanes=5, only=("TTS",)),
    ]  # fmt: skip


def behind(name: str, d: float, v: float, v_lead: float, **more: Any) -> Scene:
    """Give a scene in which the EGO follows at clear distance d [m]."""
    return Scene(name, (0, 0, 0, v, 0), (d + SIZE[0], 0, 0, v_lead, 0), following(d, v, v_lead), **more)


def braking_leader() -> Scene:
    """Both at 20 m/s, 20 m apart, the leader brakes with 6 m/s² to standstill."""
    d, v, a = 20.0, 20.0, 6.0
    ettc = math.sqrt(2.0 * d / a)
    ttb = (d + v * v / (2.0 * a) - v * v / (2.0 * DEFAULTS.braking)) / v
    known: dict[str, Value] = {
        "TTC": NONE, "ETTC": ettc, "THW": d / v, "TTB": ttb, "TTK": 0.0, "DRAC": NONE, "PMD": 0.0, "TPMD": ettc,
    }  # fmt: skip
    return Scene(
        "braking leader", (0, 0, 0, v, 0), (d + SIZE[0], 0, 0, v, -a), known, {"ETTC TTC": "sign of a"}
    )


def cut_in(name: str, y: float, why: dict[str, str]) -> Scene:
    """A slower car comes over from the lane to the left at 0.06 rad; its right rear corner is hit."""
    d, v, v_lead, turn = 15.0, 20.0, 15.0, 0.06
    length, width = SIZE
    reach = 0.5 * (length * math.cos(turn) + width * math.sin(turn))
    ttc = (d + 0.5 * length - reach) / (v - v_lead * math.cos(turn))
    known: dict[str, Value] = {"TTC": ttc, "ETTC": ttc, "THW": NONE, "PMD": 0.0, "TPMD": ttc}
    return Scene(name, (0, 0, 0, v, 0), (d + length, y, -turn, v_lead, 0), known, why)


def unusual() -> list[Scene]:
    """Give the scenes that are no following: oncoming, crossing, overlapping, from behind."""
    length, width = SIZE

    def at(t: float, **more: Value) -> dict[str, Value]:
        return {"TTC": t, "ETTC": t, "PMD": 0.0, "TPMD": t} | more

    never: dict[str, Value] = {**dict.fromkeys(SEARCHED, 0.0), "DRAC": math.inf}
    ahead = {"TTC": "behind", "THW": "behind", "DRAC": "heading 0, behind"}
    return [
        Scene(
            "oncoming", (0, 0, 0, 25, 0), (40 + length, 0, math.pi, 25, 0),
            at(0.8, THW=1.6, TTB=0.0, TTK=0.0, DRAC=math.inf),
            {"TTC": "speed", "WTTC": "root", "DRAC": "heading 0, speed"},
        ),
        Scene(
            "crossing", (0, 0, 0, 14, 0), (30, -22, 0.5 * math.pi, 11, 0),
            at((30.0 - 0.5 * (length + width)) / 14.0, THW=NONE), {"TTC": "lane", "DRAC": "lane"},
            crossing_at=30.0,
        ),
        Scene("overlapping by 1.7 m", (0, 0, 0, 20, 0), (3, 1, 0, 15, 0), at(0.0, THW=0.0, **never), ahead),
        Scene(
            "overlapping by 3.2 m", (0, 0, 0, 20, 0), (1.5, 1, 0, 15, 0), at(0.0, THW=0.0, **never),
            ahead | {"WTTC": "no root"},
        ),
        Scene(
            "from behind", (0, 0, 0, 10, 0), (-20 - length, 0, 0, 25, 0),
            at(20.0 / 15.0, THW=NONE, TTB=0.0, DRAC=math.inf), ahead,
        ),
    ]  # fmt: skip


def ours(scene: Scene) -> dict[str, tuple[Value, float]]:
    """Give our values and the seconds of each."""
    pairs, told = scene.pairs(), {}
    for name in {a: None for a, _ in scene.compared()}:
        began = time.perf_counter()
        found = OURS[name](pairs)
        seconds = time.perf_counter() - began
        state = State(int(found.state[0, 0]))
        words = {State.NO_CONFLICT: NONE, State.NOT_DEFINED: UNDEFINED, State.NOT_COMPUTED: "not computed"}
        told[name] = (words.get(state, float(found.value[0, 0])), seconds)
    return told


def crime(python: str, every: list[Scene]) -> dict[str, Any]:
    """Give what CriMe says, asked in its own environment: its version, and value and seconds by scene and measure."""
    script = Path(__file__).resolve().with_name("crime_scenes.py")
    given = {"size": SIZE, "lane_width": LANE, "step": STEP, "scenes": [s.told() for s in every]}
    with tempfile.TemporaryDirectory() as folder:
        put, got = Path(folder) / "in.json", Path(folder) / "out.json"
        put.write_text(json.dumps(given))
        done = subprocess.run(
            [python, str(script), str(put), str(got)], cwd=folder, check=False, capture_output=True, text=True
        )
        if done.returncode or not got.exists():
            raise SystemExit(f"{python} {script} ended with {done.returncode}:\n{done.stderr[-2000:]}")
        told: dict[str, Any] = json.loads(got.read_text())
    return told


def reason(scene: Scene, pair: tuple[str, str], own: Value, theirs: Value) -> str:
    """Say why they differ; "" where they do not, "?" where nobody has looked yet."""
    name = pair[0]
    special = scene.why.get(" ".join(pair), "")
    if isinstance(own, float) and isinstance(theirs, float) and (own == theirs or abs(own - theirs) <= SAME):
        return ""
    if own == NONE and (theirs == "inf" or (name == "DRAC" and theirs == 0.0)):
        return ""
    if own == 0.0 and theirs == "-inf":
        return "words"
    return special or scene.why.get(name) or BY_MEASURE.get(name, "?")


def shown(value: Value | None) -> str:
    """Give a number as it is read, a word as it is."""
    if not isinstance(value, float):
        return "–" if value is None else value
    return (
        "inf" if math.isinf(value) else f"{value:.3g}" if abs(value) >= 1e4 else f"{round(value, 3) + 0.0:g}"
    )


def rows(scene: Scene, own: dict[str, tuple[Value, float]], theirs: dict[str, Any] | None) -> list[list[str]]:
    """Give the table's rows of one scene; the last cell is the reason."""
    out = []
    known = {"WTTC": circles(scene)} | scene.analytic
    for name, asked in scene.compared():
        value = theirs[asked]["value"] if theirs else None
        if asked == "ALongReq" and isinstance(value, float):
            value = -value
        analytic = ("≥ " if name == "WTTC" else "") + shown(known.get(name))
        label = name if name == asked else f"{name} / {asked}"
        why = reason(scene, (name, asked), own[name][0], value) if theirs else ""
        out.append(
            [scene.name, label, analytic, shown(own[name][0]), shown(value) if theirs else "not run", why]
        )
    return out


def seconds(every: list[Scene], of: Any) -> str:
    """Give the range of seconds a scene over those that were asked for everything: simple measures, and searched."""
    told = []
    for simple in (True, False):
        sums = [
            sum(s for name, s in of(scene) if (name not in SEARCHED) == simple)
            for scene in every
            if not scene.only
        ]
        told.append(f"{min(sums):.3g} to {max(sums):.3g}")
    return f"{told[0]} s for the simple measures, {told[1]} s for {', '.join(SEARCHED)}"


def together(every: list[Scene]) -> float:
    """Give our seconds a scene where all go in one call, for everything."""
    each = [s.pairs() for s in every]
    pairs = Pairs(
        *(np.concatenate([getattr(p, name) for p in each]) for name in ("plan", "ego_size", "state", "size")),
        STEP,
    )
    began = time.perf_counter()
    for measure in OURS.values():
        measure(pairs)
    return (time.perf_counter() - began) / len(every)


def main() -> int:
    """Print the table, the reasons and the times."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--crime", help=f"Python in whose environment commonroad-crime {VERSION} is installed"
    )
    parser.add_argument("--differences", action="store_true", help="print only rows in which the two differ")
    args = parser.parse_args()
    every = scenes()
    for scene in every[:2]:
        ours(scene)  # what is paid once is not counted
    own = {s.name: ours(s) for s in every}
    theirs = crime(args.crime, every) if args.crime else None
    table = [row for s in every for row in rows(s, own[s.name], theirs["scenes"][s.name] if theirs else None)]
    print("| scene | measure (/ CriMe's) | analytic | ours | CriMe | reason |\n|---|---|---|---|---|---|")
    for row in table:
        if row[-1] or not (args.differences and theirs):
            print(f"| {' | '.join(row)} |")
    if theirs:
        used = {word for row in table for word in row[-1].split(", ")}
        print(
            f"\n{sum(not row[-1] for row in table)} of {len(table)} agree. CriMe {theirs['version']} differs by:\n"
        )
        print("\n".join(f"- **{name}**: {text}" for name, text in REASONS.items() if name in used))
        took = {s.name: [(k, v["seconds"]) for k, v in theirs["scenes"][s.name].items()] for s in every}
        print(f"\nA scene takes CriMe {seconds(every, lambda s: took[s.name])};")
        if theirs["version"] != VERSION:
            print(f"the reasons were read in {VERSION}, this is {theirs['version']}", file=sys.stderr)
    else:
        print("\nCriMe was not run: give --crime PYTHON.")
    print(f"us {seconds(every, lambda s: [(k, v[1]) for k, v in own[s.name].items()])},")
    print(f"and {together(every):.2g} s for all of them where the scenes go in one call.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
