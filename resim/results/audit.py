"""What was done by whom: a line for each form that was sent, and for each command that steers tasks or users, in a file
that is only appended to."""

from __future__ import annotations

import hashlib
import json
import os
import pwd
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from resim.core.errors import InputError, ResimError
from resim.results.database import data_folder

AUDIT = "audit.jsonl"
TERMINAL = "terminal"
"""As where a line says that it came from: the user is one of the system, not of the Supervisor."""
MOST_FORM = 1_000
"""Letters of a form that a line tells of: nobody pushes others' lines out of sight by large ones."""
MOST_TOLD = 300
"""Letters of what came of it."""
BLOCK = 65_536
"""Bytes that are read at once, from the end on."""


class AuditTrail:
    """Appends to a file of lines of JSON, which the user alone may read. Several servers may do so at once."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def note(
        self, user: str, session: str, client: str, action: str, form: Sequence[tuple[str, str]], outcome: str
    ) -> None:
        """Append a line: when, who, which session (a digest of it), from where, what was sent, what came of it.

        user: "" for who came by an address that the server printed. session: "" for a command.

        Raises OSError where it cannot be written: what leaves no trace is not done.
        """
        line = {
            "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "user": user,
            "session": hashlib.sha256(session.encode()).hexdigest()[:16] if session else "",
            "client": client,
            "action": action,
            "form": _told(form),
            "outcome": outcome[:MOST_TOLD],
        }
        file = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        try:
            os.write(file, (json.dumps(line) + "\n").encode())
            os.fsync(file)
        finally:
            os.close(file)

    def last(self, count: int, first: int = 0) -> list[dict[str, Any]]:
        """Give lines, the newest first, from number `first` on."""
        found: list[dict[str, Any]] = []
        for line in self._backwards():
            try:
                told = json.loads(line)
            except ValueError:  # of a line that was cut short
                continue
            if first > 0:
                first -= 1
                continue
            found.append(told)
            if len(found) == count:
                break
        return found

    def _backwards(self) -> Iterator[bytes]:
        """The lines of the file, the last one first."""
        try:
            with self.path.open("rb") as file:
                at, rest = file.seek(0, os.SEEK_END), b""
                while at > 0:
                    at, size = max(0, at - BLOCK), min(BLOCK, at)
                    file.seek(at)
                    rest, *lines = (file.read(size) + rest).split(b"\n")
                    yield from (line for line in reversed(lines) if line)
                if rest:
                    yield rest
        except OSError:
            return


@contextmanager
def noted_command(action: str, form: Sequence[tuple[str, str]] = ()) -> Iterator[None]:
    """Note what a command does, by the name that its user has on this machine, before and after.

    action: the address to which a page would send it. Raises InputError where it cannot be noted: it is not done then.
    """
    trail, user = AuditTrail(data_folder() / AUDIT), _system_user()

    def note(outcome: str) -> None:
        try:
            trail.path.parent.mkdir(parents=True, exist_ok=True)
            trail.note(user, "", TERMINAL, action, form, outcome)
        except OSError as e:
            raise InputError(trail.path, f"cannot be written ({e.strerror})") from e

    note("asked")
    try:
        yield
    except ResimError as e:
        note(f"refused: {e}")
        raise
    note("done")


def _system_user() -> str:
    try:
        return pwd.getpwuid(os.getuid()).pw_name  # not what the environment says
    except KeyError:  # a number without a name, as in containers
        return str(os.getuid())


def _told(form: Sequence[tuple[str, str]]) -> list[list[str]]:
    """What was sent, as far as there is room; of more than that how much there was."""
    told: list[list[str]] = []
    room = MOST_FORM
    for k, (name, value) in enumerate(form):
        if room <= 0:
            told.append(["…", f"{len(form) - k} more values"])
            break
        short = value if len(value) <= room else f"{value[:room]}… ({len(value)} letters)"
        told.append([name[:100], short])
        room -= len(name[:100]) + len(short)
    return told
