"""The public interface: what it exports, how it is described, and that importing it costs nothing."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import pkgutil
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import resim
import resim.jobs

SOURCE = Path(resim.__file__)
SECTION = re.compile(r"\n    (Args|Attributes|Returns|Raises):\n((?:        .*\n|\n)*)")


def test_what_type_checkers_see_is_what_is_exported() -> None:
    (block,) = [n for n in ast.parse(SOURCE.read_text()).body if isinstance(n, ast.If)]
    seen = {
        alias.name: str(node.module).removeprefix("resim.")
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == resim._WHERE
    assert set(resim.__all__) == set(seen)


@pytest.mark.parametrize("name", resim.__all__)
def test_every_export_is_there(name: str) -> None:
    assert getattr(resim, name).__name__ == name


def test_a_name_that_is_not_exported_is_none() -> None:
    with pytest.raises(AttributeError, match="module 'resim' has no attribute 'simulate'"):
        resim.simulate  # noqa: B018


def test_importing_resim_loads_nothing_else() -> None:
    told = "import sys; before = set(sys.modules); import resim; print(*sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "resim" in loaded
    assert not {name for name in loaded if name.startswith("resim.") or name in ("numpy", "pandas")}


def public() -> Iterator[tuple[str, object]]:
    """Everything that is to be described: exports, and what the modules of jobs define, with methods."""
    for name in resim.__all__:
        value = getattr(resim, name)
        yield f"resim.{name}", value
        if inspect.isclass(value):
            yield from ((f"resim.{name}.{key}", method) for key, method in methods(value))
    for info in pkgutil.iter_modules(resim.jobs.__path__, "resim.jobs."):
        module = importlib.import_module(info.name)
        for name, value in vars(module).items():
            if not name.startswith("_") and getattr(value, "__module__", None) == info.name:
                yield f"{info.name}.{name}", value
                if inspect.isclass(value):
                    yield from ((f"{info.name}.{name}.{key}", method) for key, method in methods(value))


def methods(kind: type) -> Iterator[tuple[str, object]]:
    """The methods that a class of resim's defines itself, class methods too."""
    for key, value in vars(kind).items():
        method = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        written = (
            inspect.isfunction(method) and method.__name__ == key and method.__module__.startswith("resim")
        )
        if written and not key.startswith("_"):
            yield key, method


PUBLIC = dict(public())


@pytest.mark.parametrize("name", [n for n, value in PUBLIC.items() if inspect.isfunction(value)])
def test_every_argument_and_result_is_described(name: str) -> None:
    function = PUBLIC[name]
    assert inspect.isfunction(function)
    sections = described(function)
    signature = inspect.signature(function)
    assert set(sections.get("Args", {})) == set(signature.parameters) - {"self", "cls"}
    is_job = inspect.getmodule(function) is not None and "." not in function.__qualname__
    gives = signature.return_annotation not in ("None", None)
    if is_job:  # a method without arguments says what it gives in its first line
        assert ("Returns" in sections) == gives


@pytest.mark.parametrize("name", [n for n, value in PUBLIC.items() if dataclasses.is_dataclass(value)])
def test_every_field_is_described(name: str) -> None:
    kind = PUBLIC[name]
    fields = {f.name for f in dataclasses.fields(kind) if not f.name.startswith("_")}  # type: ignore[arg-type]
    assert set(described(kind).get("Attributes", {})) == fields


def described(value: object) -> dict[str, dict[str, str]]:
    """The sections of a docstring in Google style, with what they say by name."""
    text = f"\n    {(inspect.getdoc(value) or '').replace(chr(10), chr(10) + '    ')}\n"
    return {
        section: dict(re.findall(r"^        (\w+): (.+)$", body, re.MULTILINE)) or {"": body}
        for section, body in SECTION.findall(text)
    }


@pytest.mark.slow
def test_exports_that_are_first_used_after_a_run_are_no_change_of_resim() -> None:
    root = SOURCE.parents[1]
    told = (
        "import resim\n"
        f"result = resim.resimulate({str(root / 'scenarios' / 'overtake')!r}, "
        f"{str(root / 'adfunc' / 'builds' / 'replay-1.0.toml')!r})\n"
        "resim.check_map, resim.verify, resim.sweep, resim.train\n"
        f"resim.assess(result, criteria={str(root / 'scenarios' / 'criteria' / 'traffic.toml')!r})\n"
        f"resim.load_build({str(root / 'adfunc' / 'builds' / 'idm-1.0.toml')!r}).make()\n"
    )
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
