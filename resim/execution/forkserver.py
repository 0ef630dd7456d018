"""A process that has loaded resim's libraries and forks children: a child is there in 10 ms in place of seconds.

The command starts one at its first child. It loads resim's own modules alone, never code under test, and ends with the
command. Python's own (multiprocessing.forkserver) gives its children no session, no streams and no environment of the
moment, and one that a caller has set up already would be shared.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import os
import pickle
import random
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

_WORD = struct.Struct("!q")
"""What a child's status pipe tells, one after the other: its process number, and how it ended."""
_SIZE = struct.Struct("!Q")
"""Before each request: how many bytes it has."""
_LONGEST, _KILLED = 180.0, 10.0
"""s that a server has to load resim and fork a child, and to tell the end of one that was killed."""
_TRIES = 3
"""How often a server is started for a child, where somebody ended the one that there was."""
_OURS = __name__.partition(".")[0]
_CODE = f"import sys; sys.path[:] = {{path!r}}; from {__name__} import main; main()"


class ForkedProcess:
    """A child that the server forked, as `subprocess.Popen` shows one.

    Attributes:
        returncode: Exit code, or minus the number of the signal; None while it is alive.
    """

    def __init__(self, status: int) -> None:
        """status: open file that tells of it; it is closed when it has told all."""
        self._status, self._told = status, b""
        self._number: int | None = None
        self.returncode: int | None = None

    def has_begun(self) -> bool:
        """Wait until it is there; False where the server ended before, or takes too long."""
        while self._number is None and self.returncode is None:
            if not self._read(_LONGEST):
                self._lost()
        return self._number is not None

    def poll(self) -> int | None:
        """Give how it ended; None while it is alive."""
        while self.returncode is None and self._read(0.0):
            pass
        return self.returncode

    def wait(self, timeout: float) -> int:
        """Give how it ended. Raises TimeoutExpired where it did not within `timeout` [s]."""
        while self.returncode is None:
            if not self._read(timeout):
                raise subprocess.TimeoutExpired("a child of resim", timeout)
        return self.returncode

    def kill(self) -> None:
        """End it at once, and wait until it has ended, as far as the server tells."""
        if self.returncode is None and self._number is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._number, signal.SIGKILL)
        while self.returncode is None:
            if not self._read(_KILLED):
                self._lost()

    def _lost(self) -> None:
        """Give it up: nobody tells how it ended."""
        self.returncode = -signal.SIGKILL
        os.close(self._status)

    def _read(self, timeout: float) -> bool:
        """Take note of what the pipe tells next; False where it tells nothing within `timeout` [s]."""
        if not is_readable(self._status, timeout):
            return False
        part = os.read(self._status, _WORD.size - len(self._told))
        self._told += part
        if part and len(self._told) < _WORD.size:
            return True
        if not part:  # the server was killed
            self._lost()
            return True
        word, self._told = _WORD.unpack(self._told)[0], b""
        if self._number is None:
            self._number = word
        else:
            self.returncode = word
            os.close(self._status)
        return True


def is_readable(file: int, timeout: float) -> bool:
    """Say whether an open file has something to read within `timeout` [s], or is at its end."""
    return bool(readable((file,), timeout))


def readable(files: Sequence[int], timeout: float | None = None) -> list[int]:
    """Give the open files that have something to read, or are at their end, as soon as one has.

    timeout: s until none is given. As select.select, which takes no numbers from 1,024 on.
    """
    waiting = select.poll()
    for file in files:
        waiting.register(file, select.POLLIN)
    return [file for file, _ in waiting.poll(None if timeout is None else 1000.0 * timeout)]


def _environment() -> dict[str, str]:
    """That of the children: one thread of BLAS in each, unless the user says otherwise, as there are many of them."""
    return {"OMP_NUM_THREADS": "1", **os.environ}


class _Server:
    """The process that forks, as the command sees it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._path: list[str] = []
        self._asking: socket.socket | None = None

    def fork(self, module: str, files: Sequence[int]) -> subprocess.Popen[bytes]:
        """Ask for a child: see `_forked`; give the process that is asked. Raises OSError where none can be started."""
        path = _path()
        with self._lock:
            if self._process is None or self._path != path or self._process.poll() is not None:
                self.end()
                self._start(path)
            assert self._asking is not None
            assert self._process is not None
            request = pickle.dumps((module, _environment()))
            socket.send_fds(self._asking, [_SIZE.pack(len(request))], files)
            self._asking.sendall(request)
            return self._process

    def _start(self, path: list[str]) -> None:
        self._path = path
        self._asking, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", _CODE.format(path=path), str(theirs.fileno())],
                pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL, stdout=2, start_new_session=True,
                env={**_environment(), "PYTHONHASHSEED": "0"},  # sets of names have one order in all children
            )  # fmt: skip

    def end(self) -> None:
        """End the process; its children live on."""
        if self._asking is not None:
            self._asking.close()
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def forget(self) -> None:
        """Be as new in a copy of the process: the server and its children are the other's."""
        if self._asking is not None:
            self._asking.close()
        if self._process is not None:
            self._process.returncode = 0  # it is the other's to wait for
        self._lock, self._process, self._asking = threading.Lock(), None, None


def _path() -> list[str]:
    """Where children look for modules: where the command does, but for where it is; and this resim is found first."""
    path = [os.path.abspath(folder) for folder in sys.path if folder]  # noqa: PTH100
    ours = Path(__file__).parents[2]
    found = next((folder for folder in path if Path(folder, _OURS, "__init__.py").is_file()), None)
    return path if found is not None and Path(found).resolve() == ours.resolve() else [str(ours), *path]


_SERVER = _Server()
atexit.register(_SERVER.end)
os.register_at_fork(after_in_child=_SERVER.forget)


def fork(module: str, files: Sequence[int]) -> ForkedProcess:
    """Start a child that serves on these open files (`resim.execution.child.main`), once `module` is loaded.

    files: its tasks, results, board, lifeline and words. Raises OSError where no process can be started.
    """
    with contextlib.ExitStack() as stack:
        try:
            os.fstat(2)
            errors = 2
        except OSError:  # a command without standard error
            errors = os.open(os.devnull, os.O_WRONLY)
            stack.callback(os.close, errors)
        for _ in range(_TRIES):
            status, told = os.pipe()
            try:
                asked = _SERVER.fork(module, (*files, told, errors))
            except OSError:
                os.close(status)
                raise
            finally:
                os.close(told)
            if (process := ForkedProcess(status)).has_begun():
                return process
            asked.kill()
            asked.wait()
    raise OSError("the process that starts others was ended")


def main() -> None:
    """Fork children for the command at the other end of a socket, until it ends."""
    with socket.socket(fileno=int(sys.argv[1])) as asked:
        files = _forked(asked)
    if files is not None:
        from resim.execution import child

        child.main(*files)


def _forked(asked: socket.socket) -> tuple[int, int, int, int, int] | None:
    """Fork a child for each request; return in it, with the open files that it serves on, else None at the end."""
    os.set_inheritable(asked.fileno(), False)
    signal.pthread_sigmask(signal.SIG_SETMASK, ())  # whatever the command was started with
    woken, wakes = os.pipe()
    for end in (woken, wakes):
        os.set_blocking(end, False)
    signal.set_wakeup_fd(wakes, warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    alive: dict[int, int] = {}
    while True:
        ready = readable((asked.fileno(), woken))
        if woken in ready:
            with contextlib.suppress(BlockingIOError):
                os.read(woken, 4096)
            _tell_ended(alive)
        if asked.fileno() not in ready:
            continue
        head, files, *_ = socket.recv_fds(asked, _SIZE.size, 7)
        if len(head) < _SIZE.size:
            return None  # the command has ended
        *served, told, errors = files
        request = asked.recv(_SIZE.unpack(head)[0], socket.MSG_WAITALL)
        module, environment = pickle.loads(request)
        _load(module)
        if number := os.fork():
            for file in (*served, errors):
                os.close(file)
            alive[number] = told
            with contextlib.suppress(BrokenPipeError):  # the command has ended, which is heard next
                os.write(told, _WORD.pack(number))
            continue
        os.setsid()
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for file in (woken, wakes, told, *alive.values()):
            os.close(file)
        for stream in (1, 2):
            os.dup2(errors, stream)
        os.close(errors)
        _begin_anew(environment)
        tasks, results, board, lifeline, words = served
        return tasks, results, board, lifeline, words


def _load(name: str) -> None:
    """Load a module of resim's, and those that it imports when it works: its PRELOADED.

    Whatever else a child is asked for, it loads itself.
    """
    if (
        sys.platform != "linux" or name.partition(".")[0] != _OURS
    ):  # macOS has libraries that do not bear a fork
        return
    with contextlib.suppress(Exception):  # the child says what is wrong
        for needed in getattr(importlib.import_module(name), "PRELOADED", ()):
            _load(needed)


def _begin_anew(environment: dict[str, str]) -> None:
    """Be as a process that was just started: with the environment of the moment, and random numbers of its own."""
    os.environ.clear()
    os.environ.update({**environment, "PYTHONHASHSEED": "0"})
    random.seed()
    if "numpy" in sys.modules:
        sys.modules["numpy"].random.seed()


def _tell_ended(alive: dict[int, int]) -> None:
    """Take note of the children that ended, and tell how."""
    with contextlib.suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            told = alive.pop(ended[0], None)
            if told is not None:
                with contextlib.suppress(OSError):  # nobody listens any more
                    os.write(told, _WORD.pack(os.waitstatus_to_exitcode(ended[1])))
                os.close(told)
