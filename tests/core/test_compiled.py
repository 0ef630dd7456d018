"""What is compiled is compiled by one process, however many begin at once, and is right where a process was killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from numba.core.caching import CacheImpl

from resim.core.compiled import entry

LOOPS = """
import numpy as np
from resim.core.compiled import entry, inner, unfolded

@inner
def _square(x):
    return x * x

@unfolded
def _both(x, y):
    return np.sqrt(_square(x) + _square(y))

@entry()
def lengths(x, y):
    out = np.empty(len(x))
    for n in range(len(x)):
        out[n] = _both(x[n], y[n])
    return out
"""
CALL = """
import json, sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import numpy as np
import loops
Path(sys.argv[1], f"ready{sys.argv[2]}").touch()
while not Path(sys.argv[1], "go").exists():
    time.sleep(0.001)
if sys.argv[3] == "die":
    loops.lengths._cache.save_overload = lambda *given: (print("compiled", flush=True), time.sleep(60.0))
if sys.argv[3] == "break off":
    try:
        loops.lengths("no", "numbers")
    except Exception:
        print("broken off", flush=True)
    time.sleep(60.0)
found = loops.lengths(np.array([3.0, 5.0]), np.array([4.0, 12.0]))
stats = loops.lengths.stats
print(json.dumps([found.tolist(), sum(stats.cache_misses.values()), sum(stats.cache_hits.values())]))
"""


def call(folder: Path, number: int, end: str = "") -> subprocess.Popen[str]:
    words = [sys.executable, "-c", CALL, str(folder), str(number), end]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "kept")}
    return subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True)


def begin(folder: Path, calls: list[subprocess.Popen[str]]) -> None:
    while len(list(folder.glob("ready*"))) < len(calls):
        assert all(one.poll() is None for one in calls)
        time.sleep(0.01)
    (folder / "go").touch()


def test_one_process_compiles_and_the_others_read_it(tmp_path: Path) -> None:
    (tmp_path / "loops.py").write_text(LOOPS, "utf-8")
    calls = [call(tmp_path, number) for number in range(3)]
    begin(tmp_path, calls)
    found = [json.loads(one.communicate(timeout=60.0)[0]) for one in calls]
    assert [lengths for lengths, _, _ in found] == 3 * [[5.0, 13.0]]
    assert sorted((misses, hits) for _, misses, hits in found) == [(0, 1), (0, 1), (1, 0)]


def test_a_process_that_is_killed_while_it_compiles_holds_nobody_up(tmp_path: Path) -> None:
    (tmp_path / "loops.py").write_text(LOOPS, "utf-8")
    killed = call(tmp_path, 0, "die")
    begin(tmp_path, [killed])
    assert killed.stdout is not None
    assert killed.stdout.readline() == "compiled\n"
    other = call(tmp_path, 1)
    time.sleep(1.0)
    killed.send_signal(signal.SIGKILL)
    lengths, misses, hits = json.loads(other.communicate(timeout=60.0)[0])
    killed.communicate()
    assert (lengths, misses, hits) == ([5.0, 13.0], 1, 0)


def test_a_process_that_breaks_off_and_lives_on_holds_nobody_up(tmp_path: Path) -> None:
    (tmp_path / "loops.py").write_text(LOOPS, "utf-8")
    broken = call(tmp_path, 0, "break off")
    begin(tmp_path, [broken])
    assert broken.stdout is not None
    assert broken.stdout.readline() == "broken off\n"
    lengths, misses, hits = json.loads(call(tmp_path, 1).communicate(timeout=30.0)[0])
    broken.kill()
    broken.communicate()
    assert (lengths, misses, hits) == ([5.0, 13.0], 1, 0)


def test_where_nothing_can_be_written_it_compiles_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        CacheImpl, "_locator_classes", []
    )  # as where neither resim's folder nor a home can be written
    assert entry()(lambda x: 2.0 * x)(3.0) == 6.0
