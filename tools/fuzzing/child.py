"""Runs inputs one after the other in a process that may hang or die; told on standard output, a line each."""

from __future__ import annotations

import json
import os
import resource
import shutil
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from random import Random

MEMORY = 4 << 30
SESSION = "resim-"
"""Folder of the SUMO session that stays open for the next run; gone when the process ends."""


def main(kind: str, seed: int, numbers: range, scratch: str) -> None:
    """Run the inputs of these numbers in the folder `scratch`."""
    folder = Path(scratch)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.environ.update(TMPDIR=str(folder / "tmp"), XDG_CACHE_HOME=str(folder / "nets"))
    tempfile.tempdir = None
    (folder / "tmp").mkdir(exist_ok=True)
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    said = (folder / "said").open("w+b")
    os.dup2(said.fileno(), 2)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    warnings.simplefilter("always")
    warnings.simplefilter("ignore", DeprecationWarning)
    warnings.simplefilter("ignore", ResourceWarning)
    for number in numbers:
        print(json.dumps({"begin": number}), file=answers)
        said.seek(0)
        said.truncate()
        what, text = _one(kind, seed, number, folder, said.fileno())
        print(json.dumps({"done": number, "outcome": what, "text": text}), file=answers)


def _one(kind: str, seed: int, number: int, folder: Path, said: int) -> tuple[str, str]:
    own = folder / str(number)
    own.mkdir()
    try:
        before, run = _made(kind, seed, number, own)
        what, text = run()
        sys.stderr.flush()
        told = os.pread(said, 3000, 0).decode(errors="replace")
        faults = ("Traceback", "Warning", "unexpected ", "the process ")
        if any(fault in told for fault in faults) or (told and not text.startswith("exit code")):
            return "FAILURE", f"standard error: {told}"
        if told.count("\n") > 1:
            return "FAILURE", f"several lines on standard error: {told}"
        if left := _left(own, before, folder):
            return "FAILURE", f"left behind: {left}"
        return what, text
    except Exception:
        return "FAILURE", traceback.format_exc(limit=-8)[-3000:]
    finally:
        shutil.rmtree(own, ignore_errors=True)


def _made(kind: str, seed: int, number: int, own: Path) -> tuple[set[str], Callable[[], tuple[str, str]]]:
    """Make the input; give the names of what is in the folder then, and what gives the input to resim."""
    from fuzzing import entries, foreign, inputs

    if kind in foreign.KINDS:
        made = foreign.make(kind, Random(f"{kind} {seed} {number}"), own)
        names = (str(own), "--")  # options are named by their name
        return _tree(own), lambda: entries.outcome(iter([lambda: entries.imported(made, own)]), names)
    path = inputs.make(kind, seed, number, own)
    if inputs.whole_run(kind, seed, number):
        return _tree(own), lambda: entries.run(path, own, accept=number % 3 > 0)
    names = (str(own), str(inputs.GROUND)) if kind == "jscen" else (str(own),)
    return _tree(own), lambda: entries.outcome(entries.steps(kind, path, own, number), names)


def _tree(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if "__pycache__" not in path.parts}


def _left(own: Path, before: set[str], folder: Path) -> list[str]:
    """What should not be there: anything but whole nets, and the results of a run."""
    new = sorted(_tree(own) - before - {"cache", "out"})
    new = [name for name in new if not name.startswith("out/")]
    nets = [name for name in new if name.startswith("cache/") and name.count("/") == 1]
    whole = {
        f"{net}{end}" for net in nets if not net.startswith("cache/converting-")
        for end in ("", "/net.xml", "/simulated.net.xml", "/conversion.json")
    }  # fmt: skip
    odd = [name for name in new if name not in whole] + sorted(whole - set(new))
    return odd + [p.name for p in (folder / "tmp").iterdir() if not p.name.startswith(SESSION)]
