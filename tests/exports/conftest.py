"""A result that all formats are made of."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `resim run` wrote, judged and with a perception model."""
    out = tmp_path_factory.mktemp("run") / "out"
    order = [sys.executable, "-m", "resim", "run", "scenarios/cut_in_brake", "--out", str(out)]
    order += [
        "--build",
        "adfunc/builds/highway_pilot-1.0.toml",
        "--criteria",
        "scenarios/criteria/highway.toml",
    ]
    order += ["--perception", "adfunc/perception/proving_ground.json", "--seeds", "2"]
    done = subprocess.run(order, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    return out
