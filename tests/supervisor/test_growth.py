"""What a task has come to while it runs: progress, runs of a sweep as they come, a space that enters itself."""

from __future__ import annotations

import asyncio
import json
import re
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the extra serve is not installed")

from resim.cli.progress import ProgressReporter
from resim.core.watched import LIVE_VARIABLE, PROGRESS
from resim.execution.journal import Journal, JournalEntry
from resim.results.queue import new_id
from resim.supervisor import events
from resim.supervisor.growth import SweepsSoFar, task_progress


def run(number: int, verdict: str | None, **more: Any) -> JournalEntry:
    row = {"end": "duration", "failure": None, "collision": False, "risk": 0.01 * number, "verdict": verdict,
           "kpi distance": verdict} | more  # fmt: skip
    return JournalEntry(number, "plan", row, 0.1)


def test_a_command_says_how_far_it_is_to_who_watches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(LIVE_VARIABLE, str(tmp_path / "live.json"))
    with ProgressReporter("runs", 4) as progress:
        progress.step("1 failed")
        progress.step("2 failed")
    found = task_progress(tmp_path)
    assert found is not None
    assert (found.unit, found.done, found.total, found.last) == ("runs", 2, 4, ("2 failed", "1 failed"))
    assert [p.name for p in tmp_path.iterdir()] == [PROGRESS]


@pytest.mark.parametrize(
    "told",
    ["", "[]", '{"unit": 1}', '{"unit": "runs", "done": -1}', '{"unit": "a", "done": true}', "{" * 9999],
)
def test_what_says_nonsense_of_its_progress_says_nothing(tmp_path: Path, told: str) -> None:
    (tmp_path / PROGRESS).write_text(told)
    assert task_progress(tmp_path) is None


def test_runs_of_a_sweep_are_counted_as_they_come(tmp_path: Path) -> None:
    sweeps = SweepsSoFar()
    assert sweeps.look(tmp_path) is None
    (tmp_path / "sweep.json").write_text("{}")
    with Journal(tmp_path / "journal" / "1-of-1.jsonl") as journal:
        journal.append(run(0, "PASS"))
        journal.append(run(1, "FAIL", collision=True))
        found = sweeps.look(tmp_path)
        assert found is not None
        assert (found.runs, found.collisions, found.risk) == (2, 1, (0.01, 1))
        journal.append(run(2, None, failure="crashed"))
    with (tmp_path / "journal" / "1-of-1.jsonl").open("ab") as file:
        file.write(b"00000000 {}\n12345678 {half a li")
    with Journal(tmp_path / "journal" / "1-of-2.jsonl") as journal:
        journal.append(run(1, "FAIL", collision=True))  # done twice, counted once
        journal.append(run(3, "PASS"))
    found = sweeps.look(tmp_path)
    assert found is not None
    assert dict(found.verdicts) == {"PASS": 2, "FAIL": 1, "failed": 1}
    assert found.criteria["distance"] == {"PASS": 2, "FAIL": 1}
    (tmp_path / "journal" / "1-of-1.jsonl").write_text("")
    assert (sweeps.look(tmp_path) or found).runs == 2  # it was begun anew


def test_a_page_shows_a_sweep_while_it_grows(supervisor: Any, user: Any, tmp_path: Path) -> None:
    name = new_id()
    folder = tmp_path / "tasks" / name
    sweep = folder / "result"
    supervisor.queue.add(name, "sweep", ("sweep", "run", f"--out={sweep}"), str(folder))
    supervisor.queue.claim("server")
    sweep.mkdir(parents=True)
    assert "So far" not in user.get(f"/tasks/{name}").text
    (sweep / "sweep.json").write_text("{}")
    (folder / PROGRESS).write_text(json.dumps({"unit": "runs", "done": 1, "total": 8, "last": ["0 failed"]}))
    with Journal(sweep / "journal" / "1-of-1.jsonl") as journal:
        journal.append(run(7, "FAIL"))
    page = user.get(f"/tasks/{name}").text
    assert 'max="8" value="1"' in page
    assert "0.07 in run 7" in page
    assert re.search("<th>distance</th><td[^>]*>0</td><td[^>]*>1</td><td[^>]*>0</td>", page)


def test_a_stream_says_that_a_task_is_farther(
    supervisor: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(events, "GROWTH", 0.0)
    monkeypatch.setattr(events, "LOOK", 0.01)

    async def read() -> bytes:
        async for event in events.stream(supervisor, tmp_path / "log.txt", 0):
            if event.startswith(b"event: changed"):
                return event
            (tmp_path / PROGRESS).write_text("{}")
        return b""

    assert asyncio.run(asyncio.wait_for(read(), 5.0)).startswith(b"event: changed")
