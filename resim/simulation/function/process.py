"""A process that is asked over its standard streams, message by message: one for each run, which ends with it.

Time is that of the simulation: the process is asked, and waited for within the build's limits. What it writes to the
standard error goes where a function's words go.
"""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import signal
import struct
import subprocess
import tempfile
import termios
from array import array
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgpack

from resim.core.errors import FunctionError
from resim.core.plugins.unlisted_files import unheard
from resim.function import LONGEST

_ENDING = 5.0
"""s that a process has to end by itself, once its run has."""
PASSED = (
    "HOME", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "PATH",
    "TMPDIR", "TZ",
)  # fmt: skip
"""Variables of the environment that every process gets."""


class ChildProcess:
    """A process, as the partner of a conversation (`resim.simulation.function.messages.Partner`).

    folder: with the files of its build, of which it gets a copy for itself, to work in. own: those of them that the
    command may name, the program among them. environment: variables that it gets besides `PASSED`. unchanged:
    raises FunctionError where a program elsewhere, or a file in the copy of the folder, is another by now. grouped:
    whether it is a process group of its own, which ends with it.
    """

    def __init__(
        self, command: tuple[str, ...], folder: Path, own: bool, environment: tuple[str, ...],
        unchanged: Callable[[Path], None], *, grouped: bool = False,
    ) -> None:  # fmt: skip
        self._grouped = grouped
        self._command, self._folder, self._own = command, folder, own
        self._environment, self._unchanged = environment, unchanged
        self._process: subprocess.Popen[bytes] | None = None
        self._home: tempfile.TemporaryDirectory[str] | None = None

    def start(self) -> None:
        """Start it. What resim reads, copies and starts for it is not what the code under test opens."""
        with unheard():
            self._start()

    def _start(self) -> None:
        first, *rest = self._command
        try:
            self._home = tempfile.TemporaryDirectory(prefix="resim-", ignore_cleanup_errors=True)
            here = Path(self._home.name) / "build"
            shutil.copytree(self._folder, here)
            here.chmod(0o755)
            self._unchanged(here)
            command = [str(here / first) if self._own else first, *rest]
            self._process = subprocess.Popen(
                command, cwd=here, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0,
                env=_variables(self._environment), process_group=0 if self._grouped else None,
            )  # fmt: skip
        except FunctionError:
            self.kill()
            raise
        except (OSError, ValueError) as e:
            self.kill()
            raise FunctionError(f"cannot be started: {first!r}: {_why_not(e)}") from e

    def exchange(self, message: bytes) -> bytes:
        """Send a message and give the body of what is answered."""
        process = self._process
        if process is None:
            raise FunctionError("was asked when it had ended")
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            if _has_more(process.stdout.fileno()):
                raise FunctionError("wrote more than one answer to a message")
            _send(process.stdin.fileno(), message)
            return _received(process.stdout.fileno())
        except (BrokenPipeError, EOFError):
            raise EOFError(f"ended its process {_ending(process.wait())}") from None

    def end(self, message: bytes) -> None:
        """Send the last message; FunctionError where it does not end by itself, or ends with an error."""
        process = self._process
        if process is None:
            self.kill()
            return
        assert process.stdin is not None
        try:
            with suppress(OSError):
                process.stdin.write(message)
            process.stdin.close()
            try:
                code = process.wait(_ENDING)
            except subprocess.TimeoutExpired:
                raise FunctionError(f"did not end within {_ENDING:g} s of the message 'close'") from None
            if code != 0:
                raise FunctionError(f"ended its process {_ending(code)}")
            assert process.stdout is not None
            if _has_more(process.stdout.fileno()):
                raise FunctionError(_told_last(process.stdout.fileno()))
        finally:
            self.kill()

    @property
    def number(self) -> int:
        """Of the process, and of its group where it is one of its own. Raises FunctionError where there is none."""
        if self._process is None:
            raise FunctionError("was asked when it had ended")
        return self._process.pid

    def stop(self) -> None:
        """End it from another thread than the one that asks it, which finds it ended."""
        process = self._process
        if process is not None:
            self._signal(process)

    def _signal(self, process: subprocess.Popen[bytes]) -> None:
        process.kill()
        if self._grouped:
            with suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)

    def kill(self) -> None:
        """End it, whatever it does."""
        process, self._process = self._process, None
        if process is not None:
            assert process.stdin is not None
            assert process.stdout is not None
            self._signal(process)
            process.wait()
            with suppress(OSError):
                process.stdin.close()
            process.stdout.close()
        if self._home is not None:
            with unheard():
                self._home.cleanup()
            self._home = None


def _has_more(stream: int) -> bool:
    """Whether something waits to be read."""
    count = array("i", [0])
    fcntl.ioctl(stream, termios.FIONREAD, count)
    return count[0] > 0


def _told_last(stream: int) -> str:
    """What a process that has ended said after `close`: its error, or that it wrote what nobody asked for.

    Only what is there is read: a child of the process may hold the stream open.
    """
    with suppress(ValueError, msgpack.UnpackException):
        told = msgpack.unpackb(os.read(stream, 1 << 16)[4:])
        if isinstance(told, dict) and isinstance(told.get("error"), str):
            return f"failed: {told['error']:.300}"
    return "wrote more than one answer to a message"


def _send(to: int, message: bytes) -> None:
    sent = os.write(to, message)
    while sent < len(message):
        sent += os.write(to, message[sent:])


def _received(stream: int) -> bytes:
    """The body of the next message."""
    (size,) = struct.unpack("<I", _exactly(stream, 4))
    if size > LONGEST:
        begin = struct.pack("<I", size) + (os.read(stream, 40) if _has_more(stream) else b"")
        raise FunctionError(
            f"wrote {begin!r} to its standard output, which is no message: print to the standard error instead"
        )
    return _exactly(stream, size)


def _exactly(stream: int, size: int) -> bytes:
    parts = [os.read(stream, size)] if size else [b""]
    left = size - len(parts[0])
    while left:
        if not parts[-1]:
            raise EOFError
        parts.append(os.read(stream, min(left, 1 << 20)))
        left -= len(parts[-1])
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _why_not(e: OSError | ValueError) -> str:
    """Why a program cannot be started."""
    told = str(getattr(e, "strerror", e))
    if getattr(e, "errno", None) == errno.ENOEXEC:
        told += " (neither a program of this machine nor a script that begins with #! and its interpreter)"
    return told


def _ending(code: int) -> str:
    return f"by {signal.Signals(-code).name}" if code < 0 else f"with code {code}"


def _variables(named: tuple[str, ...]) -> dict[str, str]:
    """Those that everybody gets, and those that are named; Python draws the same hashes."""
    given = {name: os.environ[name] for name in (*PASSED, *named) if name in os.environ}
    return {**given, "PYTHONHASHSEED": "0", "PYTHONDONTWRITEBYTECODE": "1"}
