"""The wheel holds all that the command needs, and nothing of another name; `resim demo` works from it alone."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from conftest import ROOT

NAME = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["name"]


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    words = ["wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, ROOT]
    subprocess.run([sys.executable, "-m", "pip", *map(str, words)], check=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        file.extractall(folder / "unpacked")
    _compiled(folder / "unpacked")
    return folder / "unpacked"


def _compiled(unpacked: Path) -> None:
    """Take over what numba compiled of the checkout: to compile the same again takes a minute."""
    for made in (ROOT / "resim").rglob("*.nb[ci]"):
        there = unpacked / made.relative_to(ROOT)
        there.parent.mkdir(exist_ok=True)
        shutil.copy2(made, there)
        for source in made.parent.parent.glob("*.py"):  # it is known by its source's time
            os.utime(
                there.parent.parent / source.name, ns=(source.stat().st_atime_ns, source.stat().st_mtime_ns)
            )


def test_its_names_are_its_own(unpacked: Path) -> None:
    assert {path.name for path in unpacked.iterdir()} == {
        "resim",
        f"{NAME.replace('-', '_')}-0.1.0.dist-info",
    }
    assert (unpacked / "resim" / "py.typed").is_file()
    assert not list((unpacked / "resim" / "shipped").rglob("__pycache__"))


def test_what_pages_hold_is_in_it(unpacked: Path) -> None:
    report = Path("resim", "report")
    held = [
        *(ROOT / report).rglob("*.js"),
        *(ROOT / report).rglob("*.css"),
        *(ROOT / report / "plotly").iterdir(),
    ]
    assert len(held) > 10
    for path in held:
        assert (unpacked / path.relative_to(ROOT)).read_bytes() == path.read_bytes()
    about = next(unpacked.glob("*.dist-info"))
    assert (about / "licenses" / report / "plotly" / "LICENSE").is_file()
    needed = re.findall(r"^Requires-Dist: (.*)$", (about / "METADATA").read_text(), re.MULTILINE)
    assert [line for line in needed if line.startswith("plotly") and "extra ==" not in line] == []


def test_what_migrates_catalogs_is_in_it(unpacked: Path) -> None:
    versions = Path("resim", "results", "migrations", "versions")
    held = [path.name for path in (ROOT / versions).glob("*.py")]
    assert held
    assert {path.name for path in (unpacked / versions).glob("*.py")} == {*held}


@pytest.mark.slow
def test_the_demo_works_from_it_alone(unpacked: Path, tmp_path: Path) -> None:
    """Also where no `adfunc` is installed: that of the example is taken."""
    code = (
        f"import sys; sys.path[:] = [{str(unpacked)!r}] + [p for p in sys.path if p != {str(ROOT)!r}]\n"
        "import resim; print(resim.__file__); sys.argv = ['resim', 'demo']; from resim.cli import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=240.0, check=False,
        env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(unpacked))
    assert "resim-demo/result/report.html" in done.stdout
    assert (tmp_path / "resim-demo" / "result" / "report.html").stat().st_size > 10_000
    again = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60.0, check=False
    )
    assert (again.returncode, "resim-demo: exists and is not empty" in again.stderr) == (2, True)


def test_no_page_installs_what_somebody_else_calls_resim() -> None:
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.*")]
    texts = {page: page.read_text() for page in pages if page.suffix in (".md", ".yml", ".ipynb", ".toml")}
    found = [f"{page}: {line}" for page, text in texts.items() for line in text.splitlines()
             if re.search(r"pip install[^`]*\bresim\b(?!-drive)(?!/)", line) and "./resim" not in line]  # fmt: skip
    assert not found
