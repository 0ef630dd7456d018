"""Files that are named on the command line are looked at before anything is imported that takes time."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from resim.core import remedies

CALLED = "import sys; from resim.cli import main\ntry: main()\nfinally: print('pandas' in sys.modules)"


def called(folder: Path, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """What a command says in a process of its own that tells whether it has imported pandas."""
    return subprocess.run(
        [sys.executable, "-c", CALLED, *words], cwd=folder, env={**os.environ, **environment},
        capture_output=True, text=True, timeout=60.0, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("words", "problem", "remedy"),
    [
        (
            "run none --build good/recording.toml --out o",
            "none/recording.toml: cannot be read",
            remedies.RECORDING,
        ),
        ("run good --build b --out o", "b: cannot be read", remedies.BUILD),
        ("run good --build bad.toml --out o", "bad.toml: is not TOML (", remedies.BUILD),
        ("run good --build good/recording.toml --perception p --out o", "p: cannot", remedies.MODEL),
        ("assess none", "none: holds neither recording.toml nor run.json", remedies.DRIVE),
        ("assess good --criteria bad.toml", "bad.toml: is not TOML", remedies.CRITERIA),
        ("check bad", "bad/recording.toml: is not TOML", remedies.RECORDING),
        ("verify none.toml", "none.toml: cannot be read", remedies.SUITE),
        ("sweep none.toml --out o", "none.toml: cannot be read", remedies.SWEEP),
        ("map check none.xodr", "none.xodr: cannot be read", remedies.MAP),
        ("perception train none --out o", "none/recording.toml: cannot", remedies.RECORDING),
        ("perception show bad.toml", "bad.toml: is not JSON", remedies.MODEL),
        ("suite new good --out o --criteria none", "none: cannot be read", remedies.CRITERIA),
    ],
)
def test_what_is_none_of_its_kind_is_told_at_once(
    tmp_path: Path, words: str, problem: str, remedy: str
) -> None:
    for folder, text in (("good", 'name = "x"\n'), ("bad", "name = \n")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "recording.toml").write_text(text)
    (tmp_path / "bad.toml").write_text("[[\n")
    done = called(tmp_path, *words.split())
    assert (done.returncode, done.stdout) == (2, "False\n"), done.stderr
    assert done.stderr.startswith(f"resim: {problem}"), done.stderr
    assert done.stderr.endswith(f"{remedy}\n")


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        ("resim run none --bas", "--basis"),
        ("resim sweep re", "report repeat"),
        ("resim assess fi", "fit-prediction"),
        ("resim sweep none --dr", "--dry-run"),
        ("resim assess none --crit", "--criteria"),
        ("resim run none --vehicle ", "kinematic single-track"),
        ("resim verify none --vehicle s", "single-track"),
    ],
)
def test_the_shell_completes_after_what_is_not_there(tmp_path: Path, words: str, completed: str) -> None:
    asked = {"_RESIM_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    code = "import sys; sys.argv = ['resim']; from resim.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env={**os.environ, **asked}, capture_output=True, text=True,
        timeout=60.0, check=True,
    )  # fmt: skip
    assert done.stdout.split() == completed.split()
