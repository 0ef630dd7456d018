"""What it costs a simulation to be watched: the same drive with and without RESIM_LIVE, in turns.

The corner case, or another recording, re-simulated in this process. The last line is JSON: slower, the share of
processor time that watching takes, and objects, how many there are.

    python tools/bench/live.py [RECORDING] [--drives 40] [--build BUILD]
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from pathlib import Path

from resim.core.watched import LIVE_VARIABLE
from resim.recordings import read_recording
from resim.road.opendrive import load
from resim.scenario.scenario import describe
from resim.simulation.case import Case
from resim.simulation.direct import Direct
from resim.simulation.function.interface import load_build

ROOT = Path(__file__).parents[2]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path, nargs="?", default=ROOT / "scenarios" / "cut_in_brake")
    parser.add_argument("--drives", type=int, default=40, help="of each kind")
    parser.add_argument("--build", type=Path, default=ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml")
    asked = parser.parse_args()
    recording = read_recording(asked.recording)
    network, tracks = load(recording.map), recording.gt
    first, last = (float(t[tracks.index(recording.ego)]) for t in tracks.span())
    scenario = describe(tracks.window(first, last), network, ego=recording.ego, map_name=recording.map.name)
    case = Case(scenario, network, load_build(asked.build), Direct(), stop_at_collision=False)
    spent = {"alone": 0.0, "watched": 0.0}
    with tempfile.TemporaryDirectory() as folder:
        case.drive()  # compiles
        for _ in range(asked.drives):
            for how in spent:
                os.environ[LIVE_VARIABLE] = str(Path(folder) / "live.json") if how == "watched" else ""
                begin = time.process_time()
                case.drive()
                spent[how] += time.process_time() - begin
    for how, seconds in spent.items():
        print(f"{how}: {1e3 * seconds / asked.drives:.1f} ms of a core a drive of {last - first:.1f} s")
    print(
        json.dumps({"slower": round(spent["watched"] / spent["alone"] - 1.0, 4), "objects": len(tracks) - 1})
    )


if __name__ == "__main__":
    main()
