"""Which files a user's module runs: itself, and what it imports from its own folder, anywhere in its code."""

from __future__ import annotations

import ast
import importlib.machinery
import importlib.util
import posixpath
import sysconfig
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from resim.core.errors import InputError

SUFFIXES = tuple(importlib.machinery.all_suffixes())
"""What files of modules end with: source, bytecode without source, compiled code."""
_SHARED = ("resim",)
"""Packages that are the program itself, wherever they lie."""
_BY_NAME = ("import_module", "__import__", "__all__")
"""Where one of these stands, texts may name modules."""


@dataclass(frozen=True)
class UserModules:
    """A folder of modules of the user.

    top: the one package in it that is his, None for all. here: whether they run in this environment.
    """

    folder: Path
    top: str | None = None
    here: bool = True

    def files(self, module: str) -> list[str]:
        """Names, from the folder, of what an import of "a.b" runs, as far as it is there: a/__init__.py, a/b.py."""
        parts, found = module.split("."), list[str]()
        if not all(part.isidentifier() for part in parts) or parts[0] in _SHARED:
            return []
        if self.top not in (None, parts[0]):
            return []
        for k in range(1, len(parts) + 1):
            place = "/".join(parts[:k])
            file = next((name for name in options(place) if (self.folder / name).is_file()), None)
            if file is not None:
                found.append(file)
            elif not (self.folder / place).is_dir():
                break
        return found if is_own(parts[0], found, here=self.here) else []


def options(place: str) -> list[str]:
    """Names of the files that a module may have: of the package, else of the module a/b."""
    return [f"{place}{inner}{suffix}" for inner in ("/__init__", "") for suffix in SUFFIXES]


def is_own(top: str, names: Collection[str], *, here: bool = True) -> bool:
    """Say whether a module or package of this name is among the files; a mere folder yields to one installed here."""
    if any(name in names for name in options(top)):
        return True
    inside = any(name.startswith(f"{top}/") and name.endswith(SUFFIXES) for name in names)
    return inside and not (here and _is_installed(top))


def own_sources(
    path: Path, modules: Iterable[str], also: Iterable[str] = (), *, here: bool = True
) -> dict[str, bytes]:
    """Give the files of `modules`, and of all that they import from their folders, by name; the hash is of these.

    path: the file that names them. Beside it is looked first; a module that is not there is taken from where it is
    installed, or from a folder above the file, with what it imports of its own package. also: names of files that may
    import something, too. here: whether they run in this environment; what is installed in it is not theirs if not.
    What is imported under a name that is computed is not found.
    """
    found: dict[str, bytes] = {}
    homes = [UserModules(path.parent, here=here)]
    todo = list(modules)
    for module in todo:
        if not homes[0].files(module) and (home := home_of(module, path.parent, here=here)) is not None:
            homes.append(home)
    for name in also:
        todo += _imports(_bytes(path.parent / name), _package(name))
    known = set()
    while todo:
        module = todo.pop()
        if module in known:
            continue
        known.add(module)
        home, names = next(((h, files) for h in homes if (files := h.files(module))), (homes[0], []))
        for name in names:
            if name not in found:
                found[name] = _bytes(home.folder / name)
                todo += _imports(found[name], _package(name)) if name.endswith(".py") else ()
    return found


def own_data(
    path: Path, names: Iterable[str], modules: Iterable[str], *, here: bool = True
) -> dict[str, Path]:
    """Give where the files lie that the file at `path` lists as its own: beside it, or where its modules are installed.

    here: whether the modules run in this environment. Raises InputError for one that is not there.
    """
    homes = (home_of(module, path.parent, here=here) for module in modules)
    folders = [path.parent, *(home.folder for home in homes if home is not None)]
    out = {}
    for name in names:
        remedy = "Name files relative to this file's folder, with / between folders."
        if name.startswith("/") or "\\" in name or posixpath.normpath(name) != name or len(name) > 255:
            raise InputError(
                path, f"files: {name!r} is not a plain relative name of up to 255 characters", remedy
            )
        there = next((folder / name for folder in folders if (folder / name).is_file()), None)
        if there is None:
            raise InputError(path, f"files: {name!r} is not a file beside it", remedy)
        out[name] = there
    return out


def home_of(module: str, folder: Path, *, here: bool = True) -> UserModules | None:
    """Where a module that is not in `folder` lies with what is its own: where it is installed, else in a folder above.

    here: whether it runs in this environment, and may be installed in it. None for one that is built in, or not there.
    """
    top = module.partition(".")[0]
    try:
        spec = importlib.util.find_spec(top) if here else None
    except (ImportError, ValueError, AttributeError):
        return None
    if top in _SHARED:
        return None
    if spec is None:
        above = (UserModules(parent, top, here) for parent in folder.absolute().parents)
        return next((home for home in above if home.files(module)), None)
    if spec.submodule_search_locations:
        return UserModules(Path(next(iter(spec.submodule_search_locations))).parent, top)
    if spec.origin is None or not spec.has_location:
        return None
    folder = Path(spec.origin).parent
    common = folder.name in ("site-packages", "dist-packages") or folder == Path(sysconfig.get_path("stdlib"))
    return UserModules(folder, top if common else None)


def _is_installed(top: str) -> bool:
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError, AttributeError):
        return False
    return spec is not None and spec.origin is not None


def _bytes(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as e:
        raise InputError(file, f"cannot be read ({e.strerror})") from e


def _package(name: str) -> list[str]:
    """The packages that a module's file lies in."""
    return list(PurePosixPath(name).parts[:-1])


def _imports(source: bytes, package: list[str]) -> Iterator[str]:
    """Names of modules that a source may import, in functions, too; `a.b` also where b may be no module of a."""
    try:
        nodes = list(ast.walk(ast.parse(source)))
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return  # whoever loads it will say so
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            base = [*above, *(node.module.split(".") if node.module else [])]
            yield ".".join(base)
            yield from (".".join([*base, alias.name]) for alias in node.names)
    if any(name.encode() in source for name in _BY_NAME):
        texts = [n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)]
        for text in texts:
            yield text
            yield ".".join([*package, text.lstrip(".")])
