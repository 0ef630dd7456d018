"""Who may come in: a token in the address, then a cookie; seals of forms and of pages that were written before."""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
import time
from pathlib import Path
from typing import Literal, get_args

from resim.core.errors import InputError

Role = Literal["run", "look"]
"""run: may do all; look: may see all, and change nothing."""
ROLES: tuple[Role, ...] = get_args(Role)
LIFE = 12 * 3600
"""s that a cookie, or the address of a page, is good for."""
KEY_BYTES = 32


class Access:
    """Tokens, cookies and seals of one server. All comparisons take the same time whatever is given.

    Attributes:
        tokens: What the addresses have that are shown at the start, by the role that each gives.
        cookie: Name of the cookie, another one for each port: browsers keep one jar for all ports of a host.
    """

    def __init__(self, key: bytes, port: int) -> None:
        """key: of the cookies and seals; who keeps it lets those in again who were in before."""
        self._key = key
        self.tokens: dict[Role, str] = {role: secrets.token_urlsafe(24) for role in ROLES}
        self.cookie = f"resim_{port}"

    def token_role(self, given: str) -> Role | None:
        """Give the role of a token of this server; None for any other text."""
        same = [hmac.compare_digest(given.encode(), self.tokens[role].encode()) for role in ROLES]
        return next((role for role, is_it in zip(ROLES, same, strict=True) if is_it), None)

    def new_session(self, role: Role) -> str:
        """Give the value of a new cookie."""
        told = f"{int(time.time()) + LIFE}.{role}.{secrets.token_hex(8)}"
        return f"{told}.{self._seal('session', told)}"

    def session_role(self, value: str) -> Role | None:
        """Give the role of a cookie of this key that is still good; None for any other text."""
        told, _, seal = value.rpartition(".")
        good = hmac.compare_digest(seal.encode(), self._seal("session", told).encode())
        until, _, rest = told.partition(".")
        return (
            next((r for r in ROLES if rest.startswith(f"{r}.")), None) if good and _is_ahead(until) else None
        )

    def form_seal(self, session: str) -> str:
        """Give what forms of a session hold, so that no page of somebody else can send one."""
        return self._seal("form", session)

    def is_form_seal(self, session: str, given: str) -> bool:
        """Say whether a form is one of this session."""
        return hmac.compare_digest(given.encode(), self.form_seal(session).encode())

    def page_seal(self, name: str) -> str:
        """Give the part of an address under which the pages of a result are shown.

        They are shown without the cookie: they are documents from a folder, and must not act for who looks at them.
        """
        until = int(time.time()) // 3600 * 3600 + LIFE + 3600  # the same one for an hour
        return f"{until}-{self._seal('page', f'{until}-{name}')}"

    def is_page_seal(self, name: str, given: str) -> bool:
        """Say whether an address is of the pages of this result, and still good."""
        until, _, seal = given.partition("-")
        return hmac.compare_digest(
            seal.encode(), self._seal("page", f"{until}-{name}").encode()
        ) and _is_ahead(until)

    def _seal(self, what: str, told: str) -> str:
        return hmac.new(self._key, f"{what}\n{told}".encode(), hashlib.sha256).hexdigest()


def _is_ahead(until: str) -> bool:
    """Whether a time [s since 1970] is still to come."""
    return until.isascii() and until.isdigit() and len(until) < 16 and int(until) > time.time()


def kept_key(path: Path) -> bytes:
    """Give the key in a file that the user alone may read; makes it where there is none.

    Raises InputError where it cannot be read or written, or others may read it.
    """
    remedy = "Remove it: a new one is made, and everybody opens the printed address again."
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            pass
        else:
            with os.fdopen(file, "wb") as out:
                out.write(secrets.token_bytes(KEY_BYTES))
        if path.stat().st_mode & 0o077:
            raise InputError(path, "may be read by other users", remedy)
        key = path.read_bytes()
    except OSError as e:
        raise InputError(path, f"cannot be used ({e.strerror})", remedy) from e
    if len(key) != KEY_BYTES:
        raise InputError(path, f"has {len(key)} bytes, expected {KEY_BYTES}", remedy)
    return key
