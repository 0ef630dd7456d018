"""What was done by whom: a line for each form that was sent, in a file that is only appended to."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

MOST_VALUES = 100
"""Values of a form that a line tells of."""
MOST_LINE = 2_000
"""Bytes of a line, as a rule."""


class AuditTrail:
    """Appends to a file of lines of JSON, which the user alone may read. Several servers may do so at once."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def note(
        self, user: str, session: str, client: str, action: str, form: Sequence[tuple[str, str]], outcome: str
    ) -> None:
        """Append a line: when, who, which session (a digest of it), from where, what was sent, what came of it.

        user: "" for who came by an address that the server printed.

        Raises OSError where it cannot be written: what leaves no trace is not done.
        """
        line = {
            "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "user": user,
            "session": hashlib.sha256(session.encode()).hexdigest()[:16],
            "client": client,
            "action": action,
            "form": [[name, value] for name, value in form[:MOST_VALUES]],
            "outcome": outcome,
        }
        file = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        try:
            os.write(file, (json.dumps(line) + "\n").encode())
            os.fsync(file)
        finally:
            os.close(file)

    def last(self, count: int) -> list[dict[str, Any]]:
        """Give the newest lines, the newest first."""
        try:
            with self.path.open("rb") as file:
                file.seek(max(0, file.seek(0, os.SEEK_END) - count * MOST_LINE))
                lines = file.read().splitlines()
        except OSError:
            return []
        found = []
        for line in lines[::-1][:count]:
            with suppress(ValueError):  # of a line that the beginning was cut off of
                found.append(json.loads(line))
        return found
