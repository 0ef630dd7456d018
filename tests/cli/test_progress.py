"""How far a command is: a line now and then where there is no terminal."""

from __future__ import annotations

import pytest

from resim.cli import progress
from resim.cli.progress import ProgressReporter


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What time it is [s], to be changed."""
    now = [1000.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_a_line_now_and_then(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressReporter("runs") as told:
        told.skip(10)
        told.expect(50)
        told.expect(50)
        for _ in range(20):
            clock[0] += 6.0
            told.step("2 failed")
    out, error = capsys.readouterr()
    assert out == ""
    assert error.splitlines()[:2] == ["0 runs", "10 of 50 runs"]
    assert error.splitlines()[2] == "12 of 50 runs: 2 failed"  # too few to tell
    assert error.splitlines()[3] == "14 of 50 runs, about 4 min left: 2 failed"
    assert error.splitlines()[-1] == "30 of 50 runs, about 2 min left: 2 failed"
    assert len(error.splitlines()) == 12


def test_who_is_done_soon_says_that_it_begins(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressReporter("stages", 3) as told:
        for stage in ("read", "train", "validate"):
            told.step(stage)
            clock[0] += 3.0
    assert tuple(capsys.readouterr()) == ("", "0 of 3 stages\n")
