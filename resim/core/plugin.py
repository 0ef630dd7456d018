"""Code that a user names in a file, `module:name`: loaded from the file's frozen copy, each in a namespace of its own.

Modules of two files may have the same names, also beside installed ones: those of each get private names, and what they
import is looked for among their own first.
"""

from __future__ import annotations

import builtins
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

from resim.core.errors import FunctionError, InputError, StopError
from resim.core.frozen import Copy, Frozen, freeze
from resim.core.imports import is_own, options, own_data, own_sources
from resim.core.modules import OwnModules
from resim.core.opened import Opened
from resim.core.watchdog import Watchdog, said

LOAD_LIMIT = 180.0
"""s of wall clock for the import of a module: those of large libraries take a minute where the disk is cold."""


def freeze_code(path: Path, raw: bytes, named: Sequence[str], files: Sequence[str] = ()) -> Frozen:
    """Freeze the file at `path`, which holds `raw`, with the code and the data that belong to it.

    named: the "module:name" that it says. files: what it lists as data. Raises InputError.
    """
    modules = [one.partition(":")[0] for one in named]
    data = own_data(path, files, modules)
    scripts = [name for name in data if name.endswith(".py") and data[name] == path.parent / name]
    sources = own_sources(path, modules, scripts)
    return freeze(path, raw, sources, {name: file for name, file in data.items() if name not in sources})


def load_named(frozen: Frozen, copy: Copy, named: str, what: str) -> tuple[Callable[..., Any], Opened]:
    """Give the callable that a frozen file names as "module:name" for its field `what`, from its copy.

    Also gives the context in which to call it, which hears of files that it opens. Raises InputError for a module or
    name that is not there, FunctionError for one that takes longer than LOAD_LIMIT, or ends the process.
    """
    path = frozen.path
    module_name, _, name = named.partition(":")
    private = f"_resim_{frozen.hash[:16]}"
    if private not in _spaces:
        _spaces[private] = _Space(private, copy)
    space = _spaces[private]
    opened = Opened(path, copy.folder, copy.names, frozenset(space.opened), space.modules)
    problem = f"{what} module {module_name!r} cannot be imported"
    remedy = f"Install it, or put the module's file beside {path.name}."
    try:
        with opened, _path_kept(), Watchdog() as watchdog:
            module = watchdog.load(LOAD_LIMIT, frozen.hash, lambda: _loaded(space, module_name))
    except FunctionError as e:
        late = "Move what takes long, or ends the process, out of the module into a function that is called later"
        raise FunctionError(f"{path}: {problem}: it {e}. {late}.") from e
    if isinstance(module, _FailedImport):
        raise InputError(path, f"{problem}: {module.why}", opened.remedy() or remedy) from module.cause
    space.opened |= opened.found
    found = getattr(module, name, None)
    if not callable(found):
        raise InputError(path, f"{what} {named!r}: module {module_name} has no {name}")
    return found, opened


@dataclass(frozen=True)
class _FailedImport:
    """What an import raised that the user can mend."""

    why: str
    cause: BaseException


def _loaded(space: _Space, name: str) -> ModuleType | _FailedImport:
    try:
        return space.load(name)
    except StopError:
        raise
    except (Exception, SystemExit) as e:
        return _FailedImport(said(e), e)


class _Space:
    """A namespace of modules: a package of a private name, whose modules import one another by their own names.

    opened: files that they opened when they were loaded. modules: those that they put into `sys.modules`.
    """

    def __init__(self, name: str, copy: Copy) -> None:
        self.name, self.copy, self.opened, self.modules = name, copy, set[str](), OwnModules()
        tops = {name.partition("/")[0].partition(".")[0] for name in copy.names}
        self._tops = {top for top in tops if is_own(top, copy.names)}
        self.builtins = {**vars(builtins), "__import__": self._import}
        self._importlib = _Importlib(self)

    def load(self, name: str, package: str | None = None) -> ModuleType:
        """Import a module by the name that it has for the user."""
        if self.name not in sys.modules:
            root = ModuleType(self.name, "Modules of a user's file.")
            root.__path__ = [str(self.copy.folder)]
            sys.modules[self.name] = root
        with _installed_path():
            return importlib.import_module(
                self._private(name), None if package is None else self._private(package)
            )

    def _private(self, name: str) -> str:
        return f"{self.name}.{name}" if name.partition(".")[0] in self._tops else name

    def _import(
        self,
        name: str,
        globals: Mapping[str, object] | None = None,
        locals: Mapping[str, object] | None = None,
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        """Do what `__import__` does, for the modules of this space."""
        top = name.partition(".")[0]
        if level or top not in self._tops:
            with _installed_path():
                found = builtins.__import__(name, globals, locals, fromlist or (), level)
            return self._importlib if found is importlib else found
        whole = builtins.__import__(f"{self.name}.{name}", globals, locals, fromlist or (), 0)
        return whole if fromlist else sys.modules[f"{self.name}.{top}"]

    def spec(self, name: str) -> importlib.machinery.ModuleSpec | None:
        """Say where the module of a private name is loaded from; None where it is not in the copy."""
        place = name.partition(".")[2].replace(".", "/")
        folder, names = self.copy.folder / place, self.copy.names
        file = next((option for option in options(place) if option in names), None)
        if file is None:
            if not any(each.startswith(f"{place}/") for each in names):
                return None
            spec = importlib.machinery.ModuleSpec(name, None, is_package=True)
            spec.submodule_search_locations = [str(folder)]
            return spec
        inside = [str(folder)] if file.startswith(f"{place}/") else None
        path = str(self.copy.folder / file)
        loader = _Loader(name, path, self, file) if file.endswith(".py") else None
        return importlib.util.spec_from_file_location(
            name, path, loader=loader, submodule_search_locations=inside
        )


class _Importlib(ModuleType):
    """`importlib` as the modules of a space see it: their own modules can be imported by their names."""

    def __init__(self, space: _Space) -> None:
        super().__init__("importlib")
        self.import_module = space.load

    def __getattr__(self, name: str) -> Any:
        return getattr(importlib, name)


class _Loader(importlib.machinery.SourceFileLoader):
    """Runs a module's source as it was hashed, never bytecode that was made from another."""

    def __init__(self, name: str, path: str, space: _Space, file: str) -> None:
        super().__init__(name, path)
        self._space, self._file = space, file

    def get_code(self, fullname: str) -> CodeType:
        """Compile the source."""
        source = self._space.copy.sources[self._file]
        code: CodeType = compile(source, self.path, "exec", dont_inherit=True)
        return code

    def exec_module(self, module: ModuleType) -> None:
        """Run the module with the imports of its space."""
        module.__dict__["__builtins__"] = self._space.builtins
        exec(self.get_code(module.__name__), module.__dict__)


class _Finder(importlib.abc.MetaPathFinder):
    """Finds modules of the spaces by their private names."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        space = _spaces.get(fullname.partition(".")[0])
        return None if space is None else space.spec(fullname)


@contextmanager
def _path_kept() -> Iterator[None]:
    """Take back what a module changes of the search path."""
    before = sys.path[:]
    try:
        yield
    finally:
        sys.path[:] = before


@contextmanager
def _installed_path() -> Iterator[None]:
    """Look for modules where the program does: one found in a folder that a module adds would be everybody's."""
    with _path_kept():
        sys.path[:] = _PATH
        yield


_PATH = tuple(sys.path)
"""Where installed modules are."""
_spaces: dict[str, _Space] = {}
sys.meta_path.insert(0, _Finder())
