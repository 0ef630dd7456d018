"""The US-101 suite on a few vehicles: an oracle is verified, and a function that did not drive is the cause."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from resim.verification.entries import VerifiedRecording
from resim.verification.execution import verify
from resim.verification.request import VerifyOptions, make_request
from resim.verification.suite import read_suite

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
SUITE, BUILDS = ROOT / "scenarios" / "suites" / "us101.toml", ROOT / "adfunc" / "builds"

pytestmark = pytest.mark.skipif(not (DATA / "ngsim").is_dir(), reason="needs ../shared/data")

MAKE = """
import pathlib, sys
from make_us101 import make
make(pathlib.Path(sys.argv[1]), "USA_US101-12_1_T-1", pathlib.Path(sys.argv[2]), 2)
"""
Verdicts = Callable[..., dict[str, tuple[str, str | None]]]


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The suite with two vehicles of its recordings."""
    home = tmp_path_factory.mktemp("us101")
    made = subprocess.run(
        [sys.executable, "-c", MAKE, str(DATA), str(home / "us101")], cwd=ROOT / "tools", check=False
    )
    assert made.returncode == 0
    path = home / "us101.toml"
    text = SUITE.read_text().replace("../us101/*", f"{home}/us101/*")
    path.write_text(text.replace("../criteria", str(ROOT / "scenarios" / "criteria")))
    return path


@pytest.fixture
def verdicts(few: Path) -> Verdicts:
    """Verify the vehicles with a build; gives verdict and step of the cause by recording."""

    def run(build: str, *driven_by: str) -> dict[str, tuple[str, str | None]]:
        options = VerifyOptions(driven_by=driven_by)
        wanted = make_request(read_suite(few), BUILDS / build, None, options, few.parent)
        found, _ = verify(wanted, few.parent, None, workers=1)
        entries = [r for r in found.recordings if isinstance(r, VerifiedRecording)]
        assert len(entries) == len(found.recordings)
        return {r.name: (r.verdict, r.cause and r.cause.step) for r in entries}

    return run


@pytest.mark.slow
def test_replay_is_verified(verdicts: Verdicts) -> None:
    found = verdicts("replay-1.0.toml")
    assert len(found) == 2
    assert set(found.values()) == {("verified", None)}


@pytest.mark.slow
def test_a_function_that_did_not_drive_is_the_cause_itself(verdicts: Verdicts) -> None:
    """Nothing that was recorded tells how the vehicle answers, so that it may be the cause where it is off."""
    found = set(verdicts("idm-1.0.toml", "unknown").values())
    assert found <= {("not verified", "function"), ("not verified", "function or vehicle")}
