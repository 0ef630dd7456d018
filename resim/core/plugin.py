"""Code that a user names in a file, `module:name`, loaded from beside that file or from what is installed."""

from __future__ import annotations

import ast
import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from resim.core.errors import InputError


def load_named(path: Path, named: str, what: str) -> tuple[Callable[..., Any], ModuleType]:
    """Give the callable that the file at `path` names as "module:name" for its field `what`, and its module.

    A module file beside `path` goes before an installed module. Raises InputError for a module or name that is not
    there.
    """
    module_name, _, name = named.partition(":")
    module = _import(path, module_name, what)
    found = getattr(module, name, None)
    if not callable(found):
        raise InputError(path, f"{what} {named!r}: module {module_name} has no {name}")
    return found, module


def sources(module: ModuleType) -> bytes:
    """Give the module's source, and those of the modules it imports from its own folder, and they from it."""
    folder = Path(_file(module)).parent
    known: dict[str, bytes] = {}
    todo = [module]
    while todo:
        one = todo.pop()
        if one.__name__ in known or not _file(one):
            continue
        known[one.__name__] = source = Path(_file(one)).read_bytes()
        nodes = list(ast.walk(ast.parse(source))) if _file(one).endswith(".py") else []
        froms = [
            (node.module, node.names) for node in nodes if isinstance(node, ast.ImportFrom) and node.module
        ]
        names = {module for module, _ in froms} | {
            f"{module}.{a.name}" for module, each in froms for a in each
        }
        names |= {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        imported = [sys.modules[name] for name in sorted(names) if name in sys.modules]
        todo += [m for m in imported if _file(m) and _own(Path(_file(m)), folder)]
    return b"\0".join(sorted(known.values()))


def _own(file: Path, folder: Path) -> bool:
    """Whether a file lies in the folder, or in a package below it that is no installed one."""
    return file.parent == folder or (
        file.is_relative_to(folder) and not {"site-packages", "resim"} & set(file.relative_to(folder).parts)
    )


def _file(module: ModuleType) -> str:
    """The module's file, source or compiled; "" for one that is built in."""
    return str(getattr(module, "__file__", None) or "")


def _import(path: Path, module_name: str, what: str) -> ModuleType:
    beside = path.parent / f"{module_name}.py"
    try:
        if not beside.is_file():
            return importlib.import_module(module_name)
        return _load(beside)
    except (Exception, SystemExit) as e:
        remedy = f"Install it, or put the module's file beside {path.name}."
        raise InputError(path, f"{what} module {module_name!r} cannot be imported: {e!r}", remedy) from e


def _load(file: Path) -> ModuleType:
    """Load a module from its file under a name of its own, so that it takes no other's place.

    What it imports may lie beside it.
    """
    name = f"{file.stem}_{hashlib.sha256(str(file.resolve()).encode()).hexdigest()[:12]}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look themselves up there
    sys.path.insert(0, str(file.parent.resolve()))
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    finally:
        sys.path.remove(str(file.parent.resolve()))
    return module
