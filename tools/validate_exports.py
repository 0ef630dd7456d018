"""Holds exported drives against the tools that they are for: `python tools/validate_exports.py OMEGA PEER DATA`.

OMEGA: environment with omega-prime; PEER: with asam-osi-utilities and kognic-openlabel (`make checked_exports`). DATA:
folder with real recordings; those that ship, and one result, are checked without.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from openlabel_checker.core import check_file
from validate_openscenario import drives

from resim.jobs.export import export_drive

ROOT = Path(__file__).parents[1]
COUNT = """
import sys
import omega_prime
found = omega_prime.Recording.from_file(sys.argv[1], validate=True, parse_map=True)
print(found.df.height, "no map" if found.map is None else f"{len(found.map.lanes)} lanes")
"""
TRACE = """
import logging, sys
from pathlib import Path
logging.basicConfig(level=logging.WARNING, stream=sys.stdout)
from osi_utilities import ChannelSpecification, MessageType, open_channel
folder = Path(sys.argv[1]).parent.parent
every = [(folder / "osi" / "GT.osi", None, MessageType.GROUND_TRUTH)]
every.append((folder / "mcap" / "drive.mcap", "ground_truth", None))
if (folder / "osi" / "SD.osi").is_file():
    every.append((folder / "osi" / "SD.osi", None, MessageType.SENSOR_DATA))
    every.append((folder / "mcap" / "drive.mcap", "sensor_data", None))
counts = [sum(1 for _ in open_channel(ChannelSpecification(p, message_type=m, topic=t))) for p, t, m in every]
print(" ".join(map(str, counts)))
"""
LABELS = """
import json, sys
from kognic.openlabel.models import OpenLabelAnnotation
print(len(OpenLabelAnnotation.model_validate(json.load(open(sys.argv[1]))).openlabel.frames))
"""


def told(python: Path, code: str, file: Path) -> str:
    """Give the last line that a peer's Python says of a file, or of its error."""
    done = subprocess.run(
        [python, "-W", "ignore", "-c", code, file], capture_output=True, text=True, check=False
    )
    lines = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines() or ["nothing"]
    return ("" if done.returncode == 0 else "refused: ") + lines[-1][:120]


def main(omega: Path, peer: Path, data: Path) -> None:
    """Print a table."""
    print(
        "| drive | s to export | MCAP [MB] | omega-prime: rows, map | OSI: messages | OpenLABEL: frames | issues |"
    )
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        every = drives(data, home)
        order = [
            sys.executable,
            "-m",
            "resim",
            "run",
            ROOT / "scenarios" / "cut_in_brake",
            "--out",
            home / "result",
        ]
        order += ["--build", ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"]
        order += ["--criteria", ROOT / "scenarios" / "criteria" / "highway.toml"]
        subprocess.run(list(map(str, order)), capture_output=True, check=False)
        every["result of cut_in_brake"] = home / "result"
        python = peer / "bin" / "python"
        prime = omega / "bin" / "python"
        for name, drive in every.items():
            begin = time.perf_counter()
            for form in ("mcap", "osi", "openlabel"):
                export_drive(drive, home / form, form)
            taken = time.perf_counter() - begin
            file = home / "mcap" / "drive.mcap"
            issues = [
                issue
                for one in sorted((home / "openlabel").glob("*.openlabel.json"))
                for issue in check_file(str(one)).issues
            ]
            print(
                f"| {name} | {taken:.1f} | {file.stat().st_size / 1e6:.1f} | {told(prime, COUNT, file)} | "
                f"{told(python, TRACE, home / 'osi' / 'GT.osi')} | "
                f"{told(python, LABELS, home / 'openlabel' / 'GT.openlabel.json')} | {len(issues)} |",
                flush=True,
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute(), Path(sys.argv[2]).absolute(), Path(sys.argv[3]))
