"""A copy of resim to which is added what a page of docs/extend says, as a reader of the page would."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pages
from pages import DOCS, ROOT

IN_ORDER = """
import json, sys
from resim import cli
for sys.argv in json.loads(sys.argv[1]):
    try:
        cli.main()
    except SystemExit as e:
        if e.code:
            raise
"""
"""A program that runs commands, given as words in JSON, until one is not well."""


@dataclass(frozen=True)
class Extended:
    """The folder with the copy; `new`: the files of resim that the page adds."""

    folder: Path
    new: tuple[str, ...]

    def run(self, *words: object) -> subprocess.CompletedProcess[str]:
        """Run Python with these words in the folder, by the copy."""
        environment = {**os.environ, "PYTHONPATH": str(self.folder), "COLUMNS": "200"}
        return subprocess.run(
            [sys.executable, *map(str, words)], cwd=self.folder, env=environment, capture_output=True, text=True,
            check=False,
        )  # fmt: skip

    def resim(self, *words: object) -> str:
        """Run `resim`, see that all is well, and give what it prints."""
        done = self.run("-m", "resim", *words)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def commands(self, name: str) -> str:
        """Run the page's commands in order, in one process; see that all is well, and give what they print."""
        done = self.run("-c", IN_ORDER, json.dumps(pages.commands(DOCS / "extend" / name)))
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def check(self) -> None:
        """See that the page's tests pass, and that its code is as the project's is to be."""
        tests = [name for name in self.new if name.startswith("tests/")]
        done = self.run("-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", os.devnull, *tests)
        assert (done.returncode, "passed" in done.stdout) == (0, True), done.stdout + done.stderr
        ours = [name for name in self.new if name.startswith("resim/")]
        for words in (["check"], ["format", "--check"]):
            done = self.run("-m", "ruff", *words, "--no-cache", "--config", ROOT / "pyproject.toml", *ours)
            assert done.returncode == 0, done.stdout + done.stderr


def extended(name: str, to: Path) -> Extended:
    """Copy resim to a folder, and add the files of a page of docs/extend, and its one line elsewhere."""
    shutil.copytree(ROOT / "resim", to / "resim")
    for folder in ("scenarios", "adfunc", "networks"):
        (to / folder).symlink_to(ROOT / folder)
    page, new, lines = DOCS / "extend" / name, [], 0
    for path, said in {**pages.named(page, "python"), **pages.named(page, "toml")}.items():
        body = said.split("\n", 1)[1]
        if (to / path).exists():
            _add_line(to / path, body)
            lines += len(body.splitlines())
        else:
            (to / path).parent.mkdir(parents=True, exist_ok=True)
            (to / path).write_text(body, encoding="utf-8")
            new.append(path)
    assert len([path for path in new if path.startswith("resim/")]) == 1
    assert lines <= 1
    return Extended(to, tuple(new))


def _add_line(path: Path, line: str) -> None:
    """Put a line after the last import of a module."""
    rows = path.read_text(encoding="utf-8").splitlines(keepends=True)
    last = max(n for n, row in enumerate(rows) if row.startswith(("from ", "import ")))
    path.write_text("".join([*rows[: last + 1], line, *rows[last + 1 :]]), encoding="utf-8")
