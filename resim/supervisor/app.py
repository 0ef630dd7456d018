"""The pages and what they are made of: routes, templates, errors."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.applications import Starlette
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    JSONResponse,
    RedirectResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Route
from starlette.types import ASGIApp

from resim import __version__
from resim.core.errors import InputError, ResimError
from resim.core.watched import LOG
from resim.results.tones import tone
from resim.supervisor import actions, words
from resim.supervisor.events import stream
from resim.supervisor.forms import FormError
from resim.supervisor.guard import DOCUMENT_POLICY, Guard
from resim.supervisor.limits import StreamLimit
from resim.supervisor.live import roads_around
from resim.supervisor.packing import packed_chain
from resim.supervisor.parts import Supervisor
from resim.supervisor.views import KEPT, PAGES
from resim.supervisor.views.common import MissingError, document_of, task_of

PART = 1_000_000
"""Bytes of a file without a name that are sent at once."""
LATER = 5
"""By how much pages come after tasks where there are not enough cores for both."""
STREAMS = StreamLimit(each=24, most=64)
_STATIC = {
    "page.css": ("resim.report", "page.css", "text/css"),
    "supervisor.css": ("resim.supervisor", "static/supervisor.css", "text/css"),
    "supervisor.js": ("resim.supervisor", "static/supervisor.js", "text/javascript"),
    "live.js": ("resim.supervisor", "static/live.js", "text/javascript"),
    "home.js": ("resim.supervisor", "static/home.js", "text/javascript"),
}
"""What all pages look like: the look of the reports, and what the Supervisor has besides."""
_LINK = re.compile(r'( (?:href|action|data-home)=")/(?!static/)')
"""Where a page leads to one of ours; quotes in values are escaped, and make none."""
_TITLES = {
    400: "This cannot be looked for",
    401: "Not let in",
    403: "Refused",
    404: "There is no such page",
    422: "This cannot be started",
}

Page = Callable[[Supervisor, Request], tuple[str, dict[str, Any]]]


@cache
def _templates() -> Environment:
    env = Environment(
        loader=PackageLoader("resim.supervisor"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, auto_reload=False,
    )  # fmt: skip
    env.filters.update(moment=words.moment, size=words.size, tone=tone, coded=words.coded)
    env.globals.update(span=words.span, age=words.age, static=_address, version=__version__)
    return env


def rendered(template: str, **values: Any) -> str:
    """Give the HTML of a page; every value is escaped."""
    return _templates().get_template(template).render(**values)


def refusal(status: int, why: str) -> Response:
    """Give the page of an error, for who is not in."""
    return HTMLResponse(_error(status, why), status)


def _error(status: int, why: str) -> str:
    title = _TITLES.get(status, "This did not work")
    return rendered("error.html", title=title, why=why, status=status)


def _at_home(request: Request, text: str, status: int = 200) -> Response:
    """A page whose links lead to addresses of the session."""
    return HTMLResponse(_LINK.sub(rf"\g<1>{request.state.home}/", text), status)


def _told(request: Request, status: int, why: str) -> Response:
    """The page of an error, for who is in."""
    return _at_home(request, _error(status, why), status)


def make_app(supervisor: Supervisor) -> ASGIApp:
    """Give the application: guarded, with all its pages. Its worker begins with it."""

    @asynccontextmanager
    async def life(app: Starlette) -> AsyncIterator[None]:
        supervisor.worker.start()
        os.nice(
            LATER
        )  # of this thread and those that it starts, not of tasks, which the worker starts: they come first
        supervisor.changes.start()
        yield
        supervisor.changes.stop()
        await run_in_threadpool(supervisor.worker.stop)

    routes = [
        Route("/static/{name}", _static, methods=["GET"]),
        Route("/events", _events(supervisor), methods=["GET"]),
        Route("/crate/{name}", _crate(supervisor), methods=["GET"]),
        Route("/live/{name}/roads", _roads(supervisor), methods=["GET"]),
        Route("/open/{kind}/{name}/{path:path}", _sealed(supervisor), methods=["GET"]),
        Route("/pages/{seal}/{kind}/{name}/{path:path}", _document(supervisor), methods=["GET"]),
        *(
            Route(path, _page(supervisor, page, path in KEPT), methods=["GET"])
            for path, page in PAGES.items()
        ),
        *(Route(path, _action(supervisor, act), methods=["POST"]) for path, act in actions.ACTIONS.items()),
    ]
    app = Starlette(
        routes=routes, lifespan=life,
        exception_handlers={HTTPException: _refused, ResimError: _failed, Exception: _broken},  # type: ignore[dict-item]
    )  # fmt: skip
    return Guard(app, access=supervisor.access, door=supervisor.settings.door, refuse=refusal)


def _refused(request: Request, e: HTTPException) -> Response:
    return _told(request, e.status_code, e.detail)


def _failed(request: Request, e: ResimError) -> Response:
    if isinstance(e, FormError):
        return _told(request, 422, str(e))
    return _told(request, 404 if isinstance(e, MissingError) else 500, str(e))


def _broken(request: Request, e: Exception) -> Response:
    why = f"There is an error in resim: {type(e).__name__}. The server's output has more."
    return _told(request, 500, why)


def _page(supervisor: Supervisor, page: Page, is_kept: bool = False) -> Callable[[Request], Response]:
    def shown(request: Request) -> Response:
        visitor, kept = request.state.visitor, supervisor.kept

        def made(seal: str) -> str:
            template, values = page(supervisor, request)
            told = {"seal": seal, "path": request.url.path, "query": "", "visitor": visitor}
            return rendered(template, fault=supervisor.worker.fault, **(told | values))

        seal = (
            supervisor.access.form_seal(request.state.session) if visitor.may_change else ""
        )  # forms are shown with it alone
        if not is_kept:
            return _at_home(request, made(seal))
        key = (visitor, request.url.path, request.url.query, supervisor.version())
        return _at_home(request, kept.page(key, lambda: made(seal and kept.mark)).replace(kept.mark, seal))

    return shown


def _action(
    supervisor: Supervisor, act: Callable[[Supervisor, Request], str]
) -> Callable[[Request], Response]:
    def done(request: Request) -> Response:
        note = partial(
            supervisor.audit.note,
            request.state.visitor.name,
            request.state.session,
            request.state.client,
            request.url.path,
            request.state.form,
        )
        note("asked")
        try:
            there = act(supervisor, request)
        except ResimError as e:
            note(f"refused: {e}")
            raise
        finally:
            supervisor.look_again()
        note(f"done: {there}")
        return RedirectResponse(request.state.home + there, 303)

    return done


def _static(request: Request) -> Response:
    """A file of the look, which a browser keeps: its address has the version of its content."""
    if (name := request.path_params["name"]) not in _STATIC:
        raise HTTPException(404, "There is no such file.")
    text, version = _look(name)
    is_kept = request.query_params.get("v") == version
    headers = {"cache-control": "public, max-age=31536000, immutable"} if is_kept else {}
    return Response(text, media_type=_STATIC[name][2], headers=headers)


@cache
def _look(name: str) -> tuple[str, str]:
    """The text of a file of the look, and the version of it."""
    package, path, _ = _STATIC[name]
    text = files(package).joinpath(path).read_text("utf-8")
    return text, hashlib.sha256(text.encode()).hexdigest()[:16]


def _address(name: str) -> str:
    return f"/static/{name}?v={_look(name)[1]}"


def _crate(supervisor: Supervisor) -> Callable[[Request], Response]:
    """Something with all that it came from, as a zip; for those who may run: builds' code is in it."""

    def sent(request: Request) -> Response:
        if not request.state.visitor.may_change:
            why = "A crate holds the code of builds: the address that you came by lets you look only."
            return _told(request, 403, why)
        found = supervisor.catalog.entries([request.path_params["name"][:40]])
        if not found:
            raise MissingError("There is no such thing.")
        try:
            file = packed_chain(found[0])
        except ResimError as e:
            return _told(request, 409, str(e))
        name = f"{found[0].kind}-{found[0].id}.crate.zip"
        headers = {
            "content-disposition": f'attachment; filename="{name}"',
            "content-length": str(os.fstat(file.fileno()).st_size),
        }
        parts = iter(lambda: file.read(PART), b"")
        return StreamingResponse(
            parts, media_type="application/zip", headers=headers, background=BackgroundTask(file.close)
        )

    return sent


def _roads(supervisor: Supervisor) -> Callable[[Request], Response]:
    def found(request: Request) -> Response:
        task = task_of(supervisor, request.path_params["name"])
        return JSONResponse(roads_around(Path(task.folder)))

    return found


def _sealed(supervisor: Supervisor) -> Callable[[Request], Response]:
    """Send a browser to a document, under an address that is good for a while and needs no cookie."""

    def found(request: Request) -> Response:
        kind, name, path = (request.path_params[k] for k in ("kind", "name", "path"))
        document_of(supervisor, kind, name, path)
        seal = supervisor.access.page_seal(f"{kind}/{name}", request.state.visitor)
        query = f"?{request.url.query}" if request.url.query else ""
        there = f"/pages/{seal}/{quote(f'{kind}/{name}/{path}')}{query}"
        # where a document could ask for it, it is not told of the session's address
        return RedirectResponse(there, 303, {"referrer-policy": "no-referrer"})

    return _missing(found)


def _document(supervisor: Supervisor) -> Callable[[Request], Response]:
    def found(request: Request) -> Response:
        kind, name, path = (request.path_params[k] for k in ("kind", "name", "path"))
        if not supervisor.access.is_page_seal(f"{kind}/{name}", request.path_params["seal"]):
            return refusal(403, "This address is no longer good. Open the page from its result again.")
        document = document_of(supervisor, kind, name, path)
        headers = {
            "content-security-policy": DOCUMENT_POLICY, "cross-origin-resource-policy": "cross-origin",
            "cross-origin-opener-policy": "unsafe-none",
            "referrer-policy": "no-referrer",
        }  # fmt: skip
        kept_as = None if document.is_shown else document.path.name
        return FileResponse(document.path, media_type=document.type, headers=headers, filename=kept_as)

    return _missing(found)


def _missing(page: Callable[[Request], Response]) -> Callable[[Request], Response]:
    """What is not there is no error of the server."""

    def found(request: Request) -> Response:
        try:
            return page(request)
        except InputError as e:
            raise MissingError(str(e)) from e

    return found


def _events(supervisor: Supervisor) -> Callable[[Request], Any]:
    async def opened(request: Request) -> Response:
        query, log, live = request.query_params, None, None
        if "task" in query:
            task = await run_in_threadpool(task_of, supervisor, query["task"])
            log = Path(task.folder) / LOG
        if "live" in query:
            task = await run_in_threadpool(task_of, supervisor, query["live"])
            live = Path(task.folder)
        told = request.headers.get("last-event-id", query.get("from", "0"))
        start = int(told) if told.isascii() and told.isdigit() and len(told) < 16 else 0
        session = request.state.session
        client = (
            request.state.visitor.name or request.state.client
        )  # who comes in again and again is one client
        if not STREAMS.takes(client):
            return refusal(429, "Too many pages are open. Close some of them.")

        def is_in() -> bool:
            with suppress(ResimError):
                return supervisor.access.session(session) is not None
            return False

        async def sent() -> AsyncIterator[bytes]:
            try:
                async for event in stream(supervisor, log, start, live, is_in):
                    yield event
            finally:
                STREAMS.leave(client)

        return StreamingResponse(sent(), media_type="text/event-stream", headers={"x-accel-buffering": "no"})

    return opened
