"""What is told of a function that failed: its traceback and the last words of its process, everywhere, each once."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from lxml import html

Call = Callable[..., tuple[int, str, str]]
ROOT = Path(__file__).parents[2]
MODEL = ROOT / "adfunc" / "perception" / "proving_ground.json"
OWN = """import subprocess
from resim.simulation.function.interface import Command

class Own:
    def reset(self, setup): pass
    def close(self): pass
    def step(self, perceived):
        if perceived.t > 0.5:
            self.solve(perceived)
        return Command(0.0, 0.0)

    def solve(self, perceived):
        command = "echo no way found >&2; exit 3"
        subprocess.run(["sh", "-c", command], check=True)
"""


@pytest.fixture
def build(tmp_path: Path) -> Path:
    (tmp_path / "own_solver.py").write_text(OWN)
    path = tmp_path / "own.toml"
    path.write_text('name = "own"\nversion = "1.0"\nfactory = "own_solver:Own"\n')
    return path


def test_a_failure_is_told_with_traceback_and_last_words_and_that_of_many_seeds_once(
    call: Call, build: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    code, said, error = call(
        "run", ROOT / "scenarios" / "rear_end", "--build", build, "--basis", "gt", "--perception", MODEL,
        "--seeds", 3, "--out", out,
    )  # fmt: skip
    assert code == 3
    wanted = [
        "rGT+M, seed 0 (and 2 more): AD function failed: own-1.0 at t = ",
        "rGT+M, seed 0: raised at own_solver.py, line 9, in step: self.solve(perceived)",
        "rGT+M, seed 0: raised at own_solver.py, line 14, in solve: subprocess.run",
        "rGT+M, seed 0: last words: no way found",
        "rGT: raised at own_solver.py, line 9, in step: self.solve(perceived)",
        "rGT: last words: no way found",
    ]
    terminal = " ".join((said + error).split())
    report = json.loads((out / "report.json").read_text())["warnings"]
    page = " ".join(html.parse(str(out / "report.html")).getroot().text_content().split())
    for line in wanted:
        assert terminal.count(line) == page.count(line) == sum(line in one for one in report) == 1, line
    assert "seed 1: raised" not in terminal
    failures = json.loads((out / "run.json").read_text())["failures"]
    assert set(failures) == {"rGT", "rGT+M0", "rGT+M1", "rGT+M2"}
    for told in failures.values():
        assert "raised CalledProcessError" in told["reason"]
        assert told["traceback"][0].startswith("own_solver.py, line 9, in step")
        assert told["last_words"] == "no way found"


def test_what_was_written_before_the_failed_call_are_no_last_words(
    call: Call, build: Path, tmp_path: Path
) -> None:
    chatty = OWN.replace("import subprocess", "import sys", 1).replace(
        'subprocess.run(["sh", "-c", command], check=True)', 'raise ValueError("lost")'
    )
    chatty = chatty.replace("return Command", 'print("as ever", file=sys.stderr)\n        return Command')
    (tmp_path / "own_solver.py").write_text(chatty)
    out = tmp_path / "out"
    call("run", ROOT / "scenarios" / "rear_end", "--build", build, "--basis", "gt", "--out", out)
    told = json.loads((out / "run.json").read_text())["failures"]["rGT"]
    assert "raised ValueError: lost" in told["reason"]
    assert told["last_words"] is None
