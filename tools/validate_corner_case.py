"""Set the corner case's errors beside those that Wagner 2021 published, and the SD fit beside the noise put in.

python tools/validate_corner_case.py
"""

from __future__ import annotations

import math
from pathlib import Path

from drives import DRIVES

from resim.recordings import read_recording
from resim.resimulation import resimulate
from resim.simulation.function.interface import load_build

ROOT = Path(__file__).parents[1]
PUBLISHED = {
    "S": {"ego": (0.226, 0.0513, 0.0363, 0.0420, 2.24e-5, 1.81e-4),
          "to": (1.56, 0.202, 0.456, 0.904, -6.12e-3, 0.0249)},
    "FIT_GT": {"ego": (0.0252, 0.00602, -4.69e-4, 0.0287, -5.36e-3, 8.83e-4),
               "to": (0.0863, 0.0193, 7.85e-3, 0.0848, -2.83e-3, 4.26e-3)},
    "FIT_SD": {"ego": (0.0170, 0.00401, -0.0567, 0.0432, -5.40e-3, 8.20e-4),
               "to": (0.190, 0.0648, -0.533, 0.870, 9.02e-4, 0.0228)},
    "SIM_GT": {"ego": (0.913, 1.02, 4.64e-3, 0.903, 0.0210, 0.0365),
               "to": (0.665, 0.309, 0.183, 0.256, -6.70e-4, 1.71e-3)},
    "SIM_SD": {"ego": (0.844, 0.947, 0.108, 1.06, 0.0205, 0.0355),
               "to": (0.541, 0.217, 0.0511, 0.122, -9.60e-4, 1.79e-3)},
}  # fmt: skip
"""Section 5.2.1, Tables 5.1 and 5.2: mean and standard deviation of d [m], speed [m/s], heading [rad]."""


def main() -> None:
    """Print both tables."""
    recording = read_recording(ROOT / "scenarios" / "cut_in_brake")
    result = resimulate(recording, load_build(ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"))
    report = result.report
    print(
        "| step | who | d published | d here | Δv published | Δv here | Δheading published | Δheading here |"
    )
    print("|" + "---|" * 8)
    for step, published in PUBLISHED.items():
        for who, figures in published.items():
            here = report.errors[step][who]
            cells = []
            for i, quantity in enumerate(("d", "v", "heading")):
                cells += [f"{figures[2 * i]:.3g} ± {figures[2 * i + 1]:.3g}"]
                cells += [f"{here[quantity]['mean']:.3g} ± {here[quantity]['std']:.3g}"]
            print(f"| {step} | {who.upper()} | {' | '.join(cells)} |")
    print(
        f"\nreaction {report.reaction}, difference {report.reaction_difference}, decision {report.decision}\n"
    )
    sensor = DRIVES["cut_in_brake"].sensor
    assert sensor is not None
    print(
        "| who | white noise put in, mean length [m] | FIT_SD mean [m] | published FIT_SD [m] |\n|---|---|---|---|"
    )
    for who, noise in (("ego", sensor.ego_noise), ("to", math.hypot(sensor.ego_noise, sensor.noise))):
        put_in = noise * math.sqrt(math.pi / 2.0)
        fit = report.errors["FIT_SD"][who]["d"]["mean"]
        print(f"| {who.upper()} | {put_in:.3f} | {fit:.3f} | {PUBLISHED['FIT_SD'][who][0]:.3f} |")


if __name__ == "__main__":
    main()
