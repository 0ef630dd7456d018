"""The whole story of the scenario space on traffic of SUMO, from drives to a verdict, with the time of each step.

    python tools/validate_space.py [HOURS [OUT]]

People's traffic and the function's test drives on networks/motorway.xodr (0.1 h each if nothing is said), mined; spaces
of both, compared; half of the test drives verified, with the ranges in which they may be varied, and what is verified
swept over variations; the space covered by both, the other half held out; a verdict.
With so little data it is `not shown`, and says how much is missing. `resim traffic --build` drives the function.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
MAP = ROOT / "networks" / "motorway.xodr"
BUILD = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
CRITERIA = ROOT / "scenarios" / "criteria"
VARIATIONS = 50
"""Of each verified drive, simulated."""


def resim(*told: object, may_end: tuple[int, ...] = (0,)) -> str:
    """Run a command, tell how long it took, and give what it printed. Raises SystemExit where it fails."""
    begin, before = time.monotonic(), core_time()
    done = subprocess.run(
        [sys.executable, "-m", "resim", *map(str, told)], capture_output=True, text=True, check=False
    )
    words = " ".join(str(one.name if isinstance(one, Path) else one) for one in told)
    print(
        f"| `resim {words[:100]}` | {done.returncode} | {time.monotonic() - begin:.0f} | {core_time() - before:.0f} |",
        flush=True,
    )
    if done.returncode not in may_end:
        sys.exit(f"{words}: {done.stderr[-2000:]}")
    return done.stdout


def core_time() -> float:
    """Seconds of processor time of all commands so far, and of their children."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def folders(where: Path) -> list[Path]:
    return sorted(one for one in where.iterdir() if (one / "recording.toml").is_file())


def main() -> int:
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 0.1
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(scratch)
        story(hours, out)
    return 0


def story(hours: float, out: Path) -> None:
    """All steps, each a command of resim."""
    print("| command | exit | s | s of one core |\n|---|---|---|---|")
    resim("traffic", MAP, "--out", out / "people", "--hours", hours, "--seed", 1)
    resim(
        "traffic",
        MAP,
        "--out",
        out / "drives",
        "--hours",
        hours,
        "--seed",
        2,
        "--build",
        BUILD,
        may_end=(0, 1),
    )
    resim("mine", *folders(out / "people"), "--out", out / "mined", "--scenarios", "rows")
    resim("mine", *folders(out / "drives"), "--out", out / "mined_drives", "--scenarios", "recordings",
          "--around", "surroundings",
          "--accept", "OVERLAP")  # fmt: skip
    resim("space", "build", out / "mined", "--out", out / "space_people")
    space = out / "space"
    resim("space", "build", out / "mined_drives", "--out", space)
    compared = resim("space", "compare", out / "space_people", space, "--out", out / "compared")
    verified = verify(out, 1, "--vary", "speed", "--vary", "gap", "--vary", "lane_change")
    swept = [one for one in (verified, sweep(out, verified)) if one is not None]
    covered = resim(
        "space",
        "cover",
        space,
        *(word for one in swept for word in ("--sweep", one)),
        "--held-out",
        verify(out, 2),
    )
    released = resim(
        "space",
        "release",
        space,
        "--limits",
        CRITERIA / "release.toml",
        "--out",
        out / "release",
        may_end=(0, 1),
    )
    print(f"\n```\n{compared}\n{covered}\n{released}```")
    verdict = json.loads((out / "release" / "release.json").read_text())["verdict"]
    print(f"\nverdict: {verdict}")


def sweep(out: Path, verified: Path) -> Path | None:
    """Sweep the verified drives over variations of those around; None where no drive is verified."""
    told = json.loads((verified / "verification.json").read_text(encoding="utf-8"))
    drives = [verified / one["folder"] for one in told["recordings"] if one["verdict"] == "verified"]
    if not drives:
        return None
    file = out / "variations.toml"
    recordings = "".join(f'[[recording]]\nfolder = "{drive.resolve()}"\n' for drive in drives)
    file.write_text(
        f"""name = "variations"
criteria = "{CRITERIA / "highway.toml"}"
build = ["{BUILD}"]
plan = "grid"
engine = "direct"
seeds = 1
[variation]
kernels = "{ROOT / "scenarios" / "kernels" / "motorway.json"}"
verified = "{verified / "verification.json"}"
{recordings}[[parameter]]
name = "variation.number"
low = 0.0
high = {float(VARIATIONS)}
steps = {VARIATIONS + 1}
""",
        encoding="utf-8",
    )
    resim("sweep", file, "--out", out / "swept", may_end=(0, 1))
    return out / "swept"


def verify(out: Path, number: int, *more: str) -> Path:
    """Verify every second test drive from the number-th on."""
    whole = out / "all.toml"
    resim(
        "suite",
        "new",
        out / "mined_drives" / "recordings",
        "--out",
        whole,
        "--criteria",
        CRITERIA / "highway.toml",
    )
    head, *drives = whole.read_text(encoding="utf-8").split("[[recording]]")
    suite = out / f"half_{number}.toml"
    suite.write_text("[[recording]]".join([head, *drives[number - 1 :: 2]]), encoding="utf-8")
    whole.unlink()
    resim("verify", suite, "--build", BUILD, "--out", out / f"verified_{number}", *more, may_end=(0, 1, 2))
    return out / f"verified_{number}"


if __name__ == "__main__":
    sys.exit(main())
