"""Give damaged maps, recordings, JSCEN and build files to resim, and count what becomes of them.

    python tools/fuzz.py 10000 [--seed S] [--kind map] [--only NUMBER] [--time-limit 30]
    .venv-formats/bin/python tools/fuzz.py 13000 --kind imports     # recordings in formats of others, as many of each

Every input must give a result or an error that names the file: no traceback, warning, hang, crash, memory beyond
4 GB, or file left behind. The same kind, seed and number make the same input. Exit code 1 where one failed.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from fuzzing.foreign import KINDS

TOOLS = Path(__file__).parent
IMPORTS = "imports"
SHARES = {"map": 0.4, "recording": 0.3, "jscen": 0.2, "build": 0.1}
Answer = tuple[int, str, str]
"""Number of the input, outcome, and what was said."""


def outcomes(kind: str, seed: int, numbers: range, limit: float) -> Iterator[Answer]:
    """Run the inputs in child processes: a new one after each that hung or died."""
    while numbers:
        for answer in _batch(kind, seed, numbers, limit):
            numbers = range(answer[0] + 1, numbers.stop)
            yield answer


def _batch(kind: str, seed: int, numbers: range, limit: float) -> Iterator[Answer]:
    with tempfile.TemporaryDirectory(prefix="fuzz-", ignore_cleanup_errors=True) as folder:
        call = f"from fuzzing.child import main; main({kind!r}, {seed}, {numbers!r}, {folder!r})"
        environment = {
            **os.environ,
            "PYTHONPATH": str(TOOLS),
            "OMP_NUM_THREADS": "1",
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONWARNINGS": "always,ignore::DeprecationWarning,ignore::ResourceWarning",
        }
        child = subprocess.Popen(
            [sys.executable, "-c", call], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment,
            stdin=subprocess.DEVNULL, process_group=0,
        )  # fmt: skip
        try:
            yield from _answers(child, numbers, limit, Path(folder))
        finally:
            if child.poll() is None:
                os.killpg(child.pid, 9)
            child.communicate()


def _answers(child: subprocess.Popen[bytes], numbers: range, limit: float, folder: Path) -> Iterator[Answer]:
    assert child.stdout is not None
    running, patience, rest = numbers.start, limit + 30.0, b""
    while True:
        ready, _, _ = select.select([child.stdout], [], [], patience)
        more = os.read(child.stdout.fileno(), 65536) if ready else b""
        if not more:
            break
        *lines, rest = (rest + more).split(b"\n")
        for line in lines:
            told = json.loads(line)
            running, patience = told.get("begin", running), limit
            if "done" in told:
                yield told["done"], told["outcome"], told["text"]
                running += 1
    if running < numbers.stop:
        yield running, "FAILURE", _death(child, ready != [], limit, folder)


def _death(child: subprocess.Popen[bytes], ended: bool, limit: float, folder: Path) -> str:
    if not ended:
        return f"no answer within {limit:g} s"
    said = (folder / "said").read_text(errors="replace")[-1500:] if (folder / "said").is_file() else ""
    return f"the process ended with {child.wait(10)}: {said}"


def shares(total: int, only: str | None) -> dict[str, int]:
    """Give how many inputs of each kind."""
    if only == IMPORTS:
        return dict.fromkeys(KINDS, total // len(KINDS))
    if only is not None:
        return {only: total}
    return {kind: round(share * total) for kind, share in SHARES.items()}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("total", type=int, nargs="?", default=400, help="how many inputs")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", choices=[*SHARES, IMPORTS, *KINDS])
    parser.add_argument("--only", type=int, help="number of the one input to run, of --kind")
    parser.add_argument("--time-limit", type=float, default=60.0, help="s for one input")
    parser.add_argument("--verbose", action="store_true", help="print what was said of every input")
    given = parser.parse_args()
    failures, table = [], []
    for kind, count in shares(given.total, given.kind).items():
        begin, counts = time.monotonic(), Counter[str]()
        numbers = range(count) if given.only is None else range(given.only, given.only + 1)
        for number, what, text in outcomes(kind, given.seed, numbers, given.time_limit):
            counts[what] += 1
            if what == "FAILURE" or given.verbose:
                failures += [what] * (what == "FAILURE")
                again = f"--kind {kind} --seed {given.seed} --only {number}"
                print(f"{kind} {number} ({again}): {what}\n{text}\n", flush=True)
        row = (kind, len(numbers), counts["result"], counts["clear error"], counts["FAILURE"])
        table.append((*row, f"{time.monotonic() - begin:.0f} s"))
    print("| kind | inputs | results | clear errors | failures | time |\n|---|---|---|---|---|---|")
    print("\n".join(f"| {' | '.join(map(str, row))} |" for row in table))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
