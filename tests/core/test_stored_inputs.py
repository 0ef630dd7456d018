"""The store of frozen inputs: what nobody has used for 30 days goes, what a running command uses stays."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from resim.core.plugins.frozen import FrozenFile, freeze_file, load_frozen

DAY = 24 * 3600.0
KEEPS = """
import sys
from pathlib import Path
from resim.core.plugins.frozen import freeze_file
print(freeze_file(Path(sys.argv[1])).hash, flush=True)
sys.stdin.read()
"""


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "resim" / "inputs"


def command(path: Path) -> subprocess.Popen[str]:
    """A process that uses the file until its input ends."""
    path.write_text(path.name)
    return subprocess.Popen(
        [sys.executable, "-c", KEEPS, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


def used(copy: Path, days: float) -> None:
    """Make it look as if it was used last so many days ago."""
    then = time.time() - days * DAY
    for path in (*copy.rglob("*"), copy):
        os.utime(path, (then, then))


def written(path: Path) -> FrozenFile:
    """Freeze a new file, as any command may."""
    path.write_text(path.name)
    return freeze_file(path)


@pytest.mark.usefixtures("ends")
@pytest.mark.parametrize("name", ["input", "files.json"])
def test_a_copy_with_a_pipe_in_it_is_made_again(store: Path, tmp_path: Path, name: str) -> None:
    frozen = written(tmp_path / "a")
    (store / frozen.hash / name).unlink()
    os.mkfifo(store / frozen.hash / name)
    assert written(tmp_path / "a") == frozen
    assert load_frozen(frozen).raw == b"a"


def test_copies_that_nobody_has_used_for_30_days_are_cleared_away(store: Path, tmp_path: Path) -> None:
    running = {name: command(tmp_path / name) for name in ("old", "recent", "running")}
    copies = {}
    for name, process in running.items():
        assert process.stdout is not None
        copies[name] = store / process.stdout.readline().strip()
    for name in ("old", "recent"):
        running[name].communicate()
    used(copies["old"], 31.0)
    used(copies["recent"], 29.0)
    used(copies["running"], 31.0)
    mine = store / written(tmp_path / "mine").hash
    used(mine, 31.0)
    half, now = store / "new-half", store / "new-now"
    for folder in (half, now):
        (folder / "home").mkdir(parents=True)
    used(half, 31.0)
    another = store / written(tmp_path / "another").hash
    assert set(store.iterdir()) == {copies["recent"], copies["running"], mine, another, now}
    running["running"].communicate()
    written(tmp_path / "one more")
    assert not copies["running"].exists()


def test_a_copy_that_is_used_again_stays(store: Path, tmp_path: Path) -> None:
    frozen = written(tmp_path / "model")
    used(store / frozen.hash, 31.0)
    assert load_frozen(frozen).raw == b"model"
    assert time.time() - (store / frozen.hash / "input").stat().st_mtime < DAY
