"""What the README says works as it stands."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str, first_line: str) -> str:
    found = [
        text
        for text in re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)
        if text.startswith(first_line)
    ]
    assert len(found) == 1
    return found[0]


def test_the_example_function_plugs_in(tmp_path):
    (tmp_path / "my_pilot.py").write_text(block("python", "# my_pilot.py"))
    (tmp_path / "my_pilot.toml").write_text(block("toml", "# my_pilot.toml"))
    command = [sys.executable, "-m", "resim", "run", str(ROOT / "scenarios" / "rear_end")]
    done = subprocess.run(
        [*command, "--build", str(tmp_path / "my_pilot.toml"), "--out", str(tmp_path / "out")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["build"] == {"name": "my_pilot", "version": "0.1", "drove": False}
    assert report["decision"]["rGT"] == ["brake"]


def test_the_example_objectification_is_judged(tmp_path):
    (tmp_path / "my_measures.py").write_text(block("python", "# my_measures.py"))
    (tmp_path / "mine.toml").write_text(block("toml", "# mine.toml"))
    command = [sys.executable, "-m", "resim", "assess", str(ROOT / "scenarios" / "overtake")]
    done = subprocess.run(
        [*command, "--criteria", str(tmp_path / "mine.toml"), "--out", str(tmp_path / "out")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "out" / "assessment.json").read_text())
    clear = found["criteria"]["keeps clear"]
    assert (clear["verdict"], clear["unit"], clear["limit"]) == ("PASS", "m", 3.0)
    assert clear["value"] == min(min(v) for v in found["measures"]["distance between centres"].values())


def test_its_links_and_files_are_there():
    for link in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / link).exists(), link
    for path in re.findall(r"(?:scenarios|adfunc|networks|tools)/[\w./-]*\w", README):
        assert (ROOT / path).exists(), path


def test_nothing_is_installed_from_the_index_under_our_name() -> None:
    """There, resim is somebody else's package."""
    texts = [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "resim").rglob("*.py")]
    for path in texts:
        assert not re.search(r"pip install\s+(-\S+\s+)*['\"]?resim\b", path.read_text(encoding="utf-8")), path
