"""What a task has come to while it runs: how far it is, and the results of a sweep so far."""

from __future__ import annotations

import json
import threading
from collections import Counter, OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from resim.core.watched import PROGRESS
from resim.execution.journal import checksum
from resim.supervisor.processes import opened, read_whole

MOST_READ = 20_000_000
"""Bytes of journals that are read at one look; the rest at the next ones."""
KEPT = 16
"""Sweeps whose counts are remembered."""
MOST_WORDS, MOST_RUNS = 200, 10_000_000
KPI = "kpi "


@dataclass(frozen=True)
class TaskProgress:
    """How far a task is. total: None where that is not known. last: what was done last, the latest first."""

    unit: str
    done: int
    total: int | None
    last: tuple[str, ...]


@dataclass
class SweepSoFar:
    """What the runs of a sweep came to so far.

    Attributes:
        runs: How many are done.
        verdicts: How many have which verdict; failed: without a result.
        criteria: By criterion, how many have which verdict.
        collisions: In how many the EGO collided.
        risk: The highest accident risk, and in which run; None where there is none.
    """

    runs: int = 0
    verdicts: Counter[str] = field(default_factory=Counter)
    criteria: dict[str, Counter[str]] = field(default_factory=dict)
    collisions: int = 0
    risk: tuple[float, int] | None = None
    read: dict[str, int] = field(default_factory=dict, repr=False)
    seen: bytearray = field(default_factory=bytearray, repr=False)

    def copy(self) -> SweepSoFar:
        """Give what a page shows, which stays as it is while others look on."""
        criteria = {name: Counter(counts) for name, counts in self.criteria.items()}
        return SweepSoFar(self.runs, Counter(self.verdicts), criteria, self.collisions, self.risk)


def task_progress(folder: Path) -> TaskProgress | None:
    """Give how far the command of a task is, None where it does not say so."""
    told = read_whole(folder / PROGRESS)
    unit, done, total, last = (told.get(name) for name in ("unit", "done", "total", "last"))
    if not isinstance(unit, str) or type(done) is not int or not 0 <= done < 10**12:
        return None
    whole = total if type(total) is int and 0 < total < 10**12 else None
    words = [one[:MOST_WORDS] for one in last if isinstance(one, str)] if isinstance(last, list) else []
    return TaskProgress(unit[:40], done, whole, tuple(reversed(words[-30:])))


class SweepsSoFar:
    """Counts runs of sweeps as they come: of each journal only what is new is read."""

    def __init__(self) -> None:
        self._known: OrderedDict[Path, SweepSoFar] = OrderedDict()
        self._lock = threading.Lock()

    def look(self, sweep: Path) -> SweepSoFar | None:
        """Give what a sweep has come to, None where the folder holds none that was begun."""
        if not (sweep / "sweep.json").is_file():
            return None
        with self._lock:
            found = self._known.pop(sweep, None) or SweepSoFar()
            if any(size < found.read.get(name, 0) for name, size in _sizes(sweep).items()):
                found = SweepSoFar()  # it was begun anew
            for path in sorted((sweep / "journal").glob("*.jsonl")):
                _read_on(found, path)
            self._known[sweep] = found
            if len(self._known) > KEPT:
                self._known.popitem(last=False)
            return found.copy()


def stamp_of(folder: Path) -> float:
    """Give what is another number once a task says that it is farther."""
    try:
        return (folder / PROGRESS).stat().st_mtime
    except OSError:
        return 0.0


def _sizes(sweep: Path) -> dict[str, int]:
    try:
        return {path.name: path.stat().st_size for path in (sweep / "journal").glob("*.jsonl")}
    except OSError:
        return {}


def _read_on(found: SweepSoFar, path: Path) -> None:
    """Count what was appended to a journal; a line that is not whole yet is read at the next look."""
    start = found.read.get(path.name, 0)
    try:
        with opened(path) as file:
            file.seek(start)
            held = file.read(MOST_READ)
    except OSError:
        return
    whole = held[: held.rfind(b"\n") + 1]
    found.read[path.name] = start + len(whole)
    for line in whole.splitlines():
        if line[:9] == checksum(line[9:]) + b" ":
            try:
                _count(found, json.loads(line[9:]))
            except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
                continue  # `resim sweep` itself says what is wrong with it


def _count(found: SweepSoFar, entry: Mapping[str, object]) -> None:
    run, row = entry["run"], entry["row"]
    if type(run) is not int or not 0 <= run < MOST_RUNS or not isinstance(row, Mapping):
        return
    found.seen.extend(bytes(max(0, run + 1 - len(found.seen))))
    if found.seen[run]:
        return  # it was done twice
    found.seen[run] = 1
    found.runs += 1
    found.verdicts[
        "failed" if row.get("failure") is not None else str(row.get("verdict") or "not judged")
    ] += 1
    found.collisions += row.get("collision") is True
    risk = row.get("risk")
    if isinstance(risk, float) and (found.risk is None or risk > found.risk[0]):
        found.risk = risk, run
    for name, value in row.items():
        if name.startswith(KPI) and isinstance(value, str):
            found.criteria.setdefault(name.removeprefix(KPI), Counter())[value] += 1
