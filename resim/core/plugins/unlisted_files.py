"""Files beside a user's file that his code opens though they are not listed there: its hash does not know them.

Also what else holds while that code runs, and for no other: the modules that it makes.
"""

from __future__ import annotations

import os
import re
import site
import sys
import textwrap
import threading
from collections.abc import Iterator, Set
from contextlib import contextmanager
from copy import copy
from pathlib import Path
from types import FrameType
from typing import Any

from resim.core.files import cache_folder
from resim.core.plugins import integrity, process, watchdog
from resim.core.plugins.modules import OwnModules

NOT_IN_HASH = "which its hash does not know: list it in files = [...], and open it from Path(__file__).parent"
NOT_KNOWN = "its hash does not know what answers there"
NOT_PINNED = "is not in its hash: not pinned"
UNPINNED = (NOT_IN_HASH, NOT_KNOWN)
"""How notes end on what code asks besides its hash, which may be otherwise in the next command."""
NOT_OF_HASH = (*UNPINNED, NOT_PINNED)
"""How all notes end on what code is of besides its hash."""
_WORDS = re.compile(r"[\s'\"`=<>|;&(){}]+")
"""Between the words of a command line."""


class OpenedFiles:
    """Context in which code runs that may open files of its own; `found` are those that it does not list.

    `elsewhere` are files that it reads at other places, `others` what else it asks: programs, copies of its process,
    addresses. path: the user's file. folder: its place in the frozen copy,
    where the code believes to be. names: what is in the copy. modules: those that the code makes itself. Entering and
    leaving it raise ChangedError where such code changed resim.
    """

    def __init__(self, path: Path, folder: Path, names: frozenset[str], modules: OwnModules) -> None:
        self.path = path
        self.found, self.elsewhere, self.others = set[str](), set[str](), set[str]()
        self._written = set[str]()
        places = (folder, path.absolute().parent)
        self._folders = tuple(
            name(place) + os.sep for name in (os.path.realpath, os.path.abspath) for place in places
        )
        self._copy = {self._folders[0], self._folders[2]}
        self._names, self._modules = names, modules
        self._process = os.getpid()
        self._others_threads: Set[int] = frozenset()
        self._held = set[str]()  # folders that it holds open, for opening what is in them

    @property
    def hears(self) -> bool:
        """Whether this thread is one whose deeds are the code's: of it, or begun since."""
        return threading.get_ident() not in self._others_threads

    def of_a_run(self) -> OpenedFiles:
        """Give the same that has heard of no file yet."""
        run = copy(self)
        run.found, run.elsewhere, run.others = set(), set(), set()
        run._held, run._written = set(), set()
        return run

    def __enter__(self) -> OpenedFiles:
        self._others_threads = sys._current_frames().keys() - {threading.get_ident()}
        if not _watching:
            integrity.begin(self.path)
            watchdog.name_code(self.path)
            _watch_environment(_HeardEnvironment)
        self._modules.__enter__()
        _watching.append(self)
        return self

    def __exit__(self, *error: object) -> None:
        _watching.pop()
        self._modules.__exit__(*error)
        if not _watching:
            _watch_environment(_Environment)
            integrity.check()

    def given(self, parameters: Any) -> None:
        """Note the files that parameters name, at whatever depth: a library in C opens them unheard."""
        if isinstance(parameters, dict | list | tuple):
            for one in parameters.values() if isinstance(parameters, dict) else parameters:
                self.given(one)
        elif isinstance(parameters, str) and parameters and "\0" not in parameters and len(parameters) < 4096:
            place = os.path.realpath(parameters)
            if os.path.isfile(place):  # noqa: PTH113
                self._note(parameters)
                if not (_is_systems(place) or place.startswith(self._folders)):
                    self.elsewhere.add(place)

    def asks_environment(self, variable: str, file: str) -> None:
        """Note a variable of the environment that code in a file reads in a call, if that file is the user's.

        file: "" where only the library's is known, as in a thread that the code began.
        """
        if watchdog.board[0] and self.hears and (not file or file.startswith(self._folders)):
            self.others.add(f"read {variable} from the environment")

    def hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Note the files that an event of Python's audit names. Raises FunctionError where it would limit resim."""
        if event == "open":
            file, mode, flags = arguments
            if isinstance(file, str | bytes):
                self._opens(os.fsdecode(file), held=mode is None, flags=flags)
        elif event in process.LIMITING:
            if os.getpid() == self._process:
                process.refuse_lower_limits(*arguments)
        elif event in _ASKS:
            self._asks(event, arguments)
        elif (named := _EVENTS.get(event)) is not None:
            words = {word for k in named for word in _words(arguments[k])}
            cwd = arguments[2] if event == "subprocess.Popen" and arguments[2] else ""
            files = [file for word in words if os.path.isfile(file := os.path.join(os.fsdecode(cwd), word))]  # noqa: PTH113, PTH118
            for file in files:
                self._opens(file, held=False)
            if event in _PROGRAMS and watchdog.board[0] and not any(map(self._is_listed, files)):
                self.others.add(f"started {_command(arguments[_PROGRAMS[event]])}")

    def _asks(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Note a copy of the process, or an address, whose answers the hash does not know."""
        if not watchdog.board[0]:
            return
        if not event.startswith("socket."):
            self.others.add("forked its process")
        elif arguments[1] is not None and _POOLS not in str(arguments[1]):  # None: of one that is connected
            self.others.add(f"{'listened' if event == 'socket.bind' else 'connected'} to {arguments[1]!r}")

    def _is_listed(self, file: str) -> bool:
        """Whether a file is one of the frozen copy."""
        place = os.path.realpath(file)
        folder = next((f for f in self._copy if place.startswith(f)), None)
        return folder is not None and Path(place[len(folder) :]).as_posix() in self._names

    def _opens(self, file: str, *, held: bool, flags: int = os.O_RDONLY) -> None:
        """Note a file; held: opened by `os.open`, which may look for it in a folder that the code holds open."""
        writes = flags & os.O_ACCMODE == os.O_WRONLY
        makes = flags & os.O_CREAT and not os.path.exists(file)  # noqa: PTH110
        somewhere = held and not os.path.isabs(file)  # noqa: PTH117  in a folder that it holds open
        self._note_elsewhere(
            file,
            writes=writes,
            anew=bool(flags & os.O_TRUNC or makes),
            absent=not (somewhere or _is_compiled(file)),
        )
        if writes:
            return
        self._note(file)
        if not held:
            return
        if os.path.isdir(file):  # noqa: PTH112  its Path would open more
            self._held.add(os.path.abspath(file))  # noqa: PTH100
        elif not os.path.isabs(file):  # noqa: PTH117
            for inside in [os.path.join(folder, file) for folder in self._held]:  # noqa: PTH118
                if os.path.isfile(inside):  # noqa: PTH113
                    self._note(inside)
                    self._note_elsewhere(inside)

    def _note(self, file: str) -> None:
        """Note a file of the folder, by the name that the code uses and by the one that a link leads to."""
        for place in (os.path.realpath(file), os.path.abspath(file)):  # noqa: PTH100
            folder = next((f for f in self._folders if place.startswith(f)), None)
            if folder is None or os.path.isdir(place):  # noqa: PTH112
                continue
            name = Path(place[len(folder) :])
            listed = folder in self._copy and name.as_posix() in self._names
            ours = folder not in self._copy and _is_systems(place)
            compiled = name.parent.name == "__pycache__" and name.suffix == ".pyc"
            if not (listed or ours or compiled):
                self.found.add(name.as_posix())

    def _note_elsewhere(
        self, file: str, *, writes: bool = False, anew: bool = False, absent: bool = False
    ) -> None:
        """Note a file outside of the folder that the code reads in a call, and did not write itself.

        writes: it is opened for writing alone; anew: nothing is left of what was in it; absent: also one that is not
        there: next time it may be.
        """
        place = os.path.realpath(file)
        if _OF_PROCESS.fullmatch(place) and watchdog.board[0]:
            self.others.add("read all variables from the environment")
        names = (place, os.path.abspath(file))  # noqa: PTH100
        if not watchdog.board[0] or _is_systems(place) or any(n.startswith(self._folders) for n in names):
            return
        if anew:
            self._written.add(place)
        elif writes or place in self._written:
            return
        elif os.path.isfile(place) or (absent and not os.path.exists(place)):  # noqa: PTH113, PTH110
            self.elsewhere.add(place)

    def note(self) -> str:
        """Say which files it opened that its hash does not know; "" for none."""
        beside = f"{', '.join(sorted(self.found))} beside {self.path.name}" if self.found else ""
        told = " and ".join(part for part in (beside, ", ".join(sorted(self.elsewhere))) if part)
        notes = [f"the code opened {told}, {NOT_IN_HASH}"] if told else []
        if self.others:
            notes.append(f"the code {' and '.join(sorted(self.others))}: {NOT_KNOWN}")
        return "; ".join(notes)

    def name_of(self, file: str) -> str:
        """Give what a user calls a file: as seen from his own, else by its name and its folder's."""
        folder = next((f for f in self._folders if file.startswith(f)), None)
        return "/".join(Path(file).parts[-2:]) if folder is None else file[len(folder) :]

    def remedy(self) -> str:
        """Say what to write into the file so that the code has those that are there; "" where none is."""
        there = [name for name in sorted(self.found) if (self.path.parent / name).is_file()]
        files = ", ".join(f'"{name}"' for name in there)
        return (
            f"List in {self.path.name}: files = [{files}]; open it from Path(__file__).parent."
            if there
            else ""
        )


_SYSTEM = tuple(
    os.path.realpath(place) + os.sep
    for place in (
        *("/bin", "/dev", "/etc", "/lib", "/lib64", "/proc", "/sbin", "/sys", "/usr"),
        *(sys.prefix, sys.base_prefix, sys.exec_prefix, site.getusersitepackages()),
        *(str(Path(__file__).parents[3] / ours) for ours in ("resim", "adfunc")), str(cache_folder("")),
    )
)  # fmt: skip
"""Folders of what Python, installed packages, the system and resim open."""
_SHARED = "/dev/shm/"


def _is_compiled(file: str) -> bool:
    """Whether a file is named as bytecode is, which Python looks for before it compiles a module."""
    return file.endswith(".pyc") and "__pycache__" in file


def _is_systems(place: str) -> bool:
    """Whether a file is one that Python, an installed package, the system or resim opens."""
    return place.startswith(_SYSTEM) and not place.startswith(_SHARED)


@contextmanager
def unheard() -> Iterator[None]:
    """Context in which resim itself starts the program that a user's file names."""
    before = _watching[:]
    _watching.clear()
    try:
        yield
    finally:
        _watching[:] = before


_watching: list[OpenedFiles] = []
"""Whose code runs, innermost last."""

_Environment: Any = type(os.environ)
_LIBRARY = os.path.dirname(os.__file__) + os.sep  # noqa: PTH120
_INSTALLED = tuple(_LIBRARY + name + os.sep for name in ("site-packages", "dist-packages"))
"""Python's own library, which looks a variable up for somebody; and what is installed in it, which does for itself."""
_OF_PROCESS = re.compile(r"/proc/(self|thread-self|\d+)(/task/\d+)?/environ")


class _HeardEnvironment(_Environment):  # type: ignore[misc]
    """The environment, while code of a user runs: it hears who reads which variable."""

    def __getitem__(self, key: Any) -> Any:
        """Give a variable."""
        if _watching and isinstance(key, str | bytes):
            _watching[-1].asks_environment(os.fsdecode(key), _asker())
        return super().__getitem__(key)

    def __iter__(self) -> Any:
        """Give the names of all variables."""
        if _watching:
            _watching[-1].asks_environment("all variables", _asker())
        return super().__iter__()

    def __repr__(self) -> str:
        """Give all variables as text."""
        return f"environ({dict(self)!r})"


def _asker() -> str:
    """The file of the code that asks, past what looks variables up for somebody; "" where there is only that."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None:
        file = frame.f_code.co_filename
        if frame.f_globals.get("__name__") == "subprocess":
            return file  # which looks where a program lies; that one was started is told of
        librarys = file.startswith(_LIBRARY) and not file.startswith(_INSTALLED)
        if not (librarys or file == __file__ or file.startswith("<")):
            return file
        frame = frame.f_back
    return ""


def _watch_environment(kind: Any) -> None:
    """Let the environment, as text and as bytes, be of this kind."""
    for environment in (os.environ, os.environb):
        environment.__class__ = kind


_EVENTS = {
    "ctypes.dlopen": (0,),
    "import": (1,),
    "sqlite3.connect": (0,),
    "subprocess.Popen": (0, 1),
    "os.exec": (0, 1),
    "os.posix_spawn": (0, 1),
    "os.spawn": (1, 2),
    "os.system": (0,),
}
"""Audit events that name files, and which of their arguments do."""
_PROGRAMS = {"subprocess.Popen": 1, "os.exec": 0, "os.posix_spawn": 0, "os.spawn": 1, "os.system": 0}
"""Those that start another program, and which argument says what."""
_ASKS = {"os.fork", "os.forkpty", "socket.connect", "socket.sendmsg", "socket.sendto", "socket.bind"}
"""Audit events of what gives answers that no file of the code tells."""
_HEARD = {*_EVENTS, *_ASKS, *process.LIMITING}
_POOLS = "pymp-"
"""In the addresses of Python's own pools of processes."""


def _words(named: Any) -> Iterator[str]:
    """Give what may be a file's name in an argument: it, and each word of a command line."""
    for one in named if isinstance(named, list | tuple) else [named]:
        if isinstance(one, str | bytes | os.PathLike):
            text = os.fsdecode(one)
            text = text.removeprefix("file:").partition("?")[0] if text.startswith("file:") else text
            yield from (word for word in {text, *_WORDS.split(text)} if word and "\0" not in word)


def _command(named: Any) -> str:
    """A program and its arguments as one reads them, the beginning of many."""
    words = [os.fsdecode(one) for one in (named if isinstance(named, list | tuple) else [named])]
    return textwrap.shorten(" ".join(words), 200, placeholder=" ...")


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    if _watching and (event == "open" or event in _HEARD) and _watching[-1].hears:
        _watching[-1].hear(event, arguments)


sys.addaudithook(_hear)  # for good: there is no way to take one away
