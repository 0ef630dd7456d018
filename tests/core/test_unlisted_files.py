"""Whatever way a function opens a file beside its build, it is told that the hash does not know the file."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from resim.simulation.function.interface import load_build

NAMES = ("resim", "site-packages", "__pycache__")
WAYS = {
    "open": "open(HERE / 'data').close()",
    "os.open": "os.close(os.open(HERE / 'data', os.O_RDONLY))",
    "in a folder that is held open": """
folder = os.open(HERE, os.O_RDONLY)
os.close(os.open("data", os.O_RDONLY, dir_fd=folder))
os.close(folder)""",
    "a library": """
try: ctypes.CDLL(str(HERE / "data"))
except OSError: pass""",
    "a database": "sqlite3.connect(HERE / 'data').close()",
    "a database by its address": "sqlite3.connect(f'file:{HERE}/data?mode=ro', uri=True).close()",
    "another program": "subprocess.run(['cat', HERE / 'data'], stdout=subprocess.DEVNULL)",
    "another program in words": "subprocess.run(f'cat <\"{HERE}/data\"', shell=True, stdout=subprocess.DEVNULL)",
    "a shell": "os.system(f'cat {HERE}/data >/dev/null')",
    "through a link from elsewhere": "open(HERE.parent / 'link').close()",
    "a link to elsewhere": "open(HERE / 'away').close()",
    "in a linked folder": "open(HERE / 'linked' / 'far').close()",
    **{f"in a folder called {name}": f"open(HERE / '{name}' / 'data').close()" for name in NAMES},
}
SAID = {"a link to elsewhere": "away", "in a linked folder": "linked/far"}
SAID |= {f"in a folder called {name}": f"{name}/data" for name in NAMES}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Give a folder with a database, with links out of it and one into it."""
    here = tmp_path / "here"
    (tmp_path / "there").mkdir()
    here.mkdir()
    (tmp_path / "there" / "far").write_text("1")
    sqlite3.connect(here / "data").close()
    (here / "away").symlink_to(tmp_path / "there" / "far")
    (here / "linked").symlink_to(tmp_path / "there")
    (tmp_path / "link").symlink_to(here / "data")
    for name in NAMES:
        (here / name).mkdir()
        (here / name / "data").write_text("1")
    return here


@pytest.mark.parametrize("way", WAYS)
def test_a_file_opened_beside_the_build_is_named(folder: Path, way: str) -> None:
    methods = "\n".join(f"    def {name}(self, _=None): pass" for name in ("reset", "step", "close"))
    top = f"import ctypes, os, sqlite3, subprocess\nfrom pathlib import Path\nHERE = Path({str(folder)!r})"
    (folder / "own.py").write_text(f"{top}\n{WAYS[way]}\nclass Own:\n{methods}\n")
    (folder / "own.toml").write_text('name = "own"\nversion = "1"\nfactory = "own:Own"\n')
    build = load_build(folder / "own.toml")
    assert f"opened {SAID.get(way, 'data')} beside own.toml" in build.opened.note()


ELSEWHERE = {
    "open": "open(FAR).close()",
    "code": "with open(FAR) as f: exec(f.read())",
    "a module by its file": """
spec = importlib.util.spec_from_file_location("f", FAR)
spec.loader.exec_module(importlib.util.module_from_spec(spec))""",
    "another program": "subprocess.run(['cat', FAR], stdout=subprocess.DEVNULL)",
    "in a folder that is held open": """
folder = os.open(FAR.rpartition("/")[0], os.O_RDONLY)
os.close(os.open("far.py", os.O_RDONLY, dir_fd=folder))
os.close(folder)""",
}


def write_own(folder: Path, top: str, more: str = "") -> Path:
    methods = "\n".join(f"    def {name}(self, _=None): pass" for name in ("reset", "step", "close"))
    (folder / "own.py").write_text(f"{top}\nclass Own:\n{methods}\n")
    (folder / "own.toml").write_text(f'name = "own"\nversion = "1"\nfactory = "own:Own"\n{more}')
    return folder / "own.toml"


def note_of(folder: Path, top: str, more: str = "") -> str:
    return load_build(write_own(folder, top, more)).opened.note()


@pytest.mark.parametrize("way", ELSEWHERE)
def test_a_file_read_elsewhere_is_named(folder: Path, way: str) -> None:
    far = folder.parent / "there" / "far.py"
    far.write_text("K = 1\n")
    top = f"import importlib.util, os, subprocess, sys\nFAR = {str(far)!r}\n{ELSEWHERE[way]}"
    assert note_of(folder, top).startswith(f"the code opened {far}, which its hash does not know")


@pytest.mark.parametrize("depth", ["model = {file!r}", "model = {{ of = [1, {file!r}] }}"])
def test_a_file_that_parameters_name_is_named_whoever_opens_it(folder: Path, depth: str) -> None:
    """A library in C tells nobody."""
    far = folder.parent / "there" / "far"
    opened = load_build(write_own(folder, "")).opened.of_a_run()
    opened.given(tomllib.loads(depth.format(file=str(far))))
    assert opened.note().startswith(f"the code opened {far}, which its hash does not know")
    opened = opened.of_a_run()
    opened.given({"of": [str(folder / "data"), str(far) + "s", "", "/usr/bin/env", 3]})
    assert opened.note().startswith("the code opened data beside own.toml, which its hash does not know")


PROGRAM = """
import os, socket, subprocess, sys
HERE, FAR = {here!r}, {far!r}
def run(*words, **how): subprocess.run(words, stdout=subprocess.DEVNULL, check=True, **how)
"""
ASKS = {
    "a program in its folder": ("run('./pilot', cwd=FAR)", "{far}/pilot"),
    "a program that is found by name": ("run('pilot', env={{'PATH': FAR + ':/usr/bin:/bin'}})", "started pilot"),
    "a module": ("run(sys.executable, '-m', 'far', env={{'PYTHONPATH': FAR}})", "-m far"),
    "a shell that goes there": ("os.system('cd ' + FAR + ' && ./pilot >/dev/null')", "started cd {far}"),
    "the environment": ("os.environ.get('PILOT_BRAKE')", "read PILOT_BRAKE from the environment"),
    "the environment as bytes": ("os.environb.get(b'PILOT_BRAKE')", "read PILOT_BRAKE from the environment"),
    "the environment in a path": ("os.path.expandvars('$PILOT_BRAKE')", "read PILOT_BRAKE from the environment"),
    "the environment in a chain": (
        "import collections; collections.ChainMap(os.environ, {{}}).get('PILOT_BRAKE')", "read PILOT_BRAKE from",
    ),
    "the environment in a template": (
        "import string; string.Template('$PILOT_BRAKE').safe_substitute(os.environ)", "read PILOT_BRAKE from",
    ),
    "names of the environment": ("'PILOT_BRAKE' in list(os.environ)", "read all variables from the environment"),
    "an address of its own": (
        "s = socket.socket(socket.AF_INET, 2); s.bind(('127.0.0.1', 0)); s.close()", "listened to ('127.0.0.1', 0)",
    ),
    "a datagram": (
        "s = socket.socket(socket.AF_UNIX, 2)\ntry: s.sendto(b'', FAR + '/sock')\nexcept OSError: pass\ns.close()",
        "connected to '{far}/sock'",
    ),
    "a copy of itself": ("os.waitpid(os.fork() or os._exit(0), 0)", "forked its process"),
    "who listens": (
        "s = socket.socket(socket.AF_UNIX)\ntry: s.connect(FAR + '/sock')\nexcept OSError: pass\ns.close()",
        "connected to '{far}/sock'",
    ),
    "a file that it did not change": (
        "os.close(os.open(FAR + '/far', os.O_WRONLY)); open(FAR + '/far').close()", "opened {far}/far,",
    ),
}  # fmt: skip


@pytest.mark.parametrize("way", ASKS)
def test_what_else_it_asks_is_named(folder: Path, way: str) -> None:
    there = folder.parent / "there"
    (there / "far.py").write_text("K = 1\n")
    (there / "pilot").write_text("#!/bin/sh\necho 0\n")
    (there / "pilot").chmod(0o755)
    code, told = (text.format(far=str(there)) for text in ASKS[way])
    note = note_of(folder, PROGRAM.format(here=str(folder), far=str(there)) + code)
    assert told in note
    assert "its hash does not know" in note


@pytest.mark.parametrize("code", ["open(HERE.parent / 'there' / 'far').close()", "import further"])
def test_a_folder_on_the_search_path_is_none_of_the_systems(folder: Path, code: str) -> None:
    there = folder.parent / "there"
    (there / "further.py").write_text("K = 1\n")
    write_own(folder, f"from pathlib import Path\nHERE = Path({str(folder)!r})\n{code}")
    said = (
        "from resim.simulation.function.interface import load_build; from pathlib import Path; import sys; "
    )
    told = subprocess.run(
        [sys.executable, "-c", said + "print(load_build(Path(sys.argv[1])).opened.note())", folder / "own.toml"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([*filter(None, sys.path), str(there)])},
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert "there/fur" in told or "there/far" in told


def test_a_program_that_is_listed_is_its_own(folder: Path) -> None:
    (folder / "pilot").write_text("#!/bin/sh\necho 0\n")
    (folder / "pilot").chmod(0o755)
    top = "import subprocess\nfrom pathlib import Path\nHERE = Path(__file__).parent\n"
    run = "subprocess.run(['sh', './pilot'], cwd=HERE, check=True)"
    assert note_of(folder, top + run, 'files = ["pilot"]\n') == ""
    assert "started sh -c true" in note_of(folder, top + "subprocess.run(['sh', '-c', 'true'], check=True)")


def test_files_of_both_places_are_told_apart(folder: Path) -> None:
    far = folder.parent / "there" / "far"
    top = f"open({str(folder / 'data')!r}).close()\nopen({str(far)!r}).close()"
    assert note_of(folder, top).startswith(f"the code opened data beside own.toml and {far}, which its hash")


@pytest.mark.parametrize(
    "top",
    [
        "import tempfile\nwith tempfile.NamedTemporaryFile() as f: open(f.name).close()",
        "open('/etc/passwd').close(); open('/proc/self/stat').close(); open('/dev/null').close()",
        "import colorsys, numpy.polynomial, scipy.ndimage",
    ],
)
def test_what_it_wrote_itself_and_what_is_the_systems_is_not_told(folder: Path, top: str) -> None:
    assert note_of(folder, top) == ""
