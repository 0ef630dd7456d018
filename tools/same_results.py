"""Do two checkouts give the same results? Runs the same commands in both, and compares every byte of what they write.

    python tools/same_results.py OLD NEW [--data ../shared/data] [--only NAME]... [--reworded] [--keep DIR]

OLD and NEW are checkouts; their tracked files are copied, and each side works in its own copy. Compared are the exit
code, what is printed, and every file: JSON field by field and in order, tables cell by cell, pages by their text and
their data, all else as bytes. Versions, hashes and times are masked; FIELDS and TEXTS hold what else may differ, each
with its reason. With --reworded texts may differ in words, never in numbers and verdicts. Real maps and recordings
are taken where DATA is there. Exit code 1: something differs.
"""

from __future__ import annotations

import argparse
import html
import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import duckdb
import pandas as pd

PILOT = "--build adfunc/builds/highway_pilot-1.0.toml"
CRITERIA = "--criteria scenarios/criteria/highway.toml"
MODEL = "--perception adfunc/perception/proving_ground.json"

FIELDS = {
    "*/run.json:times.*": "how long it took",
    "*/run.json:perception.seeds[[]*].time": "how long it took",
    "*/cases/*.json:time": "how long it took",
    "*/times.parquet:time*": "how long it took",
    "*/journal/*.jsonl:*": "in the order in which runs ended; the rows are compared in their tables",
}
"""What may be there in one only, or differ: "file:path.of.field", with * and ?, to the reason."""
TEXTS: dict[str, str] = {}
"""Texts of OLD to those of NEW that stand for them."""

SUITE = f"""name = "small"
criteria = "../scenarios/criteria/highway.toml"
{{perception}}
[[recording]]
folder = "../scenarios/cut_in_brake"
[[recording]]
folder = "../scenarios/overtake"
[[recording]]
folder = "../scenarios/neighbours/lead_slows"
"""
SWEEP = """name = "small"
criteria = "../scenarios/criteria/highway.toml"
build = ["../adfunc/builds/highway_pilot-1.0.toml"]
perception = "../adfunc/perception/proving_ground.json"
{plan}
[[recording]]
folder = "../scenarios/cut_in_brake"
[[parameter]]
name = "perception.latency.speed"
low = 0.0
high = 1.2
{first}
[[parameter]]
name = "perception.errors.longitudinal.bias.constant"
low = -2.0
high = 4.0
{second}
"""
INPUTS = {
    "suite.toml": SUITE.format(perception=""),
    "seen.toml": SUITE.format(perception='perception = "../adfunc/perception/proving_ground.json"\nseeds = 4'),
    "grid.toml": SWEEP.format(plan='plan = "grid"\nseeds = 2', first="steps = 3", second="steps = 3"),
    "sobol.toml": SWEEP.format(plan='plan = "sobol"\npoints = 8\nseeds = 1', first="", second=""),
    "adaptive.toml": SWEEP.format(
        plan='plan = "adaptive"\npoints = 20\nseeds = 2\n[adaptive]\noutcome = "same_decision"\nshare = 0.5',
        first="steps = 3\nwidth = 0.2", second="steps = 3\nwidth = 1.0",
    ),
}  # fmt: skip
"""Files of the folder `same` in each copy."""


@dataclass(frozen=True)
class Task:
    """A command line, split at blanks; {data}: the folder of real data. `.` writes to `out`, and names the task."""

    name: str
    command: str
    real: bool = False


RESIM = [
    Task("run", f"run scenarios/cut_in_brake {PILOT} {CRITERIA} --out out/run"),
    Task("run_seen", f"run scenarios/cut_in_brake {PILOT} {CRITERIA} {MODEL} --seeds 3 --out out/run_seen"),
    Task("run_replay", "run scenarios/overtake --build adfunc/builds/replay-1.0.toml --out out/run_replay"),
    Task("run_follow", "run scenarios/neighbours/cut_out --build adfunc/builds/follow_trace-1.0.toml --vehicle single-track "
         "--step 0.02 --basis gt --out out/run_follow"),
    Task("run_idm", "run scenarios/rear_end --build adfunc/builds/idm-1.0.toml --criteria scenarios/criteria/traffic.toml "
         "--no-stop-at-collision --out out/run_idm"),
    Task("assess_recording", f"assess scenarios/cut_in_brake {CRITERIA} --out out/assess_recording"),
    Task("assess_run", f"assess out/run {CRITERIA} --out out/assess_run"),
    Task("assess_published", "assess scenarios/rear_end --mode published --path state --road-aware --out out/assess_published"),
    Task("fit_prediction", "assess fit-prediction scenarios/cut_in_brake scenarios/overtake --out out/fit_prediction.json"),
    Task("check", "check scenarios/cut_in_brake"),
    Task("check_broken", "check same/broken"),
    Task("fix", "check same/broken --fix out/fix"),
    Task("verify", f"verify same/suite.toml {PILOT} --out out/verify"),
    Task("verify_seen", f"verify same/seen.toml {PILOT} --out out/verify_seen --workers 1"),
    Task("verify_vary", f"verify same/suite.toml {PILOT} --vary gap --out out/verify_vary"),
    Task("verify_against", "verify same/suite.toml --build adfunc/builds/highway_pilot-1.2.toml --against "
         "adfunc/builds/highway_pilot-1.0.toml --out out/verify_against"),
    Task("replay_verified", "verify --replay out/verify/verification.json --out out/replay_verified"),
    Task("sweep_grid", "sweep same/grid.toml --out out/sweep_grid --workers 1"),
    Task("sweep_sobol", "sweep same/sobol.toml --out out/sweep_sobol"),
    Task("sweep_adaptive", "sweep same/adaptive.toml --out out/sweep_adaptive"),
    Task("report_grid", "sweep report out/sweep_grid --out out/report_grid.html"),
    Task("report_sobol", "sweep report out/sweep_sobol --out out/report_sobol.html"),
    Task("report_adaptive", "sweep report out/sweep_adaptive --out out/report_adaptive.html"),
    Task("repeat", "sweep repeat out/sweep_grid 5 --out out/repeat"),
    Task("runs", "runs list"),
    Task("suite_new", f"suite new scenarios/neighbours --out out/suite_new.toml {CRITERIA}"),
    Task("show", "perception show adfunc/perception/proving_ground.json --set latency.speed=0.4"),
    Task("train", "perception train same/training/* --out out/train.json --report out/train.html"),
    Task("map_check", "map check networks/proving_ground.xodr"),
    Task("map_convert", "map convert networks/proving_ground.xodr --out out/map_convert"),
    Task("map_plot", "map plot networks/proving_ground.xodr --out out/map_plot.html"),
    Task("no_recording", "run scenarios/nowhere --build adfunc/builds/idm-1.0.toml --out out/no_recording"),
    Task("no_field", f"run scenarios/overtake {PILOT} {MODEL} --set latency.sped=1 --out out/no_field"),
    Task("import", "import commonroad {data}/ngsim/USA_US101-10_1_T-1.xml --map {data}/ngsim/USA_US101-10_1_T-1.xodr --ego 529 "
         "--out out/import", real=True),
    Task("run_real", "run out/import --build adfunc/builds/idm-1.0.toml --out out/run_real --criteria "
         "scenarios/criteria/traffic.toml", real=True),
    Task("map_real", "map convert {data}/ngsim/USA_Lanker-1_17_T-1.xodr --out out/map_real", real=True),
]  # fmt: skip
"""All three jobs, assessment, check and repair, map conversion, training, reports; a later one may read what an earlier wrote."""

HASH = re.compile(r"(?<![\w.])([0-9a-f]{8}|[0-9a-f]{12,64})(?![\w.])")
DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[+-]\d\d:\d\d)?")
ESSENCE = re.compile(
    r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?|PASS|FAIL|INVALID|not verified|verified|undecided|invalid|failed"
)
TAG = re.compile(r"<[^>]+>")
SCRIPT = re.compile(r"<script\b[^>]*>(.*?)</script>|<style\b[^>]*>(.*?)</style>", re.DOTALL)


def main() -> int:
    """Run and compare; print what differs; 1 if anything does."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[2] / "shared" / "data")
    parser.add_argument(
        "--only", action="append", metavar="NAME", help="this task; may be given several times"
    )
    parser.add_argument("--reworded", action="store_true", help="texts may differ in words")
    parser.add_argument("--keep", type=Path, help="folder to work in, which stays")
    args = parser.parse_args()
    tasks = [t for t in RESIM if not args.only or t.name in args.only]
    if not args.data.is_dir():
        print(f"{args.data} is not there: without real data")
        tasks = [t for t in tasks if not t.real]
    with tempfile.TemporaryDirectory() as temporary:
        base = (args.keep or Path(temporary)).resolve()
        sides = [base / "old", base / "new"]
        for side, checkout in zip(sides, (args.old, args.new), strict=True):
            copy(checkout, side)
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda side: run(side, tasks, args.data.resolve()), sides))
        differences = list(compare(*sides, reworded=args.reworded))
    for line in differences:
        print(line)
    print(
        f"{len(tasks)} tasks: " + (f"{len(differences)} differences" if differences else "the same results")
    )
    return 1 if differences else 0


def copy(checkout: Path, to: Path) -> None:
    """Copy the tracked files of a checkout, as they are there now, and add the folder `same`."""
    shutil.rmtree(to, ignore_errors=True)
    listed = subprocess.run(["git", "-C", str(checkout), "ls-files", "-z"], check=True, capture_output=True)
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (checkout / name).is_file():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(checkout / name, to / name)
    for name, text in INPUTS.items():
        (to / "same").mkdir(exist_ok=True)
        (to / "same" / name).write_text(text)
    spoil(to / "scenarios" / "rear_end", to / "same" / "broken")
    (to / "out").mkdir(exist_ok=True)


def spoil(recording: Path, to: Path) -> None:
    """Copy a recording with rows missing, a position off, SD late, and a heading that jumps by a turn."""
    shutil.copytree(recording, to)
    text = (to / "recording.toml").read_text()
    (to / "recording.toml").write_text(re.sub(r'map = "\.\./', 'map = "../../scenarios/', text))
    gt = pd.read_csv(to / "gt.csv", dtype={"id": str})
    other = gt.index[gt["id"] != gt["id"].iloc[0]]
    gt.loc[other[100], "x"] += 30.0
    gt.drop(index=other[140:150]).to_csv(to / "gt.csv", index=False)
    sd = pd.read_csv(to / "sd.csv", dtype={"id": str})
    sd["t"] += 0.4
    sd.to_csv(to / "sd.csv", index=False)


def run(side: Path, tasks: Sequence[Task], data: Path) -> None:
    """Run each task in its turn; what it prints and its exit code are written beside its results."""
    environment = {
        **os.environ, "PYTHONPATH": str(side), "XDG_CACHE_HOME": str(side / "cache"), "OMP_NUM_THREADS": "1",
        "RESIM_CATALOG": str(side / "catalog.sqlite"), "COLUMNS": "200",
    }  # fmt: skip
    if any("training" in task.command for task in tasks):
        make = [sys.executable, "tools/make_training.py", "--count", "6", "--out", "same/training"]
        subprocess.run(make, cwd=side, env=environment, check=True, capture_output=True)
    for task in tasks:
        words = task.command.format(data=data).split()
        words = [
            n
            for w in words
            for n in (sorted(str(p.relative_to(side)) for p in side.glob(w)) if "*" in w else [w])
        ]
        done = subprocess.run(
            [sys.executable, "-m", "resim", *words],
            cwd=side,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        printed = f"{done.stdout}\n--- stderr\n{done.stderr}\n--- exit code {done.returncode}\n"
        (side / "out" / f"{task.name}.printed").write_text(printed)


def compare(old: Path, new: Path, *, reworded: bool) -> Iterator[str]:
    """Give a line for each file that is in one only, and each difference in a file of both."""
    names = [
        {str(p.relative_to(side)) for p in (side / "out").rglob("*") if p.is_file()} for side in (old, new)
    ]
    for name in sorted(names[0] ^ names[1]):
        if not reviewed(name):
            yield f"{name}: only in {'OLD' if name in names[0] else 'NEW'}"
    for name in sorted(names[0] & names[1]):
        a, b = old / name, new / name
        for where, mine, other in itertools.islice(differences(a, b, old, new), 20):
            path = f"{name}:{where}" if where else name
            alike = (
                isinstance(mine, str)
                and isinstance(other, str)
                and ESSENCE.findall(mine) == ESSENCE.findall(other)
            )
            if not reviewed(path) and not (reworded and alike):
                yield f"{path}: {short(mine)} -> {short(other)}"


def reviewed(path: str) -> bool:
    """Whether a difference there is listed."""
    return any(fnmatch(path, pattern) for pattern in FIELDS)


def short(value: object) -> str:
    """Give a value in at most 160 characters."""
    text = repr(value)
    return text if len(text) <= 160 else text[:157] + "..."


Difference = tuple[str, object, object]


def differences(a: Path, b: Path, old: Path, new: Path) -> Iterator[Difference]:
    """Give where two files differ, and both values, all hashes, times and folders masked."""
    if a.read_bytes() == b.read_bytes():
        return
    match a.suffix:
        case ".json":
            mine, other = (cleaned(json.loads(p.read_text()), at) for p, at in ((a, old), (b, new)))
            yield from of_values(mine, other, "")
        case ".parquet":
            yield from of_tables(*(duckdb.read_parquet(str(p)).df() for p in (a, b)))
        case ".html":
            pages = [masked(p.read_text(), at) for p, at in ((a, old), (b, new))]
            yield from of_lines(*(data_of(page) for page in pages), "data")
            yield from of_lines(*(text_of(page) for page in pages), "text")
        case ".printed" | ".xml" | ".toml" | ".csv" | ".md" | ".con" | ".nod" | ".edg" | ".jsonl":
            yield from of_lines(
                *(masked(p.read_text(), at).splitlines() for p, at in ((a, old), (b, new))), "line"
            )
        case _:
            if a.read_bytes() != b.read_bytes():
                yield "", f"{a.stat().st_size} bytes", f"{b.stat().st_size} other bytes"


def masked(text: str, side: Path) -> str:
    """Give a text without what may differ anywhere: its folder, dates, hashes; reviewed texts of OLD as those of NEW."""
    text = DATE.sub("<date>", text.replace(str(side), "<checkout>"))
    for mine, other in TEXTS.items():
        text = text.replace(mine, other)
    return HASH.sub("<hash>", text)


def cleaned(value: Any, side: Path) -> Any:
    """Give a JSON value with all its texts masked."""
    if isinstance(value, dict):
        return {masked(k, side): cleaned(v, side) for k, v in value.items()}
    if isinstance(value, list):
        return [cleaned(v, side) for v in value]
    return masked(value, side) if isinstance(value, str) else value


def of_values(a: Any, b: Any, path: str) -> Iterator[Difference]:
    """Differences of two JSON values, the order of fields included."""
    if isinstance(a, dict) and isinstance(b, dict):
        both = [k for k in a if k in b]
        if both != [k for k in b if k in a]:
            yield f"{path}.<order>", both, [k for k in b if k in a]
        for key in (*a, *(k for k in b if k not in a)):
            yield from of_values(a.get(key, "<none>"), b.get(key, "<none>"), f"{path}.{key}".lstrip("."))
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for n, (mine, other) in enumerate(zip(a, b, strict=True)):
            yield from of_values(mine, other, f"{path}[{n}]")
    elif not (type(a) is type(b) and a == b):
        yield path, a, b


def of_tables(a: pd.DataFrame, b: pd.DataFrame) -> Iterator[Difference]:
    """Differences of two tables: rows, columns, and the first cell of each column that differs."""
    if len(a) != len(b) or list(a.columns) != list(b.columns):
        yield "", f"{len(a)} rows of {list(a.columns)}", f"{len(b)} rows of {list(b.columns)}"
    for column in (c for c in a.columns if c in b.columns and len(a) == len(b)):
        mine, other = (f[column].map(repr) for f in (a, b))
        if a[column].dtype != b[column].dtype:
            yield column, str(a[column].dtype), str(b[column].dtype)
        for row in mine.index[mine != other][:1]:
            yield f"{column}[{row}]", mine[row], other[row]


def of_lines(a: Sequence[str], b: Sequence[str], what: str) -> Iterator[Difference]:
    """Differences of two texts, line by line."""
    for n, (mine, other) in enumerate(itertools.zip_longest(a, b, fillvalue="<none>")):
        if mine != other:
            yield f"{what}[{n}]", mine, other


def data_of(page: str) -> list[str]:
    """Give what the figures of a page show: a line a script that holds data."""
    return [text for text, _ in SCRIPT.findall(page) if text.lstrip().startswith(("{", "["))]


def text_of(page: str) -> list[str]:
    """Give the text of a page, a line an element."""
    return [
        html.unescape(line).strip()
        for line in TAG.sub("\n", SCRIPT.sub("", page)).splitlines()
        if line.strip()
    ]


if __name__ == "__main__":
    sys.exit(main())
