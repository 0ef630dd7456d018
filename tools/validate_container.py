"""Builds and runs the example container, and holds it against the same function as a process.

    python tools/validate_container.py docker [--port 50051] [--options "..."] [--keep-images]

The first word may be more than one: "podman --runtime runc". Prints a table: what was done, and what came of it. Ends
with 1 where something did not hold.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RESIM = [sys.executable, "-m", "resim"]
RECORDING = ROOT / "scenarios" / "cut_in_brake"
TABLES = ("tracks.parquet", "answers.parquet", "plans.parquet")
BUILD = """name = "follow"
version = "1.0"
{table}
[parameters]
time_gap = 1.5
"""


def main() -> None:
    """Do the steps of the guide, and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("engine", help="docker, podman, or how it is called here")
    parser.add_argument("--port", type=int, default=50051)
    parser.add_argument("--options", default="", help="more options of `run`")
    parser.add_argument("--keep-images", action="store_true", help="the images are there: build none")
    given = parser.parse_args()
    engine = shlex.split(given.engine)
    rows: list[tuple[str, bool, str]] = []
    if not given.keep_images:
        for name, folder in (("resim", ROOT), ("follow", ROOT / "adfunc" / "cpp")):
            begin = time.monotonic()
            done = _call([*engine, "build", "-t", name, str(folder)])
            rows.append((f"image {name}", done.returncode == 0, f"{time.monotonic() - begin:.0f} s"))
    with tempfile.TemporaryDirectory() as folder:
        rows += _driven(engine, given.port, shlex.split(given.options), Path(folder))
    print("| what | holds | found |\n|---|---|---|")
    for what, holds, found in rows:
        print(f"| {what} | {'yes' if holds else 'NO'} | {found} |")
    sys.exit(not all(holds for _, holds, _ in rows))


def _driven(engine: list[str], port: int, options: list[str], folder: Path) -> list[tuple[str, bool, str]]:
    """Start the container, drive with it, and end it in two ways."""
    begin, rows = [*engine, "run", "-d", *options, "-p", f"127.0.0.1:{port}:50051", "follow"], []
    served = folder / "container.toml"
    served.write_text(BUILD.format(table=f'[grpc]\naddress = "127.0.0.1:{port}"'))
    process = _process(folder)
    container = _call(begin).stdout.strip()
    try:
        rows.append(("says where it listens", *_listens(engine, container)))
        checked = _call([*RESIM, "function", "check", str(served)])
        rows.append(("resim function check", checked.returncode == 0, _count(checked.stdout)))
        for build, out in ((served, "container"), (process, "process")):
            _call([*RESIM, "run", str(RECORDING), "--build", str(build), "--out", str(folder / out)])
        same = [
            (folder / "container" / t).read_bytes() == (folder / "process" / t).read_bytes() for t in TABLES
        ]
        rows.append(("same tables as the process, to the byte", all(same), f"{sum(same)} of {len(TABLES)}"))
        rows.append(("killed at work", *_killed(engine, container, served, folder)))
    finally:
        _call([*engine, "rm", "-f", container])
    container = _call(begin).stdout.strip()
    _listens(engine, container)
    start = time.monotonic()
    _call([*engine, "stop", container])
    seconds = time.monotonic() - start
    _call([*engine, "rm", "-f", container])
    return [*rows, ("stops when it is told to", seconds < 8.0, f"{seconds:.1f} s")]


def _count(said: str) -> str:
    """How many checks hold."""
    lines = said.splitlines()
    return f"{sum(line.startswith('holds') for line in lines)} of {len(lines)} hold"


def _process(folder: Path) -> Path:
    """The same function as a process build."""
    source = ROOT / "adfunc" / "cpp" / "follow.cpp"
    include = ["-I", str(ROOT / "resim" / "function")]
    subprocess.run(["c++", "-std=c++17", "-O2", *include, source, "-o", folder / "follow"], check=True)
    (folder / "process.toml").write_text(BUILD.format(table='[process]\ncommand = ["./follow"]'))
    return folder / "process.toml"


def _listens(engine: list[str], container: str) -> tuple[bool, str]:
    """Wait until the container says that it listens."""
    for _ in range(300):
        said = _call([*engine, "logs", container]).stdout.strip()
        if "listens on" in said:
            return True, said
        time.sleep(0.2)
    return False, "nothing in a minute"


def _killed(engine: list[str], container: str, build: Path, folder: Path) -> tuple[bool, str]:
    """Kill the container while it is asked: the run is to say so, and end with 3."""
    order = [
        *RESIM,
        "run",
        str(RECORDING),
        "--basis",
        "gt",
        "--build",
        str(build),
        "--out",
        str(folder / "killed"),
    ]
    slow = [*order, "--step", "0.001"]
    run = subprocess.Popen(slow, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    top = [*engine, "top", container]
    while run.poll() is None and "follow" not in _call([*top, "args"]).stdout.replace("follow.toml", ""):
        time.sleep(0.05)
    _call([*engine, "kill", container])
    said = run.communicate()[0]
    why = next((line for line in said.splitlines() if "rGT: follow-1.0 at t" in line), said[-200:])
    return run.returncode == 3, why[:160]


def _call(order: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(order, capture_output=True, text=True, check=False)


if __name__ == "__main__":
    main()
