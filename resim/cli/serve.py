"""`resim serve`: what runs, what failed and what there is, in a browser."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import app, command
from resim.cli.terminal import add_to_json, say
from resim.core.errors import InputError

if TYPE_CHECKING:
    from resim.supervisor.access import Role

NEEDED = ("starlette", "uvicorn", "jinja2", "psutil")


Folders = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="FOLDER...",
        help="Folders whose recordings, builds, suites, ... may be read and given to jobs.",
    ),
]
Certificate = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Certificate with its key (PEM) for TLS; none behind a proxy that does TLS."
    ),
]


@command(app)
def serve(
    folders: Folders = None,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 for any that is free.")] = 8765,
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open a browser.")] = False,
    tasks: Annotated[
        Path | None,
        typer.Option(help="Folder for logs and results of tasks; default: tasks in the user's data folder."),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, max=1000, help="Tasks that run at once.")] = 1,
    allow_remote: Annotated[
        str,
        typer.Option(
            metavar="URL",
            help="Let other machines in by this https address; who has the token may run code on this one.",
        ),
    ] = "",
    certificate: Certificate = None,
) -> None:
    """See and steer what runs, failed and came out, in the browser.

    Prints an address with a token, once, which lets a browser in, and another one for those who may look only. Tasks
    are done one after the other, or several at once; a server that is ended, however that was, leaves running ones
    alone, and the next one finds them.
    """
    refuse_without_extra()
    from resim.cli.job_forms import job_forms
    from resim.results.catalog import user_catalog
    from resim.results.database import VARIABLE, data_folder
    from resim.supervisor.server import ServeOptions, open_browser
    from resim.supervisor.server import serve as run

    data = data_folder()
    options = ServeOptions(
        tuple(folders or ()), host, port, tasks or data / "tasks", jobs, allow_remote, certificate
    )
    if (catalog := user_catalog()) is None:
        raise InputError(VARIABLE, "switches the catalog off", "Unset it, or name a file or database.")

    def ready(addresses: Mapping[Role, str], page: Path) -> None:
        add_to_json(address=addresses["run"], look=addresses["look"])
        say(addresses["run"])
        say(f"to look only: {addresses['look']}")
        sys.stdout.flush()
        if not no_open:
            open_browser(page)

    run(options, catalog, job_forms(), data, ready)


def refuse_without_extra() -> None:
    """Raise InputError where a package of the extra is missing."""
    lost = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if lost:
        remedy = "In resim's own folder: pip install '.[serve]'"
        raise InputError("resim serve", f"needs {', '.join(lost)}", remedy)
