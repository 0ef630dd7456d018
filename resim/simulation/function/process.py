"""A process that is asked over its standard streams, message by message: one for each run, which ends with it.

Time is that of the simulation: the process is asked, and waited for within the build's limits. What it writes to the
standard error goes where a function's words go.
"""

from __future__ import annotations

import os
import signal
import struct
import subprocess
from contextlib import suppress
from pathlib import Path

from resim.core.errors import FunctionError
from resim.core.plugins.unlisted_files import unheard
from resim.function import LONGEST

_ENDING = 5.0
"""s that a process has to end by itself, once its run has."""


class ChildProcess:
    """A process, as the partner of a conversation (`resim.simulation.function.messages.Partner`)."""

    def __init__(self, command: tuple[str, ...], folder: Path) -> None:
        self._command, self._folder = command, folder
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it."""
        command = self._command
        try:
            with unheard():
                self._process = subprocess.Popen(
                    command, cwd=self._folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0,
                    env=_environment(),
                )  # fmt: skip
        except (OSError, ValueError) as e:
            raise FunctionError(f"cannot be started: {command[0]!r}: {getattr(e, 'strerror', e)}") from e

    def exchange(self, message: bytes) -> bytes:
        """Send a message and give the body of what is answered."""
        process = self._process
        if process is None:
            raise FunctionError("was asked when it had ended")
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            _send(process.stdin.fileno(), message)
            return _received(process.stdout.fileno())
        except (BrokenPipeError, EOFError):
            raise EOFError(_ending(process.wait())) from None

    def end(self, message: bytes) -> None:
        """Send the last message; FunctionError where it does not end by itself, or ends with an error."""
        process = self._process
        if process is None:
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
        finally:
            self.kill()

    def kill(self) -> None:
        """End it, whatever it does."""
        process, self._process = self._process, None
        if process is None:
            return
        assert process.stdin is not None
        assert process.stdout is not None
        process.kill()
        process.wait()
        with suppress(OSError):
            process.stdin.close()
        process.stdout.close()


def _send(to: int, message: bytes) -> None:
    sent = os.write(to, message)
    while sent < len(message):
        sent += os.write(to, message[sent:])


def _received(stream: int) -> bytes:
    """The body of the next message."""
    (size,) = struct.unpack("<I", _exactly(stream, 4))
    if size > LONGEST:
        begin = struct.pack("<I", size) + os.read(stream, 40)
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


def _ending(code: int) -> str:
    return f"by {signal.Signals(-code).name}" if code < 0 else f"with code {code}"


def _environment() -> dict[str, str]:
    """That of the command; Python draws the same hashes, and puts no bytecode beside the frozen files."""
    return {**os.environ, "PYTHONHASHSEED": "0", "PYTHONDONTWRITEBYTECODE": "1"}
