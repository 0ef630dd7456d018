"""The steps of the Dockerfile, as far as they can be done without Docker."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

TEXT = (ROOT / "Dockerfile").read_text()


def test_it_installs_the_system_libraries_that_are_told() -> None:
    (install,) = re.findall(r"apt-get install -y --no-install-recommends (.*) \\", TEXT)
    assert install in (ROOT / "README.md").read_text()
    assert set(install.split()) == set(re.findall(r"\.so\.\d+:([\w.-]+)", (ROOT / ".ci/run").read_text()))


def test_nobody_is_root_in_it() -> None:
    assert TEXT.index("\nUSER resim\n") < TEXT.index("\nENTRYPOINT")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_what_it_copies_and_installs_does_the_three_jobs(tmp_path: Path) -> None:
    """Installed by the step's own words, from what .dockerignore lets through alone, and called from elsewhere."""
    source, home = tmp_path / "source", tmp_path / "home"
    source.mkdir()
    for name in re.findall(r"^!(\S+)$", (ROOT / ".dockerignore").read_text(), re.MULTILINE):
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, source / name)
    subprocess.run([sys.executable, "-m", "venv", home], check=True)
    (words,) = re.findall(r"^RUN (pip install .*)$", TEXT, re.MULTILINE)
    step = shlex.split(words.replace("/usr/src/resim", str(source)))
    subprocess.run([home / "bin" / step[0], *step[1:]], check=True)
    environment = {"PATH": f"{home}/bin:{os.environ['PATH']}", "HOME": str(tmp_path), "RESIM_CATALOG": "none"}
    data, build = ROOT / "scenarios", ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
    suite = tmp_path / "suite.toml"
    suite.write_text(
        f'name = "s"\ncriteria = "{data}/criteria/highway.toml"\n[[recording]]\nfolder = "{data}/overtake"\n'
    )
    text = (data / "sweeps" / "perception_latency.toml").read_text().replace('"../', f'"{data}/')
    text = re.sub(r"seeds = \d+", "seeds = 1", re.sub(r"steps = \d+", "steps = 2", text))
    sweep = tmp_path / "sweep.toml"
    sweep.write_text(text.replace(f"{data}/../", f"{ROOT}/"))
    for command in (
        ("run", data / "cut_in_brake", "--build", build, "--out", "run"),
        ("verify", suite, "--build", build, "--out", "verified"),
        ("sweep", sweep, "--out", "swept"),
    ):
        done = subprocess.run(
            ["resim", *map(str, command)],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
