"""The first command that README shows after `make demo` works as shown, by the environment's own command."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
COMMAND = Path(sys.executable).parent / "resim"


def shown(text: str, begins: str) -> list[str]:
    """The words of the first command that begins so."""
    found = re.search(rf"{re.escape(begins)}(?:[^\n]*\\\n)*[^\n|]*", text)
    assert found is not None
    return shlex.split(found[0].replace("\\\n", " "))


def test_the_first_command_after_make_demo_works_as_shown(tmp_path: Path) -> None:
    if not COMMAND.is_file():
        pytest.skip("resim is not installed beside this Python")
    demo = shown((ROOT / "Makefile").read_text(encoding="utf-8"), "$(BIN)/resim run")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    first = shown(readme.partition("make demo ")[2], "resim run")
    assert demo[1:] == first[1:]  # it replaces what the demo wrote
    for name in ("scenarios", "adfunc", "networks"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    (tmp_path / ".venv" / "bin" / "resim").symlink_to(COMMAND)
    path = (
        f"{tmp_path / '.venv' / 'bin'}{os.pathsep}{os.environ['PATH']}"  # as `source .venv/bin/activate` does
    )
    for _ in ("make demo", "README"):
        done = subprocess.run(
            first, cwd=tmp_path, env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}, capture_output=True,
            text=True, check=False, timeout=300,
        )  # fmt: skip
        assert done.returncode == 1, done.stderr  # the corner case does not pass, which it is for
        assert "report: out/cut_in_brake/report.html" in " ".join(done.stdout.split())
    assert (tmp_path / "out" / "cut_in_brake" / "report.html").is_file()
