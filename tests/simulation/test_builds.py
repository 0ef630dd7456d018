from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from resim.core.errors import InputError
from resim.simulation.function.interface import load_build

ROOT = Path(__file__).parents[2]
OWN = """class Own:
    def __init__(self, *, gain=1.0):
        self.gain = gain
    def reset(self, setup): pass
    def step(self, perceived): pass
    def close(self): pass
"""
Write = Callable[..., Path]


@pytest.mark.parametrize("path", sorted((ROOT / "adfunc" / "builds").glob("*.toml")), ids=lambda p: p.stem)
def test_builds_that_ship_load(path: Path) -> None:
    python = tomllib.loads(path.read_text(encoding="utf-8")).get("process", {}).get("python")
    if python is not None and not (path.parent / python).exists():
        pytest.skip(f"there is no {python}")
    build = load_build(path)
    assert build.label == path.stem
    assert build.needs_truth == (build.name in ("replay", "follow_trace"))


def test_a_build_names_factory_parameters_and_times(write_build: Write) -> None:
    build = load_build(write_build(OWN, top="cycle_time = 0.1\ntime_limit = 2", parameters="gain = 3.5"))
    assert (build.name, build.version, build.cycle_time, build.time_limit) == ("test", "0.1", 0.1, 2.0)
    assert build.make().gain == 3.5  # type: ignore[attr-defined]
    assert not build.needs_truth


def test_the_hash_pins_file_and_source(write_build: Write) -> None:
    one = load_build(write_build(OWN)).hash
    assert load_build(write_build(OWN)).hash == one
    assert load_build(write_build(OWN, parameters="gain = 2.0")).hash != one
    assert load_build(write_build(OWN + "# changed\n")).hash != one


@pytest.mark.parametrize("parameters", ["gian = 1.0", "gain = 1.0\nother = 2"])
def test_parameters_that_the_factory_does_not_take_are_refused(write_build: Write, parameters: str) -> None:
    with pytest.raises(
        InputError, match=r"build\.toml: \[parameters\] do not fit Own: there is no parameter"
    ):
        load_build(write_build(OWN, parameters=parameters))


@pytest.mark.parametrize(
    ("source", "options", "text"),
    [
        (OWN, {"name": "Other"}, "factory 'own:Other': module own has no Other"),
        ("Own = 3\n", {}, "module own has no Own"),
        (
            None,
            {"module": "no_such_module"},
            "factory module 'no_such_module' cannot be imported: ModuleNotFoundError",
        ),
        ("import nowhere\n", {}, r"cannot be imported: ModuleNotFoundError\(\"No module named 'nowhere'\"\)"),
        ("def broken(:\n", {}, "cannot be imported: SyntaxError"),
        (OWN, {"top": "cycle_time = 0"}, "cycle_time: expected more than 0"),
        (OWN, {"top": "time_limit = inf"}, "time_limit: expected 3600 or less"),
        (OWN, {"top": "time_limit = 1e-6"}, "time_limit: expected 0.001 or more"),
        (OWN, {"top": "cycle = 1"}, "cycle: there is no such field"),
        (OWN, {"top": "cycle_time = [1"}, "is not TOML"),
        (OWN, {"module": "own.py", "name": "a:b"}, "factory: expected a module and a name in it"),
    ],
    ids=lambda v: str(v)[:40] if isinstance(v, str) else "",
)
def test_a_build_that_cannot_be_used_is_refused(
    write_build: Write, source: str | None, options: dict[str, str], text: str
) -> None:
    path = write_build(source, **options)
    with pytest.raises(InputError, match=text) as caught:
        load_build(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("content", [b"", b"name = 3", b"\xff\xfe", b"name = 'a'\nversion = '1'"])
def test_what_is_no_build_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "b.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"factory|is not TOML"):
        load_build(path)
    with pytest.raises(InputError, match="cannot be read \\(No such file"):
        load_build(tmp_path / "none.toml")
    with pytest.raises(InputError, match="cannot be read \\(Is a directory"):
        load_build(tmp_path)


def test_a_module_beside_its_build_may_hold_a_dataclass(write_build: Write) -> None:
    source = "from __future__ import annotations\nfrom dataclasses import dataclass\n"
    source += "@dataclass\nclass Gain:\n    gain: float = 1.0\n" + OWN
    assert load_build(write_build(source)).make() is not None
