"""What training finds with few drives, and what it tells of models that do not fit: tables in Markdown.

    python tools/validate_training.py [power|fit] [--seeds 30]

Drives are made by tests/perception/generator.py, which shares nothing with training: 10 s at 10 Hz with 3 to 5 objects.
power: how often a dependence of a spread and a maneuver's own error are found that are there, and how often a
dependence or a maneuver where there is none, by the number of drives.
fit: how often it is told that a model does not fit, of errors that it fits and that it does not.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from resim.perception.model import (
    FEATURES,
    Error,
    ErrorModels,
    Latency,
    ModelFit,
    PerceptionModel,
    Response,
    Spread,
)
from resim.perception.training.drive import drive_of
from resim.perception.training.errors import MEASURED, error_of, fit_objects
from resim.perception.training.fit import fit_of
from resim.perception.training.maneuvers import fit_maneuvers
from resim.perception.training.matching import match
from resim.perception.training.samples import samples_of
from resim.recordings import Recording

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from perception.generator import Beyond, make_recording

DRIVES = (5, 6, 8, 10, 15, 20)
FIT_DRIVES = (6, 10, 20)
RATE = 10.0  # Hz
OFFSET = Response(constant=0.5)


def known(by_range: float = 0.0, bias: Response = OFFSET) -> PerceptionModel:
    """Latencies, drifts and noise; of the errors along, their bias, and the logarithm of their noise by range [1/m]."""
    return PerceptionModel(
        name="known",
        latency=Latency(position=0.1, speed=0.4, heading=0.2),
        errors=ErrorModels(
            longitudinal=Error(
                bias=bias, drift=Spread(constant=0.1), correlation_time=1.0,
                noise=Spread(constant=0.15, range=by_range),
            ),
            lateral=Error(noise=Spread(constant=0.1)),
            speed=Error(drift=Spread(constant=0.15), correlation_time=0.5, noise=Spread(constant=0.1)),
            heading=Error(noise=Spread(constant=0.01)),
        ),
    )  # fmt: skip


def trained(recordings: list[Recording]) -> tuple[set[str], set[str], ModelFit]:
    """Give the dependences and the maneuvers that are in the model trained on these, and how it fits."""
    drives = [drive_of(r) for r in recordings]
    samples = samples_of(drives, match(drives))
    objects = fit_objects(samples)
    errors = {q: error_of(objects.fitted[q]) for q in MEASURED}
    slopes = {
        f"{q}.{part}.{f}"
        for q, e in errors.items()
        for part in ("bias", "drift", "noise")
        for f in FEATURES
        if getattr(getattr(e, part), f) != 0.0
    }
    maneuvers, _, own = fit_maneuvers(samples, objects, ErrorModels(**errors))  # type: ignore[arg-type]
    return slopes, set(maneuvers), fit_of(samples, objects, own)


Made = Callable[[int, np.random.Generator], Recording]

CASES: dict[str, Made] = {
    "slope": lambda seed, _: make_recording(known(0.01), seed, rate=RATE),
    "weak slope": lambda seed, _: make_recording(known(0.004), seed, rate=RATE),
    "braking": lambda seed, _: make_recording(
        known(), seed, rate=RATE, beyond=Beyond(braking=(("lateral", 0.15),))
    ),
    "nothing": lambda seed, _: make_recording(known(), seed, rate=RATE),
    "drives differ": lambda seed, rng: make_recording(
        known(), seed, rate=RATE, beyond=Beyond(level=float(np.exp(0.25 * rng.standard_normal())))
    ),
}  # fmt: skip


def power(seeds: int) -> None:
    print("| drives | slope of 0.01/m | of 0.004/m | braking's own offset | no slope: any, any maneuver |"
          " drives differ: any slope, any maneuver |\n|---|---|---|---|---|---|")  # fmt: skip
    for count in DRIVES:
        cells = []
        for name, made in CASES.items():
            results = []
            for seed in range(seeds):
                rng = np.random.default_rng([seed, count])
                results.append(trained([made(100_000 * count + 100 * seed + k, rng) for k in range(count)]))
            if "slope" in name:
                cells.append(
                    _share(
                        [
                            any(s.startswith("longitudinal.noise.range") for s in slopes)
                            for slopes, *_ in results
                        ]
                    )
                )
            elif name == "braking":
                cells.append(_share(["braking" in maneuvers for _, maneuvers, _ in results]))
            else:
                cells.append(", ".join(_share([bool(r[k]) for r in results]) for k in (0, 1)))
        print(f"| {count} | " + " | ".join(cells) + " |", flush=True)


FITS = {
    "a model that fits": known(),
    "a model with straight lines, which fits": known(bias=Response(constant=0.5, range=0.03, bearing=0.5)),
}
BEYOND = {
    "heavy tails (Student's t, 3)": Beyond(tails=3.0),
    "latency varies by 0.15 s from list to list": Beyond(late=0.15),
    "latency varies by 0.15 s over 2 s": Beyond(late=0.15, late_time=2.0),
    "speeds 3 % too high": Beyond(scale=0.03),
    "speed 0.6 m/s too high while braking": Beyond(braking=(("speed", 0.6),)),
    "along, an error that bends with range: 2 m at 60 m, 8 m at 120 m": Beyond(bend=(("longitudinal", 8.0),)),
    "the same, 0.5 m at 60 m, 2 m at 120 m": Beyond(bend=(("longitudinal", 2.0),)),
    "across, 0.5 m more on the left than on the right": Beyond(side=(("lateral", 0.5),)),
}


def fit(seeds: int) -> None:
    head = " | ".join(f"{count} drives" for count in FIT_DRIVES)
    print(f"| told that it does not fit | {head} |\n|---|" + "---|" * len(FIT_DRIVES))
    cases = {name: (model, Beyond()) for name, model in FITS.items()}
    cases |= {name: (known(), beyond) for name, beyond in BEYOND.items()}
    for name, (model, beyond) in cases.items():
        cells, said = [], set()
        for count in FIT_DRIVES:
            told = []
            for seed in range(seeds * (4 if name in FITS else 1)):
                numbers = range(100_000 * count + 100 * seed, 100_000 * count + 100 * seed + count)
                *_, found = trained([make_recording(model, k, rate=RATE, beyond=beyond) for k in numbers])
                told.append(bool(found.misfits))
                said |= {(m.quantity, m.assumption, m.on) for m in found.misfits}
            cells.append(_share(told))
        print(f"| {name} | " + " | ".join(cells) + " |", file=sys.stdout, flush=True)
        print(name, sorted(said), file=sys.stderr, flush=True)


def _share(hits: list[bool]) -> str:
    return f"{sum(hits)} of {len(hits)}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=["power", "fit"])
    parser.add_argument("--seeds", type=int, default=30)
    asked = parser.parse_args()
    {"power": power, "fit": fit}[asked.part](asked.seeds)


if __name__ == "__main__":
    main()
