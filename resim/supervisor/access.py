"""Who may come in: a token in the address, then a cookie below an address of the session's own; seals of forms and of
pages that were written before."""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
import time
from dataclasses import dataclass
from pathlib import Path

from resim.core.errors import InputError
from resim.supervisor.users import Role, Users

LIFE = 12 * 3600
"""s that a cookie, or the address of a page, is good for."""
KEY_BYTES = 32
HOME_DIGITS = 32
"""Hexadecimal digits of the first part of the addresses of a session."""


OWNER = ""
"""Name of who comes by an address that the server printed."""


@dataclass(frozen=True)
class Visitor:
    """Somebody who was let in. name: of a user, OWNER for who started the server or was given its address."""

    name: str
    role: Role

    @property
    def may_change(self) -> bool:
        """Whether more than looking is allowed."""
        return self.role != "look"


class Access:
    """Tokens, cookies and seals of one server. All comparisons take the same time whatever is given.

    Attributes:
        tokens: What the addresses have that are shown at the start, by the role that each gives; none where only users
            may come in.
        cookie: Name of the cookie, another one for each port: browsers keep one jar for all ports of a host.
    """

    def __init__(
        self, key: bytes, port: int, users: Users, *, users_only: bool = False, secure: bool = False
    ) -> None:
        """key: of the cookies and seals; who keeps it lets those in again who were in before. secure: whether cookies
        go by TLS alone.
        """
        self._key, self._users = key, users
        shown: tuple[Role, ...] = () if users_only else ("administer", "look")
        self.tokens: dict[Role, str] = {role: secrets.token_urlsafe(24) for role in shown}
        self.cookie = f"{'__Secure-' if secure else ''}resim_{port}"

    def visitor(self, token: str) -> Visitor | None:
        """Give who comes with a token, of this server or of a user; None for any other text."""
        given = token.encode(errors="replace")
        same = [role for role, own in self.tokens.items() if hmac.compare_digest(given, own.encode())]
        if same:
            return Visitor(OWNER, same[0])
        user = self._users.of_token(token)
        return None if user is None else Visitor(user.name, user.role)

    def new_session(self, visitor: Visitor) -> str:
        """Give the value of a new cookie."""
        known = None if visitor.name == OWNER else self._users.all().get(visitor.name)
        mark = "" if known is None else known.mark
        told = f"{int(time.time()) + LIFE}.{visitor.role}.{visitor.name}.{mark}.{secrets.token_hex(8)}"
        return f"{told}.{self._seal(self.cookie, told)}"

    def home(self, session: str) -> str:
        """Give with what the path of each address of a session begins.

        A browser sends a cookie to all ports of a host, but below its path alone, and who listens on another port
        cannot guess this one.
        """
        return f"/{self._seal('home', session)[:HOME_DIGITS]}"

    def is_home(self, session: str, given: str) -> bool:
        """Say whether an address is one of this session."""
        return hmac.compare_digest(given.encode(errors="replace"), self.home(session).encode())

    def session(self, value: str) -> Visitor | None:
        """Give whose a cookie of this key is that is still good; None for any other text.

        A user has the role that is his now; without him, or with another token of his, it is good no more.
        """
        told, _, seal = value.rpartition(".")
        good = hmac.compare_digest(seal.encode(errors="replace"), self._seal(self.cookie, told).encode())
        parts = told.split(".")
        if not good or len(parts) != 5 or not _is_ahead(parts[0]):
            return None
        role, name, mark = parts[1], parts[2], parts[3]
        if name == OWNER:
            shown = next((r for r in self.tokens if r == role), None)
            return None if shown is None else Visitor(OWNER, shown)
        user = self._users.all().get(name)
        return Visitor(name, user.role) if user is not None and hmac.compare_digest(user.mark, mark) else None

    def form_seal(self, session: str) -> str:
        """Give what forms of a session hold, so that no page of somebody else can send one."""
        return self._seal("form", session)

    def is_form_seal(self, session: str, given: str) -> bool:
        """Say whether a form is one of this session."""
        return hmac.compare_digest(given.encode(), self.form_seal(session).encode())

    def page_seal(self, name: str, visitor: Visitor) -> str:
        """Give the part of an address under which the pages of a result are shown.

        They are shown without the cookie: they are documents from a folder, and must not act for who looks at them.
        Of a user who is removed they are good no more.
        """
        until = int(time.time()) // 3600 * 3600 + LIFE + 3600  # the same one for an hour
        return f"{until}.{visitor.name}.{self._page_seal(str(until), visitor.name, name)}"

    def is_page_seal(self, name: str, given: str) -> bool:
        """Say whether an address is of the pages of this result, and still good."""
        until, _, rest = given.partition(".")
        user, _, seal = rest.partition(".")
        good = hmac.compare_digest(seal.encode(errors="replace"), self._page_seal(until, user, name).encode())
        return (
            good and _is_ahead(until) and (user in self._users.all() or (user == OWNER and bool(self.tokens)))
        )

    def _page_seal(self, until: str, user: str, name: str) -> str:
        known = self._users.all().get(user) if user != OWNER else None
        return self._seal("page", f"{until}.{user}.{'' if known is None else known.mark}.{name}")

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
