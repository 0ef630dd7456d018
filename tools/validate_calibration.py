"""Is predicted risk told rightly as calibrated or not, where the function collides: test drives in traffic that brakes.

    python tools/validate_calibration.py [EACH [OUT]]

`constant_velocity-1.0` never brakes. Somebody cuts in and brakes, or brakes little, or cuts in far ahead; by how much,
how near and how fast is drawn. EACH (40) drives a kind are simulated, mined and verified; as many others are held out:
drawn alike, drawn with harder braking, and few. The space is made of both, since accidents that are in no space forbid
a release; predictions are made without what is held out. For each sort the reliability diagram is printed with the
verdict that `resim space cover` tells and the one that it should tell, and the verdicts of `resim space release`.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from drives import LANE, Drive, Motion, Traffic, profile, swerve
from make_scenarios import record
from validate_space import BUILD, CRITERIA, ROOT, folders, resim

from resim.core.geometry import Floats
from resim.road.path import Path as LanePath

FUNCTION = BUILD.with_name("constant_velocity-1.0.toml")
EACH, FEW = 40, 6
V, DURATION = 24.0, 8.0
"""m/s of the EGO, s of a drive."""
BRAKING = {"brakes": (0.0, 5.0), "brakes little": (0.0, 2.4), "far": (0.0, 0.0)}
"""m/s², drawn evenly between; who brakes little does so with somebody beside the EGO, and is of another kind so."""
HARDER = {"brakes": (4.0, 8.0), "brakes little": (1.0, 4.0), "far": (0.0, 0.0)}
GAP = {"brakes": (6.0, 12.0), "brakes little": (14.0, 20.0), "far": (55.0, 70.0)}
"""m between centres as the drive begins."""
LAX = """name = "lax"
confidence = 0.95
least_seen = 0.8
least_seen_source = "none"
least_drives = 30
least_drives_source = "none"
[[limit]]
per = "hour"
accidents = 600.0
source = "none"
"""
MINING = "[extraction]\nafter = 10.0\n"
"""The scenario of a lane change lasts to the end of the drive, so that what it leads to is in it."""


def cut_in(gap: float, v: float, braking: float, beside: bool) -> Traffic:
    """Somebody comes from the left, `gap` [m] ahead at v [m/s], and brakes [m/s²] once on the EGO's lane; somebody
    follows, and if asked somebody stays beside."""

    def traffic(path: LanePath, t: Floats) -> dict[str, Motion]:
        found = {
            "1": (gap + profile(t, v, (3.7, 20.0, -braking)), LANE - swerve(t, 1.0, 2.6, LANE)),
            "2": (-45.0 + profile(t, V - 1.0), np.zeros_like(t)),
        }
        return found | ({"3": (profile(t, V) - 1.0, np.full_like(t, LANE))} if beside else {})

    return traffic


def drawn(braking: dict[str, tuple[float, float]], each: int, seed: int) -> list[Drive]:
    """Give so many test drives of each kind."""
    rng = np.random.default_rng(seed)
    return [
        Drive(
            f"a cut-in that {kind}", FUNCTION.stem, DURATION, -2, V,
            cut_in(rng.uniform(*GAP[kind]), V + rng.uniform(0.0, 2.0), rng.uniform(*braking[kind]),
                   kind == "brakes little"), None, seed=k,
        )
        for kind in BRAKING for k in range(each)
    ]  # fmt: skip


def driven(drives: Sequence[Drive], out: Path, prefix: str) -> Path:
    """Simulate them; gives the folder of the recordings."""
    hit = 0
    for k, drive in enumerate(drives):
        hit += bool(record(f"{prefix}{k:03d}", drive, out / f"{prefix}{k:03d}").collisions)
    print(f"\n{prefix}: {len(drives)} test drives, {hit} collide\n", flush=True)
    return out


def mined(drives: Path, out: Path) -> Path:
    """Cut their scenarios out."""
    rules = out.with_suffix(".toml")
    rules.write_text(MINING, encoding="utf-8")
    print("| command | exit | s | s of one core |\n|---|---|---|---|")
    resim("mine", *folders(drives), "--out", out, "--scenarios", "recordings", "--around", "surroundings",
          "--labels", rules)  # fmt: skip
    return out


def verified(recordings: Path, out: Path) -> Path:
    """Verify them all."""
    suite = out.with_suffix(".toml")
    resim("suite", "new", recordings, "--out", suite, "--criteria", CRITERIA / "highway.toml")
    resim("verify", suite, "--build", FUNCTION, "--out", out, may_end=(0, 1))
    return out


def covered(space: Path, members: Path, held: Path, asked: str) -> None:
    """Print the reliability diagram by a folder of held-out drives."""
    resim("space", "cover", space, "--sweep", members, "--held-out", held)
    found = json.loads((space / "cover.json").read_text(encoding="utf-8"))["calibration"]
    print(
        "\n| predicted | drives | recordings | mean | collided, or not known | verdict |\n|---|---|---|---|---|---|"
    )
    for one in found["bins"]:
        hit = "{value:.3f} ({low:.3f} to {high:.3f})".format(**one["collided"])
        print(f"| {one['low']:g} to {one['high']:g} | {one['drives']} | {one['recordings']} |"
              f" {one['predicted']:.4f} | {hit} | {one['verdict']} |")  # fmt: skip
    print(f"\n{found['drives']} held-out drives, {found['unknown']} without prediction or outcome: "
          f"**{found['verdict']}**, should be {asked}\n", flush=True)  # fmt: skip


def released(space: Path, out: Path) -> None:
    """Print the verdict by the limits that ship, and by LAX, which nobody should ask for."""
    lax = out / "lax.toml"
    lax.write_text(LAX, encoding="utf-8")
    for limits in (CRITERIA / "release.toml", lax):
        folder = out / f"{space.name}_{limits.stem}"
        told = [sys.executable, "-m", "resim", "space", "release", space, "--limits", limits, "--out", folder]
        subprocess.run([str(one) for one in told], capture_output=True, check=False)
        found = json.loads((folder / "release.json").read_text(encoding="utf-8"))
        hour = found["budgets"][0]
        print("| limits | verdict | accidents an hour: known risk | at most in all |\n|---|---|---|---|")
        known = (
            "none"
            if hour["known"]["value"] is None
            else "{value:.3g} ({low:.3g} to {high:.3g})".format(**hour["known"])
        )
        most = "not known" if hour["high"] is None else f"{hour['high']:.3g}"
        print(f"| {limits.stem} | {found['verdict']} | {known} | {most} |", flush=True)
        print(f"\n{found['statement']}\n", flush=True)


def story(each: int, out: Path) -> None:
    """Members, three sorts of held-out drives, and what is said of each."""
    members = mined(driven(drawn(BRAKING, each, 1), out / "drives", "member"), out / "mined")
    by = verified(members / "recordings", out / "verified")
    for name, braking, count, asked in (
        ("alike", BRAKING, each, "calibrated"), ("harder", HARDER, each, "too low"), ("few", BRAKING, FEW, "not shown")
    ):  # fmt: skip
        held = driven(drawn(braking, count, 2 + (name == "few")), out / name, name)
        cut = mined(held, out / f"mined_{name}")
        against = verified(cut / "recordings", out / f"verified_{name}")
        space = out / f"space_{name}"
        resim("space", "build", members, cut, "--out", space)
        covered(space, by, against, asked)
        released(space, out)


def main() -> None:
    each = int(sys.argv[1]) if len(sys.argv) > 1 else EACH
    with tempfile.TemporaryDirectory(dir=ROOT) as scratch:
        story(each, Path(sys.argv[2]) if len(sys.argv) > 2 else Path(scratch))


if __name__ == "__main__":
    main()
