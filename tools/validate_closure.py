"""Does a perception model close the gap between measured drive and re-simulation? The corner case, over seeds.

    python tools/validate_closure.py [MODEL] [--seeds 20]

Re-simulates scenarios/cut_in_brake on GT with the model, and with the virtual sensor itself that the drive was made
with (tools/make_scenarios.py), other seeds: what no model can do better than.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from make_scenarios import DRIVES, ROOT, Sensor

from resim import fidelity
from resim.ingest import read_recording
from resim.perception.model import read_model
from resim.perception.sensor import Sensor as Modelled
from resim.pipeline import Options, resimulate
from resim.road.sumo import sumo_net
from resim.sim.adfunction import load_build
from resim.sim.loop import simulate

SHIPPED = ROOT / "adfunc" / "perception" / "proving_ground.json"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", type=Path, nargs="?", default=SHIPPED)
    parser.add_argument("--seeds", type=int, default=20)
    asked = parser.parse_args()
    build = load_build(ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml")
    result = resimulate(read_recording(ROOT / "scenarios" / "cut_in_brake"), build, Options(bases=("GT",)))
    report, model = result.report(), read_model(asked.model)
    measured, decided = report["reaction"]["GT"], report["decision"]["GT"]
    print(f"measured: {', '.join(decided)}; first braking at {measured:.2f} s\n")
    print("| re-simulated with | same decision | first braking against GT: median, 5 to 95 % | end error |")
    print("|---|---|---|---|")
    without = report["reaction_difference"]["rGT"]
    print(f"| ideal perception | {int(report['decision']['rGT'] == decided)} of 1 | {without:+.2f} s | "
          f"{report['end_position_error']['rGT']:.2f} m |")  # fmt: skip
    perceptions = {
        model.name: lambda: Modelled(model),
        "the sensor itself": lambda: Sensor(DRIVES["cut_in_brake"].sensor),
    }
    for name, make in perceptions.items():
        same, late, off = 0, [], []
        for seed in range(asked.seeds):
            run = simulate(
                result.described["GT"], result.network, sumo_net(result.network).path, build, seed=seed,
                perception=make(),
            )  # fmt: skip
            same += fidelity.decision(run.truth, result.network, ego=result.ego) == decided
            if (reaction := fidelity.reaction_time(run.truth, ego=result.ego)) is not None:
                late.append(reaction - measured)
            off.append(result.end_error(run))
        low, middle, high = np.quantile(late, [0.05, 0.5, 0.95])
        print(f"| {name} | {same} of {asked.seeds} | {middle:+.3f} s, {low:+.2f} to {high:+.2f} | "
              f"{np.median(off):.2f} m, {np.min(off):.2f} to {np.max(off):.2f} |")  # fmt: skip


if __name__ == "__main__":
    main()
