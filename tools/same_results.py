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
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import duckdb
import pandas as pd

FIELDS = {
    "*/run.json:times.*": "how long it took",
    "*/run.json:perception.seeds[[]*].time": "how long it took",
    "*/cases/*.json:time": "how long it took",
    "*/times.parquet:time*": "how long it took",
    "*/journal/*.jsonl:*": "in the order in which runs ended; the rows are compared in their tables",
    "*.json:*versions.*": "the program's code state, and one list of packages for all results",
    "*/run.json:relaxation": "called lead_in",
    "*/run.json:lead_in": "called relaxation before",
    "*kpis.parquet:row[[]*": "a measure's row is called measure",
}
"""What may be there in one only, or differ: "file:path.of.field", with * and ?, to the reason."""
TEXTS: dict[str, str] = {
    "objectification": "measure",  # the field's word
    "first braking less measured": "braking delay against measured",  # plainer
}
"""Texts of OLD to those of NEW that stand for them."""
LINES = re.compile(
    r"((versions|cases|files): \S+|<hash>|\d+\.\d+\.\d+|engine|vehicle|sumo \d+\.\d+\.\d+|kinematic|single-track"
    r"|(Run|\. Made) with resim [^,]*, (code|numpy.*)|, numpy .*)"
    r'|\s*<property name="version\.\w[\w-]*" value="[^"]*"/>'
)
"""Lines of pages and of JUnit that may be there in one only: versions, and what FIELDS lists."""

SUITE = """name = "small"
criteria = "../scenarios/criteria/highway.toml"
{perception}
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
    "seen.toml": SUITE.format(perception='perception = "../adfunc/perception/proving_ground.json"\nseeds = 30'),
    "grid.toml": SWEEP.format(plan='plan = "grid"\nseeds = 2', first="steps = 3", second="steps = 3"),
    "sobol.toml": SWEEP.format(plan='plan = "sobol"\npoints = 8\nseeds = 1', first="", second=""),
    "adaptive.toml": SWEEP.format(
        plan='plan = "adaptive"\npoints = 20\nseeds = 2\n[adaptive]\noutcome = "same_decision"\nshare = 0.5',
        first="steps = 3\nwidth = 0.2", second="steps = 3\nwidth = 1.0",
    ),
}  # fmt: skip
"""Files of the folder `same` in each copy."""


OPTIONS = {
    "pilot": "--build adfunc/builds/highway_pilot-1.0.toml",
    "highway": "--criteria scenarios/criteria/highway.toml",
    "traffic": "--criteria scenarios/criteria/traffic.toml",
    "model": "--perception adfunc/perception/proving_ground.json",
}
TASKS = Path(__file__).with_suffix(".txt")
"""All three jobs, assessment, check, repair, conversion, training, reports; those after "# real" need real data."""

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
    made, _, real = TASKS.read_text().partition("# real\n")
    if not args.data.is_dir():
        print(f"{args.data} is not there: without real data")
        real = ""
    tasks = dict(
        line.split(None, 1) for line in (made + real).splitlines() if line and not line.startswith("#")
    )
    tasks = {name: command for name, command in tasks.items() if not args.only or name in args.only}
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


def run(side: Path, tasks: Mapping[str, str], data: Path) -> None:
    """Run each task in its turn; what it prints and its exit code are written beside its results."""
    environment = {
        **os.environ, "PYTHONPATH": str(side), "XDG_CACHE_HOME": str(side / "cache"), "OMP_NUM_THREADS": "1",
        "RESIM_CATALOG": str(side / "catalog.sqlite"), "COLUMNS": "200",
    }  # fmt: skip

    def call(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, *words], cwd=side, env=environment, capture_output=True, text=True, check=False
        )

    if any("same/training" in command for command in tasks.values()):
        call("tools/make_training.py", "--count", "6", "--out", "same/training").check_returncode()
    for name, command in tasks.items():
        words = command.format(data=data, **OPTIONS).split()
        done = call("-m", "resim", *itertools.chain.from_iterable(found(side, word) for word in words))
        printed = f"{done.stdout}\n--- stderr\n{done.stderr}\n--- exit code {done.returncode}\n"
        (side / "out" / f"{name}.printed").write_text(printed)


def found(side: Path, word: str) -> list[str]:
    """Give what a word of a command line stands for: the paths that a glob finds, or itself."""
    return sorted(str(p.relative_to(side)) for p in side.glob(word)) if "*" in word else [word]


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
            yield from of_values(
                cleaned(json.loads(a.read_text()), old), cleaned(json.loads(b.read_text()), new), ""
            )
        case ".parquet":
            yield from of_tables(duckdb.read_parquet(str(a)).df(), duckdb.read_parquet(str(b)).df())
        case ".html":
            mine, other = masked(a.read_text(), old), masked(b.read_text(), new)
            yield from of_lines(data_of(mine), data_of(other), "data")
            yield from of_lines(text_of(mine), text_of(other), "text")
        case ".printed" | ".xml" | ".toml" | ".csv" | ".md" | ".con" | ".nod" | ".edg" | ".jsonl":
            yield from of_lines(
                masked(a.read_text(), old).splitlines(), masked(b.read_text(), new).splitlines(), "line"
            )
        case _:
            yield "", f"{a.stat().st_size} bytes", f"{b.stat().st_size} other bytes"


def masked(text: str, side: Path) -> str:
    """Give a text without what may differ anywhere (folders, dates, hashes), and texts of OLD as those of NEW."""
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
    if len(a) != len(b):
        yield "", f"{len(a)} rows", f"{len(b)} rows"
    if list(a.columns) != list(b.columns):
        yield "<columns>", list(a.columns), list(b.columns)
    for column in (c for c in a.columns if c in b.columns and len(a) == len(b)):
        mine, other = (f[column].map(repr) for f in (a, b))
        if a[column].dtype != b[column].dtype:
            yield column, str(a[column].dtype), str(b[column].dtype)
        for row in mine.index[mine != other][:1]:
            yield f"{column}[{row}]", mine[row], other[row]


def of_lines(a: Sequence[str], b: Sequence[str], what: str) -> Iterator[Difference]:
    """Differences of two texts, line by line, but for LINES that are in one only."""
    kept = [[line for line in text if not LINES.fullmatch(line)] for text in (a, b)]
    for n, (mine, other) in enumerate(itertools.zip_longest(*kept, fillvalue="<none>")):
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
