"""Code of a user's file: each file's modules are its own, and what runs is what was hashed."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import pytest

from resim.core.errors import InputError
from resim.simulation.function.interface import Build, freeze_build, load_build

METHODS = "".join(f"    def {name}(self, _=None): pass\n" for name in ("reset", "step", "close"))
Write = Callable[..., Path]


@pytest.fixture
def written(tmp_path: Path) -> Write:
    """Write a build into a folder of its own, whose function says `value` by `make().value()`, and files beside it."""

    def write(folder: str, value: str, files: dict[str, str], *, top: str = "", head: str = "") -> Path:
        path = tmp_path / folder / "build.toml"
        path.parent.mkdir(exist_ok=True)
        source = f"{head}\nclass Own:\n{METHODS}    def value(self):\n        {value}\n"
        for name, text in {"own.py": source, **files}.items():
            (path.parent / name).parent.mkdir(parents=True, exist_ok=True)
            (path.parent / name).write_text(text)
        path.write_text(f'name = "own"\nversion = "1"\nfactory = "own:Own"\n{top}\n')
        return path

    return write


def said(build: Build) -> Any:
    function: Any = build.make()
    return function.value()


WAYS = {
    "at the top": ("return helper.GAIN", "import helper"),
    "in a function": ("import helper; return helper.GAIN", ""),
    "from": ("from helper import GAIN; return GAIN", ""),
    "relative": ("from . import helper; return helper.GAIN", ""),
    "relative from": ("from .helper import GAIN; return GAIN", ""),
    "by name": ("return import_module('helper').GAIN", "from importlib import import_module"),
    "by importlib": ("return importlib.import_module('helper').GAIN", "import importlib.util"),
    "by __import__": ("return __import__('helper').GAIN", ""),
    "by exec": (
        "space = {}; exec('import helper', space); return space['helper'].GAIN",
        "# import_module\nX = 'helper'",
    ),
}


@pytest.mark.parametrize("way", WAYS)
def test_two_builds_have_a_helper_of_the_same_name_each(written: Write, way: str) -> None:
    value, head = WAYS[way]
    one, two = (
        load_build(written(name, value, {"helper.py": f"GAIN = {gain}\n"}, head=head))
        for name, gain in (("one", 1), ("two", 2))
    )
    assert one.hash != two.hash
    assert (said(two), said(one), said(two)) == (2, 1, 2)
    assert "helper" not in sys.modules


PUTS = """
import sys, types, importlib.util
from pathlib import Path
import numpy, colorsys
def put(name, gain):
    sys.modules[name] = module = types.ModuleType(name)
    module.GAIN = gain
if "settings" not in sys.modules:
    put("settings", {gain})
put("json", {gain})
sys.modules.pop("colorsys")
spec = importlib.util.spec_from_file_location("part", Path(__file__).parent / "part.py")
if "part" not in sys.modules:
    sys.modules["part"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules["part"])
import settings, part
"""


def test_what_a_build_puts_into_the_modules_is_there_for_itself_alone(written: Write) -> None:
    value = "import settings as late, json, part as p; return settings.GAIN, late.GAIN, json.GAIN, part.GAIN, p.GAIN"
    before = dict(sys.modules)
    one, two = (
        load_build(
            written(
                n, value, {"part.py": f"GAIN = {g}\n"}, head=PUTS.format(gain=g), top='files = ["part.py"]'
            )
        )
        for n, g in (("one", 1), ("two", 2))
    )
    for build, gain in ((two, 2), (one, 1), (two, 2)):
        with build.opened:
            assert said(build) == (gain,) * 5
    assert {"settings", "part"}.isdisjoint(sys.modules)
    assert all(sys.modules[name] is module for name, module in before.items())


def test_an_installed_module_that_a_build_imports_first_is_everybodys(written: Write) -> None:
    sys.modules.pop("colorsys", None)
    load_build(written("one", "return 1", {}, head="import colorsys"))
    assert "colorsys" in sys.modules


def test_packages_beside_the_build_are_its_own_and_count(written: Write) -> None:
    files = {
        "kit/__init__.py": "from .deep import LIMIT\n__all__ = ['late']\n", "kit/deep/__init__.py": "LIMIT = 7\n",
        "kit/late.py": "import helper\nGAIN = helper.GAIN\n", "helper.py": "GAIN = 1\n", "loose/part.py": "P = 5\n",
    }  # fmt: skip
    value = "from kit import *; import kit.deep, loose.part; return late.GAIN, kit.deep.LIMIT, loose.part.P"
    value = value.replace("from kit import *; ", "import kit.late as late; ")
    built = {}
    for name, changed in [
        ("one", {}),
        *((str(n), {file: files[file] + "#\n"}) for n, file in enumerate(files)),
    ]:
        build = load_build(written(name, value, {**files, **changed}))
        assert said(build) == (1, 7, 5)
        built[build.hash] = name
    assert len(built) == 1 + len(files)


def test_the_hash_does_not_depend_on_the_place_nor_on_what_is_loaded(written: Write) -> None:
    one, two = (written(name, "import helper; return 1", {"helper.py": "A = 1\n"}) for name in ("one", "two"))
    first = load_build(one).hash
    load_build(written("three", "import helper; return 1", {"helper.py": "A = 2\n"}))
    assert load_build(two).hash == first == freeze_build(one).hash


def test_the_hash_knows_which_module_says_what(written: Write) -> None:
    a, b = "VALUE = 1\n", "VALUE = 2\n"
    value = "import fast, slow; return fast.VALUE - slow.VALUE"
    one, two = (
        load_build(written(n, value, {"fast.py": f, "slow.py": s})) for n, f, s in (("1", a, b), ("2", b, a))
    )
    assert said(one) == -said(two) == -1
    assert one.hash != two.hash


def test_a_module_beside_goes_before_an_installed_one_and_others_keep_theirs(written: Write) -> None:
    head = "import random, statistics"
    build = load_build(
        written("one", "return random.MINE, statistics.__name__", {"random.py": "MINE = 3\n"}, head=head)
    )
    assert said(build) == (3, "statistics")
    assert hasattr(sys.modules["random"], "random")


def test_a_folder_of_data_with_the_name_of_an_installed_package_is_no_module(written: Write) -> None:
    build = load_build(written("one", "import numpy; return numpy.pi", {"numpy/weights.py": "W = 1\n"}))
    assert said(build) == pytest.approx(3.14159, abs=1e-5)


def test_dataclasses_pickles_and_later_edits(written: Write) -> None:
    head = "from __future__ import annotations\nfrom dataclasses import dataclass\n"
    head += "@dataclass\nclass Gain:\n    g: float = 2.0"
    path = written("one", "import helper; return Gain(), helper.GAIN", {"helper.py": "GAIN = 1\n"}, head=head)
    build = load_build(path)
    (path.parent / "helper.py").write_text("GAIN = 9\n")
    gain, read = said(build)
    assert is_dataclass(gain)
    assert pickle.loads(pickle.dumps(gain)) == gain
    assert read == 1  # imported after the edit: what was hashed runs


def test_stale_bytecode_is_not_run(written: Write) -> None:
    path = written("one", "import helper; return helper.GAIN", {"helper.py": "GAIN = 1\n"})
    helper = path.parent / "helper.py"
    import py_compile

    py_compile.compile(str(helper))
    at = helper.stat()
    helper.write_text("GAIN = 2\n")  # of the same size, at the same time
    os.utime(helper, ns=(at.st_atime_ns, at.st_mtime_ns))
    assert said(load_build(path)) == 2


MACHINE = "from numba import njit\n@njit(cache=True)\ndef gain():\n    return {}\n"


def test_caches_of_machine_code_are_by_the_hash(written: Write) -> None:
    path = written("one", "import helper; return helper.gain()", {"helper.py": MACHINE.format(1)})
    helper = path.parent / "helper.py"
    at = helper.stat()
    assert said(load_build(path)) == 1
    helper.write_text(MACHINE.format(2))
    os.utime(helper, ns=(at.st_atime_ns, at.st_mtime_ns))
    assert said(load_build(path)) == 2
    assert not (path.parent / "__pycache__").exists()


READS = "return (Path(__file__).parent / '{}').read_text()"
PATH = "from pathlib import Path"


def test_files_that_are_listed_belong_to_the_build(written: Write) -> None:
    def build(folder: str, name: str, text: str) -> Build:
        return load_build(
            written(folder, READS.format(name), {name: text}, top=f'files = ["{name}"]', head=PATH)
        )

    for name in ("weights.json", "net/deep/w.bin", "../shared.json"):
        one, two = build("one", name, "1"), build("two", name, "2")
        assert one.hash != two.hash
        assert (said(one), said(two)) == ("1", "2")
        (one.path.parent / name).write_text("3")
        assert said(one) == "1"
        assert not one.opened.note()


def test_a_copy_that_was_changed_is_made_again_from_the_file_or_refused(written: Write) -> None:
    top = 'files = ["w.txt"]'
    path = written("one", READS.format("w.txt"), {"w.txt": "1"}, top=top, head=PATH)
    frozen = freeze_build(path)
    build = load_build(frozen)
    (copy,) = (Path(os.environ["XDG_CACHE_HOME"]) / "resim" / "inputs" / frozen.hash).rglob("w.txt")
    copy.chmod(0o644)
    copy.write_text("2")
    assert said(load_build(frozen)) == "1"
    copy.chmod(0o644)
    copy.write_text("2")
    (path.parent / "w.txt").write_text("2")
    with pytest.raises(InputError, match="has changed since it was first read"):
        load_build(frozen)
    assert build.hash != load_build(path).hash


@pytest.mark.parametrize("name", ["nothing.json", "net", "/etc/hostname", "./w.txt", "a/../w.txt"])
def test_a_file_that_cannot_be_listed_is_refused(written: Write, name: str) -> None:
    path = written("one", "return 1", {"w.txt": "1", "net/x": "1"}, top=f'files = ["{name}"]')
    with pytest.raises(InputError, match=f"files: '{name}' is no"):
        load_build(path)


def test_a_file_that_is_opened_and_not_listed_is_told(
    written: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    beside = written("one", READS.format("w.txt"), {"w.txt": "1"}, head=PATH)
    when_loaded = written(
        "two", "return 1", {"w.txt": "1"}, head="from pathlib import Path\n" + READS.format("w.txt")[7:]
    )
    with pytest.raises(InputError, match=r'FileNotFoundError.*List in build.toml: files = \["w.txt"\]'):
        load_build(when_loaded)
    build = load_build(beside)
    with build.opened, pytest.raises(FileNotFoundError):
        said(build)
    assert build.opened.note().startswith(
        "the code opened w.txt beside build.toml, which its hash does not know"
    )
    listed = load_build(
        written(
            "three", "return Path('w.txt').read_text()", {"w.txt": "1"}, top='files = ["w.txt"]', head=PATH
        )
    )
    monkeypatch.chdir(listed.path.parent)
    with listed.opened:
        said(listed)  # the original, past the copy
    assert "w.txt" in listed.opened.note()


def test_a_folder_that_a_module_adds_to_the_path_leads_to_no_module(written: Write) -> None:
    """A module found there would be the one of every build that has one of its name."""
    for gain in (1, 2):
        add = f"import sys\nsys.path.insert(0, {str(written('x', '', {}).parents[1] / f'lib{gain}')!r})"
        helper = {f"../lib{gain}/helper_lib.py": f"GAIN = {gain}"}
        top = written(f"top{gain}", "return helper_lib.GAIN", helper, head=f"{add}\nimport helper_lib")
        before = sys.path[:]
        with pytest.raises(InputError, match=r"helper_lib.*put the module's file beside build\.toml"):
            load_build(freeze_build(top))
        inside = written(f"in{gain}", "import helper_lib; return helper_lib.GAIN", {}, head=add)
        with pytest.raises(ModuleNotFoundError):
            said(load_build(freeze_build(inside)))
        assert sys.path == before
        assert "helper_lib" not in sys.modules


def test_what_was_pickled_with_a_module_of_the_build_can_be_loaded(tmp_path: Path) -> None:
    (tmp_path / "own_net.py").write_text("class Net:\n    gain = 2.0\n")
    made = "import pickle, own_net; open('net.pkl', 'wb').write(pickle.dumps(own_net.Net()))"
    subprocess.run([sys.executable, "-c", made], cwd=tmp_path, check=True)
    (tmp_path / "user.py").write_text(
        "import pickle\nfrom pathlib import Path\nimport own_net\n"
        "def make():\n    return pickle.loads((Path(__file__).parent / 'net.pkl').read_bytes())\n"
    )
    (tmp_path / "b.toml").write_text(
        'name = "b"\nversion = "1"\nfactory = "user:make"\nfiles = ["net.pkl"]\n'
    )
    build = load_build(tmp_path / "b.toml")
    with build.factory.afresh():
        assert build.make().gain == 2.0  # type: ignore[attr-defined]
    assert "own_net" not in sys.modules
