"""Code that a user names in a file, `module:name`: loaded from the file's frozen copy, each in a namespace of its own.

Modules of two files may have the same names, also beside installed ones: those of each get private names, and what they
import is looked for among their own first. Each run executes them again, so that no run knows of another.
"""

from __future__ import annotations

import builtins
import gc
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

from resim.core.errors import ChangedError, FunctionError, InputError, StopError
from resim.core.plugins.frozen import FrozenCopy, FrozenFile, find_copy, freeze
from resim.core.plugins.imports import is_own, options, own_data, own_sources
from resim.core.plugins.modules import OwnModules
from resim.core.plugins.surroundings import same_surroundings
from resim.core.plugins.unlisted_files import OpenedFiles
from resim.core.plugins.watchdog import Watchdog, exception_text

LET_GO_LIMIT = 60.0
"""s of wall clock for the finalizers of a run's modules."""
LOAD_LIMIT = 180.0
"""s of wall clock for the import of a module: those of large libraries take a minute where the disk is cold."""


def freeze_code(
    path: Path,
    raw: bytes,
    named: Sequence[str],
    files: Sequence[str] = (),
    outside: Mapping[str, Path] | None = None,
) -> FrozenFile:
    """Freeze the file at `path`, which holds `raw`, with the code and the data that belong to it.

    named: the "module:name" that it says. files: what it lists as data. outside: programs that are run where they are,
    by the word that names them, None where the code runs in this environment. Raises InputError.
    """
    modules, here = [one.partition(":")[0] for one in named], outside is None
    data = own_data(path, files, modules, here=here)
    scripts = [name for name in data if name.endswith(".py") and data[name] == path.parent / name]
    sources = own_sources(path, modules, scripts, here=here)
    rest = {name: file for name, file in data.items() if name not in sources}
    return freeze(path, raw, sources, rest, outside)


def load_named(frozen: FrozenFile, copy: FrozenCopy, named: str, what: str) -> LoadedCallable:
    """Give the callable that a frozen file names as "module:name" for its field `what`, from its copy.

    Raises InputError for a module or name that is not there, FunctionError for one that takes longer than LOAD_LIMIT,
    or ends the process.
    """
    path = frozen.path
    module_name, _, name = named.partition(":")
    code = LoadedCallable(frozen, copy, named)
    problem = f"{what} module {module_name!r} cannot be imported"
    remedy = f"Install it, or put the module's file beside {path.name}."
    try:
        with code.afresh() as opened, Watchdog() as watchdog:
            found = watchdog.load(LOAD_LIMIT, frozen.hash, lambda: _loaded(code))
    except ChangedError:
        raise
    except FunctionError as e:
        late = "Move what takes long, or ends the process, out of the module into a function that is called later"
        raise FunctionError(f"{path}: {problem}: it {e}. {late}.") from e
    if isinstance(found, _FailedImport):
        raise InputError(path, f"{problem}: {found.why}", opened.remedy() or remedy) from found.cause
    if not callable(found):
        raise InputError(path, f"{what} {named!r}: module {module_name} has no {name}")
    return code


_FINALIZING = (b"__del__", b"yield", b"contextlib", b"finalize")
"""In sources of which something may run when objects go."""


class LoadedCallable:
    """A callable of a user's code. opened: unlisted files beside the user's file that its runs opened, all together."""

    def __init__(self, frozen: FrozenFile, copy: FrozenCopy, named: str) -> None:
        private = f"{_PRIVATE}{frozen.hash[:16]}"
        if private not in _spaces:
            _spaces[private] = _Space(private, copy)
        self._space = _spaces[private]
        self._module, _, self._name = named.partition(":")
        self.opened = OpenedFiles(frozen.path, copy.folder, copy.names, self._space.modules)

    @contextmanager
    def afresh(self, seed: int = 0) -> Iterator[OpenedFiles]:
        """Context of one run of the code: it knows nothing of runs before, and leaves nothing to those after.

        Its own modules are executed again when they are imported. seed: of what draws without a generator of its own.
        Gives the context that hears of files that this run opens.
        """
        self._forget()
        opened = self.opened.of_a_run()
        try:
            with same_surroundings(seed), opened:
                try:
                    yield opened
                finally:
                    if self._space.finalizes:
                        self._forget()
        finally:
            self.opened.found |= opened.found
            self.opened.elsewhere |= opened.elsewhere
            self.opened.others |= opened.others

    def _forget(self) -> None:
        with Watchdog() as watchdog:
            watchdog.call(LET_GO_LIMIT, self._let_go)

    def _let_go(self) -> None:
        """Forget the modules, whose finalizers are code, too: later they would run at any time, outside of limits."""
        self._space.forget()
        if self._space.finalizes:
            gc.collect()

    def load(self) -> Any:
        """Import the module, unless this run has it, and give what it has by the name; None where it has none."""
        return getattr(self._space.load(self._module), self._name, None)


@dataclass(frozen=True)
class _FailedImport:
    """What an import raised that the user can mend."""

    why: str
    cause: BaseException


def _loaded(code: LoadedCallable) -> Any:
    try:
        return code.load()
    except StopError:
        raise
    except (Exception, SystemExit) as e:
        return _FailedImport(exception_text(e), e)


class _Space:
    """A namespace of modules: a package of a private name, whose modules import one another by their own names.

    modules: those that they put into `sys.modules`. compiled: those that are no Python; a process has them once.
    """

    def __init__(self, name: str, copy: FrozenCopy) -> None:
        self.name, self.copy, self.modules = name, copy, OwnModules()
        self.compiled: dict[str, ModuleType] = {}
        self._codes: dict[str, CodeType] = {}
        self._free: dict[str, bool] = {}
        self._loaded = set[str]()
        self.finalizes = any(word in source for source in copy.sources.values() for word in _FINALIZING)
        tops = {name.partition("/")[0].partition(".")[0] for name in copy.names}
        self._tops = {top for top in tops if is_own(top, copy.names)}
        self.forget()

    def alias(self, module: ModuleType) -> None:
        """Let a module be found by the name that the user has for it, as in what was pickled, if nobody else has it."""
        name = module.__name__.partition(".")[2]
        top = name.partition(".")[0]
        if top not in self._free:
            with _installed_path():
                self._free[top] = (
                    top not in sys.modules and importlib.machinery.PathFinder.find_spec(top) is None
                )
        if self._free[top] and self.modules.active:
            sys.modules[name] = module

    def forget(self) -> None:
        """Have every module executed again by its next import."""
        for name in (self.name, *self._loaded):
            sys.modules.pop(name, None)
        self._loaded.clear()
        self.modules.forget()
        self.builtins = {**vars(builtins), "__import__": self._import}
        self._importlib = _Importlib(self)

    def code(self, file: str, path: str) -> CodeType:
        """Give the code of a source as it was hashed, never bytecode that was made from another."""
        if file not in self._codes:
            self._codes[file] = compile(self.copy.sources[file], path, "exec", dont_inherit=True)
        return self._codes[file]

    def load(self, name: str, package: str | None = None) -> ModuleType:
        """Import a module by the name that it has for the user."""
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
        self._loaded.add(name)
        place = name.partition(".")[2].replace(".", "/")
        folder, names = self.copy.folder / place, self.copy.names
        file = next((option for option in options(place) if option in names), None)
        if file is None:
            if place and not any(each.startswith(f"{place}/") for each in names):
                return None
            spec = importlib.machinery.ModuleSpec(name, None, is_package=True)
            spec.submodule_search_locations = [str(folder)]
            return spec
        inside = [str(folder)] if file.startswith(f"{place}/") else None
        path = str(self.copy.folder / file)
        loader: importlib.abc.Loader | None = None
        if file.endswith(".py"):
            loader = _Loader(name, path, self, file)
        elif file.endswith(tuple(importlib.machinery.EXTENSION_SUFFIXES)):
            loader = _CompiledLoader(name, path, self)
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
    """Runs a module's source in its space."""

    def __init__(self, name: str, path: str, space: _Space, file: str) -> None:
        super().__init__(name, path)
        self._space, self._file = space, file

    def get_code(self, fullname: str) -> CodeType:
        """Give the compiled source."""
        return self._space.code(self._file, self.path)

    def exec_module(self, module: ModuleType) -> None:
        """Run the module with the imports of its space."""
        self._space.alias(module)
        module.__dict__["__builtins__"] = self._space.builtins
        exec(self.get_code(module.__name__), module.__dict__)


class _CompiledLoader(importlib.machinery.ExtensionFileLoader):
    """Gives a compiled module once more: few can be loaded twice into a process."""

    def __init__(self, name: str, path: str, space: _Space) -> None:
        super().__init__(name, path)
        self._space = space

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        """Give the module that the process has, or load it."""
        return self._space.compiled.get(spec.name) or super().create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        """Run the module, unless it has run."""
        name = module.__name__
        if name not in self._space.compiled:
            super().exec_module(module)
            self._space.compiled[name] = module


class _Finder(importlib.abc.MetaPathFinder):
    """Finds modules of the spaces by their private names."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        top = fullname.partition(".")[0]
        if top not in _spaces and top.startswith(_PRIVATE):  # in a process that user's code started
            copy = find_copy(top.removeprefix(_PRIVATE))
            if copy is not None:
                _spaces[top] = _Space(top, copy)
        return _spaces[top].spec(fullname) if top in _spaces else None


@contextmanager
def _installed_path() -> Iterator[None]:
    """Look for modules where the program does: one found in a folder that a module adds would be everybody's."""
    before = sys.path[:]
    try:
        sys.path[:] = _PATH
        yield
    finally:
        sys.path[:] = before


_PATH = tuple(sys.path)
"""Where installed modules are."""
_PRIVATE = "_resim_"
"""How the names of all spaces begin; the hash of the user's file follows."""
_spaces: dict[str, _Space] = {}
sys.meta_path.insert(0, _Finder())
