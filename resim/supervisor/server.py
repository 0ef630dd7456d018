"""Serves the pages: the socket, the address with the token, the browser."""

from __future__ import annotations

import asyncio
import ipaddress
import os
import socket
import ssl
import threading
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from urllib.parse import urlsplit

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from resim.core.errors import InputError
from resim.results.audit import AUDIT
from resim.results.catalog import Catalog
from resim.results.scanning import add_roots
from resim.supervisor.access import Access, kept_key
from resim.supervisor.app import make_app
from resim.supervisor.forms import JobForm
from resim.supervisor.guard import Door
from resim.supervisor.parts import Supervisor, SupervisorSettings
from resim.supervisor.users import USERS, Role, Users

Ready = Callable[[dict[Role, str], Path], None]
MOST_CONNECTIONS = 300
SLOWEST = 10.0
"""s within which a connection has to ask for something: those that only hold a place lose it."""
OPENED = "open.html"
"""File that sends a browser to the address: no other user sees the token in the list of processes."""


@dataclass(frozen=True)
class ServeOptions:
    """How to serve.

    folders: registered ones. host, port: where to listen. tasks: folder of logs and results. jobs: tasks at once.
    remote: under which address other machines may reach it, such as https://resim.example.org; "" where they may not.
    certificate: file of TLS, with its key; None where a proxy does that, or nobody else comes. proxy: address of that
    proxy, whose word is taken for whom it asks for; "" for none. note: what the first page says while tasks
    are unfinished.
    """

    folders: tuple[Path, ...]
    host: str
    port: int
    tasks: Path
    jobs: int = 1
    remote: str = ""
    certificate: Path | None = None
    proxy: str = ""
    note: str = ""


def check_options(options: ServeOptions) -> None:
    """Refuse what would let others in unseen. Raises InputError."""
    local = _is_loopback(options.host)
    if not local and not options.remote:
        problem = f"{options.host!r} can be reached from other machines, and who gets in may run code here"
        raise InputError(
            "--host", problem, "Keep 127.0.0.1, or read docs/guides/supervisor.md on --allow-remote."
        )
    if options.remote:
        told = urlsplit(options.remote)
        if told.scheme != "https" or not told.netloc or told.path not in ("", "/") or "@" in told.netloc:
            problem = f"{options.remote!r} is not the https:// address under which browsers reach it"
            raise InputError("--allow-remote", problem, "Give one such as https://resim.example.org.")
    if options.proxy:
        try:
            ipaddress.ip_address(options.proxy)
        except ValueError:
            raise InputError(
                "--proxy", f"{options.proxy!r} is no IP address", "Give one such as 127.0.0.1."
            ) from None
        if not options.remote:
            raise InputError("--proxy", "has no effect without --allow-remote", "Give both, or neither.")
    if options.certificate is not None:
        try:
            ssl.create_default_context(ssl.Purpose.CLIENT_AUTH).load_cert_chain(options.certificate)
        except OSError as e:  # of which those of TLS are
            problem = f"cannot be used ({e.strerror or e})"
            raise InputError(
                options.certificate, problem, "Give a PEM file with the certificate and its key."
            ) from e


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def serve(
    options: ServeOptions,
    catalog: Catalog,
    forms: tuple[JobForm, ...],
    data: Path,
    ready: Ready,
) -> None:
    """Serve until somebody ends it. Tasks that run go on: the next server finds them.

    data: folder of the key. ready: hears the addresses with their tokens, by role, and of a page that leads to the
    first, once somebody may come. Raises InputError for what cannot be used.
    """
    check_options(options)
    for folder in options.folders:
        if not folder.is_dir():
            raise InputError(folder, "is no folder", "Register folders with recordings, builds, suites.")
    with _bound(options.host, options.port) as listening:
        port = listening.getsockname()[1]
        door = _door(options, port)
        users = Users(data / USERS)
        if options.remote and not users.all():
            problem = "lets others in, each with a token of their own, and there are no users"
            raise InputError("--allow-remote", problem, "First: resim users add NAME --role administer")
        access = Access(
            kept_key(data / "serve.key"), port, users, users_only=bool(options.remote), secure=door.secure
        )
        tasks = Path(os.path.realpath(options.tasks))
        tasks.mkdir(parents=True, exist_ok=True)
        audit = data / AUDIT
        parts = SupervisorSettings(catalog, forms, tasks, access, door, audit, options.jobs, options.note)
        supervisor = Supervisor(parts)
        add_roots(catalog, options.folders)  # a catalog that cannot be used is told of now
        config = uvicorn.Config(
            make_app(supervisor), log_level="warning", access_log=False, server_header=False, proxy_headers=False,
            limit_concurrency=MOST_CONNECTIONS, http=Impatient,
            timeout_keep_alive=10, timeout_graceful_shutdown=3, ws="none",
            h11_max_incomplete_event_size=16_000, ssl_certfile=options.certificate,
        )  # fmt: skip
        addresses = {role: f"{door.origins[0]}/?token={token}" for role, token in access.tokens.items()}
        page = data / OPENED
        _write_page(page, addresses.get("administer", door.origins[0]))
        try:
            ready(addresses, page)
            _Server(config, supervisor.changes.stop).run(sockets=[listening])
        finally:
            page.unlink(missing_ok=True)


class Impatient(H11Protocol):
    """A connection that is closed where no request comes, or only drips."""

    _last: object = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait."""
        super().connection_made(transport)
        self.loop.call_later(SLOWEST, self._look)

    def _look(self) -> None:
        """Close it where no request was begun since the last look, and none is answered."""
        if self.transport.is_closing():
            return
        answered = self.cycle is None or self.cycle.response_complete
        if answered and self.cycle is self._last:
            self.transport.abort()
            return
        self._last = self.cycle
        self.loop.call_later(SLOWEST, self._look)


class _Server(uvicorn.Server):
    """A server that ends its streams when it is asked to end: it waits for them."""

    def __init__(self, config: uvicorn.Config, ending: Callable[[], None]) -> None:
        super().__init__(config)
        self._ending = ending

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Hear of a signal."""
        self._ending()
        super().handle_exit(sig, frame)


def open_browser(page: Path) -> None:
    """Open a page in the user's browser, in a while and without waiting for it."""
    timer = threading.Timer(0.8, webbrowser.open, [page.as_uri()])
    timer.daemon = True
    timer.start()


def _bound(host: str, port: int) -> socket.socket:
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        listening = socket.create_server((host, port), family=family)
        # asyncio does this for sockets of its own alone; without it each answer waits 40 ms for the client's
        # acknowledgement of its headers
        listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return listening
    except (OSError, OverflowError) as e:
        reason = os.strerror(number) if (number := getattr(e, "errno", None)) else str(e)
        raise InputError(f"{host}:{port}", f"cannot be listened on ({reason})", "Give another --port.") from e


def _door(options: ServeOptions, port: int) -> Door:
    if options.remote:
        return Door((options.remote.rstrip("/"),), secure=True, proxy=options.proxy)
    scheme = "http" if options.certificate is None else "https"
    given = f"[{options.host}]" if ":" in options.host else options.host
    # the first one is printed: as localhost browsers ask ::1 first, where somebody else may listen
    names = dict.fromkeys((*([] if given == "localhost" else [given]), "127.0.0.1", "localhost"))
    return Door(tuple(f"{scheme}://{name}:{port}" for name in names), secure=scheme == "https")


def _write_page(page: Path, address: str) -> None:
    """Write the page that leads to the address, for this user alone."""
    page.unlink(missing_ok=True)
    file = os.open(page, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(file, "w", encoding="utf-8") as out:
        out.write(
            f'<!DOCTYPE html><title>resim</title><meta http-equiv="refresh" content="0; url={address}">\n'
        )
