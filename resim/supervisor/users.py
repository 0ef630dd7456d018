"""Who may come in from other machines: names, roles and digests of tokens, in a file that its owner alone may read."""

from __future__ import annotations

import fcntl
import hashlib
import hmac
import json
import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from resim.core.errors import InputError

Role = Literal["administer", "run", "look"]
"""look: may see all, and change nothing; run: may start and stop tasks, too; administer: sees who did what, too."""
ROLES: tuple[Role, ...] = get_args(Role)
USERS = "users.json"
"""File in the user's data folder."""
NAME = re.compile(r"[A-Za-z0-9_-]{1,40}")
REMEDY = "Make users anew: `resim users add NAME --role run`."


@dataclass(frozen=True)
class KnownUser:
    """Somebody who has a token. mark: SHA-256 of the token, which itself is kept nowhere."""

    name: str
    role: Role
    mark: str


class Users:
    """The users in a file; several processes may change it, and servers see a change at once.

    All methods raise InputError for a file that cannot be read or written, that others may read, or that is none of
    this.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._known: tuple[object, dict[str, KnownUser]] = (None, {})

    def all(self) -> dict[str, KnownUser]:
        """Give all by name."""
        try:
            found = self.path.stat()
        except FileNotFoundError:
            return {}
        except OSError as e:
            raise InputError(self.path, f"cannot be read ({e.strerror})") from e
        if not stat.S_ISREG(found.st_mode):
            raise InputError(self.path, "is no file of users", REMEDY)
        if found.st_mode & 0o077:
            raise InputError(self.path, "may be read by other users", "Take that right away: chmod 600.")
        stamp = found.st_mtime_ns, found.st_size, found.st_ino
        if self._known[0] != stamp:
            self._known = (stamp, self._read())
        return self._known[1]

    def of_token(self, given: str) -> KnownUser | None:
        """Give the user of a token; every user's is looked at, which takes the same time whoever it is."""
        mark = _mark(given)
        same = [one for one in self.all().values() if hmac.compare_digest(one.mark, mark)]
        return same[0] if same else None

    def add(self, name: str, role: Role) -> str:
        """Add somebody, and give the token. Raises InputError where the name is taken, or is none."""
        if not NAME.fullmatch(name):
            raise InputError("NAME", f"{name:.60} is no name of a user", "Up to 40 letters, digits, _ and -.")
        token = secrets.token_urlsafe(24)
        with self._changed() as users:
            if name in users:
                raise InputError("NAME", f"{name} is known already", f"First: resim users rm {name}")
            users[name] = KnownUser(name, role, _mark(token))
        return token

    def remove(self, name: str) -> None:
        """Take somebody's token away; who is in by it is out. Raises InputError where there is nobody of this name."""
        with self._changed() as users:
            if users.pop(name, None) is None:
                known = ", ".join(sorted(users)) or "nobody"
                raise InputError("NAME", f"{name:.60} is no user", f"Known: {known}.")

    @contextmanager
    def _changed(self) -> Iterator[dict[str, KnownUser]]:
        """The users, to change; written whole at the end, or left where something goes wrong."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.with_suffix(".lock").open("ab") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                users = dict(self.all())
                yield users
                whole = Path(os.path.realpath(self.path))  # of a link what it leads to
                new = whole.with_suffix(".new")
                new.unlink(missing_ok=True)
                file = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
                with os.fdopen(file, "w", encoding="utf-8") as out:
                    told = {name: {"role": one.role, "mark": one.mark} for name, one in sorted(users.items())}
                    out.write(json.dumps(told, indent=1) + "\n")
                new.replace(whole)
        except OSError as e:
            raise InputError(self.path, f"cannot be written ({e.strerror})") from e

    def _read(self) -> dict[str, KnownUser]:
        try:
            told = json.loads(self.path.read_text(encoding="utf-8"))
            users = {name: KnownUser(name, one["role"], one["mark"]) for name, one in told.items()}
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as e:
            raise InputError(self.path, "is no file of users", REMEDY) from e
        if not all(
            NAME.fullmatch(n) and u.role in ROLES and isinstance(u.mark, str) for n, u in users.items()
        ):
            raise InputError(self.path, "is no file of users", REMEDY)
        return users


def _mark(token: str) -> str:
    return hashlib.sha256(token.encode(errors="replace")).hexdigest()
