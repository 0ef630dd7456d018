"""What stands before all pages: hosts, origins, tokens, cookies, forms and limits are looked at here, and nowhere else.

A page that a request reaches may rely on it: it comes from somebody who was let in, and a form from a page of ours.
"""

from __future__ import annotations

import asyncio
import ipaddress
import re
from collections.abc import Callable
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl

from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from resim.core.errors import ResimError
from resim.supervisor.access import HOME_DIGITS, LIFE, Access, Visitor
from resim.supervisor.limits import RateLimit

LARGEST_BODY = 64_000
"""Bytes of a form."""
MOST_FIELDS = 1_000
SLOWEST = 10.0
"""s within which a form has to be there."""
LONGEST_ADDRESS = 4_000
PAGES, STATIC = "/pages/", "/static/"
"""Addresses that need no cookie: documents under a sealed address, and what all pages look like."""
HOME = re.compile(rf"(/[0-9a-f]{{{HOME_DIGITS}}})(/.*)", re.DOTALL)
"""An address of a session: with what all of these begin, and the rest."""
OWN_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
DOCUMENT_POLICY = "sandbox allow-scripts allow-popups allow-downloads; frame-ancestors 'none'"
"""Of documents from folders, beside the policy that each has itself: their scripts run, but in an origin of their own,
which gets no cookie and sends no form."""
ALWAYS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "same-origin",  # under no-referrer a browser does not say where a form comes from
    "cross-origin-opener-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
}


ENTERED = (
    '<!DOCTYPE html><html lang="en"><title>resim</title><link rel="icon" href="data:,">'
    '<meta http-equiv="refresh" content="0; url={home}/">'
    '<a href="{home}/">To the dashboard</a></html>\n'
)


@dataclass(frozen=True)
class Door:
    """Under which addresses a server is reached. origins: such as http://127.0.0.1:8765. secure: by TLS. proxy: address
    of the one proxy that is believed when it says whom it asks for; "" for none."""

    origins: tuple[str, ...]
    secure: bool = False
    proxy: str = ""

    @property
    def hosts(self) -> tuple[str, ...]:
        """What a browser says as Host."""
        return tuple(origin.partition("://")[2] for origin in self.origins)


def client_of(scope: Scope, headers: Headers, proxy: str) -> str:
    """Give the address that a request comes from: behind the stated proxy the one that this proxy saw.

    That is the last one in X-Forwarded-For: those before it are what the client said itself.
    """
    near = str((scope.get("client") or ("?",))[0])
    if not proxy or near != proxy:
        return near
    last = ",".join(headers.getlist("x-forwarded-for")).rpartition(",")[2].strip()
    try:
        return str(ipaddress.ip_address(last))
    except ValueError:
        return near


class Guard:
    """ASGI middleware that lets nothing by that is not right."""

    def __init__(
        self, app: ASGIApp, *, access: Access, door: Door, refuse: Callable[[int, str], Response]
    ) -> None:
        """refuse: gives the page of a status and a reason."""
        self._app, self._access, self._door, self._refuse = app, access, door, refuse
        self._rate, self._tries = RateLimit(100.0, 400.0), RateLimit(0.2, 10.0)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            await send({"type": "websocket.close", "code": 1008})
            return
        headers = Headers(scope=scope)
        try:
            refused = self._look(scope, headers)
        except ResimError as e:  # of the file of users
            refused = self._refuse(500, str(e))
        if refused is None and scope["method"] == "POST":
            refused = await self._read_form(scope, headers, receive)
        await (refused or self._app)(scope, receive, self._with_headers(scope, send))

    def _look(self, scope: Scope, headers: Headers) -> Response | None:
        """The answer to what goes no further."""
        client, method = client_of(scope, headers, self._door.proxy), scope["method"]
        state = scope.setdefault("state", {})
        state.update(client=client, home="")
        if len(headers.getlist("host")) != 1 or headers["host"] not in self._door.hosts:
            return PlainTextResponse("This server has another name.\n", 421)
        if (found := HOME.fullmatch(scope["path"])) is not None:
            state["home"], scope["path"] = found.groups()
        is_foreign = _is_foreign(headers, method)
        state.update(self._session(headers, state["home"]))
        who = f"{'foreign' if is_foreign else state.get('visitor')} {client}"  # others use up nothing of a visitor's
        if not self._rate.allows(who):
            return PlainTextResponse("Too many requests.\n", 429, {"retry-after": "5"})
        if method not in ("GET", "HEAD", "POST"):
            return PlainTextResponse("Not allowed.\n", 405, {"allow": "GET, HEAD, POST"})
        raw = scope.get("raw_path", b"") + b"?" + scope.get("query_string", b"")
        if len(raw) > LONGEST_ADDRESS:
            return PlainTextResponse("The address is too long.\n", 414)
        if b"%00" in raw or b"\0" in raw:
            return self._refuse(400, "An address has no NUL bytes.")
        if any(c in scope["path"] for c in "\\\0\r\n") or any(p == ".." for p in scope["path"].split("/")):
            return PlainTextResponse("There is no such page.\n", 404)
        if not state["home"] and scope["path"].startswith((STATIC, PAGES)):
            return PlainTextResponse("Not allowed.\n", 405) if method == "POST" else None
        if scope["path"].startswith(PAGES):  # a document must not read the address of a session as its own
            return PlainTextResponse("There is no such page.\n", 404)
        if is_foreign:
            return self._refuse(403, "This request came from another site.")
        return self._let_in(scope, client)

    def _session(self, headers: Headers, home: str) -> dict[str, object]:
        """The session of a cookie and its visitor; nothing where it is not good, or not sent to an address of its own.

        A cookie alone is not enough: who got hold of it somewhere does not know its address.
        """
        session = _cookie(headers, self._access.cookie)
        if session is None or not self._access.is_home(session, home):
            return {}
        visitor = self._access.session(session)
        return {} if visitor is None else {"session": session, "visitor": visitor}

    def _let_in(self, scope: Scope, client: str) -> Response | None:
        """Look at token and cookie."""
        query, state = QueryParams(scope.get("query_string", b"")), scope["state"]
        if scope["path"] == "/" and "token" in query and scope["method"] == "GET":
            if (entering := self._access.visitor(query["token"])) is not None:
                return self._entered(entering)  # however many others tried before
            if not self._tries.allows(client):
                return PlainTextResponse("Too many tries.\n", 429, {"retry-after": "60"})
            return self._refuse(401, "This token is not the one of this server.")
        if "visitor" not in state:
            return self._refuse(
                401, "Open the address with your token, or the one that `resim serve` printed."
            )
        if not state["visitor"].may_change and scope["method"] == "POST":
            return self._refuse(403, "The address that you came by lets you look only.")
        return None

    def _entered(self, visitor: Visitor) -> Response:
        """Put a cookie into the browser, and send it to the address of its session.

        By a page, not by a redirect: after a link in another program, a redirect gets no strict cookie.
        """
        session = self._access.new_session(visitor)
        home = self._access.home(session)
        answer = HTMLResponse(ENTERED.format(home=home), headers={"referrer-policy": "no-referrer"})
        answer.set_cookie(
            self._access.cookie, session, max_age=LIFE, httponly=True, samesite="strict",
            secure=self._door.secure, path=f"{home}/",
        )  # fmt: skip
        return answer

    async def _read_form(self, scope: Scope, headers: Headers, receive: Receive) -> Response | None:
        """Look where a form comes from, and read it."""
        if headers.get("origin") not in self._door.origins:
            return self._refuse(403, "This form came from another site.")
        if headers.get("content-type", "").partition(";")[0].strip() != "application/x-www-form-urlencoded":
            return PlainTextResponse("Forms are expected.\n", 415)
        told = headers.get("content-length", "0")
        if not told.isdigit() or int(told) > LARGEST_BODY:
            return PlainTextResponse("The form is too large.\n", 413)
        try:
            body = await asyncio.wait_for(_body(receive), SLOWEST)
            pairs = parse_qsl(body.decode("utf-8"), keep_blank_values=True, max_num_fields=MOST_FIELDS)
        except TimeoutError:
            return PlainTextResponse("The form came too slowly.\n", 408)
        except OverflowError:
            return PlainTextResponse("The form is too large.\n", 413)
        except ValueError:
            return PlainTextResponse("This is no form.\n", 400)
        if any("\0" in text for pair in pairs for text in pair):
            return self._refuse(400, "A form has no NUL bytes.")
        seals = [value for name, value in pairs if name == "seal"]
        if len(seals) != 1 or not self._access.is_form_seal(scope["state"]["session"], seals[0]):
            return self._refuse(
                403, "This form is of another session. Go back, reload the page, and send it again."
            )
        scope["state"]["form"] = [(name, value) for name, value in pairs if name != "seal"]
        return None

    def _with_headers(self, scope: Scope, send: Send) -> Send:
        """Send, with the headers that every answer has."""

        async def told(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in ALWAYS.items():
                    headers.setdefault(name, value)
                headers.setdefault("content-security-policy", OWN_POLICY)
                headers.setdefault("cross-origin-resource-policy", "same-origin")
                headers.setdefault("cache-control", "no-store")
            await send(message)

        return told


def _is_foreign(headers: Headers, method: str) -> bool:
    """Whether the browser says that a page of somebody else asks: another port of this host is somebody else.

    A link that is followed there is none, but what opens in a frame, or before anybody asked for it, is.
    """
    site = headers.get("sec-fetch-site")
    followed = method in ("GET", "HEAD") and headers.get("sec-fetch-mode") == "navigate"
    shown = headers.get("sec-fetch-dest", "document") == "document" and "sec-purpose" not in headers
    return site in ("cross-site", "same-site") and not (followed and shown)


def _cookie(headers: Headers, name: str) -> str | None:
    """The value of a cookie; None where it is not there, or there twice."""
    try:
        found = [SimpleCookie(told).get(name) for told in headers.getlist("cookie")]
    except CookieError:
        return None
    values = [one.value for one in found if one is not None]
    return values[0] if len(values) == 1 else None


async def _body(receive: Receive) -> bytes:
    """Read a body. Raises OverflowError for one that is too large, ValueError where it breaks off."""
    parts, size = [], 0
    while True:
        message = await receive()
        if message["type"] != "http.request":
            raise ValueError("the client is gone")
        parts.append(message.get("body", b""))
        size += len(parts[-1])
        if size > LARGEST_BODY:
            raise OverflowError
        if not message.get("more_body"):
            return b"".join(parts)
