"""`resim serve`: what runs, what failed and what there is, in a browser."""

from __future__ import annotations

import importlib.util
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import app, command
from resim.cli.terminal import add_to_json, say
from resim.core.errors import InputError

if TYPE_CHECKING:
    from resim.supervisor.users import Role

DEMO_SUITE = """\
name = "demo"
criteria = "scenarios/criteria/highway.toml"

[[recording]]
folder = "scenarios/cut_in_brake"
"""
DEMO_NOTE = (
    "This lake fills while you look. On a machine that never ran resim, the first tasks compile it, which takes "
    "about a minute."
)
DEMO_JOBS = 4
"""Tasks of the demo at once: where one waits for what another one compiles, the next one has the core."""
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
            help="Let users on other machines in by this https address; who may run may run code on this one.",
        ),
    ] = "",
    certificate: Certificate = None,
    proxy: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="IP address of the proxy that does TLS: its X-Forwarded-For is believed, and nobody else's.",
        ),
    ] = "",
    demo: Annotated[
        bool, typer.Option("--demo", help="Show a lake of what ships, in a temporary folder, and fill it.")
    ] = False,
) -> None:
    """See and steer what runs, failed and came out, in the browser.

    Prints an address with a token, once, which lets a browser in, and another one for those who may look only. Tasks
    are done one after the other, or several at once; a server that is ended, however that was, leaves running ones
    alone, and the next one finds them.
    """
    refuse_without_extra()
    with _demo_lake() if demo else nullcontext() as example:
        given = (*(folders or ()), *([] if example is None else [example]))
        at = ServeAddress(host, port, allow_remote, certificate, proxy)
        work = TaskSettings(tasks, jobs)
        if demo:
            work = TaskSettings(tasks, max(jobs, DEMO_JOBS), DEMO_NOTE)
        _serve(given, at, work, no_open)


@dataclass(frozen=True)
class ServeAddress:
    """Where to listen, and how others come: as `ServeOptions`."""

    host: str
    port: int
    remote: str
    certificate: Path | None
    proxy: str


@dataclass(frozen=True)
class TaskSettings:
    """Where tasks are done, how many at once, and what the first page says of them: as `ServeOptions`."""

    folder: Path | None
    jobs: int
    note: str = ""


def _serve(folders: tuple[Path, ...], at: ServeAddress, work: TaskSettings, no_open: bool) -> None:
    from resim.cli.job_forms import job_forms
    from resim.results.catalog import user_catalog
    from resim.results.database import VARIABLE, data_folder
    from resim.supervisor.server import ServeOptions, open_browser
    from resim.supervisor.server import serve as run

    data = data_folder()
    options = ServeOptions(
        folders,
        at.host,
        at.port,
        work.folder or data / "tasks",
        work.jobs,
        at.remote,
        at.certificate,
        at.proxy,
        work.note,
    )
    if (catalog := user_catalog()) is None:
        raise InputError(VARIABLE, "switches the catalog off", "Unset it, or name a file or database.")

    def ready(addresses: Mapping[Role, str], page: Path) -> None:
        add_to_json(address=addresses.get("administer", at.remote), look=addresses.get("look", ""))
        if addresses:
            say(addresses["administer"])
            say(f"to look only: {addresses['look']}")
        else:
            say(f"{at.remote.rstrip('/')}/?token=... with the token of each user")
        sys.stdout.flush()
        if not no_open:
            open_browser(page)

    run(options, catalog, job_forms(), data, ready)


@contextmanager
def _demo_lake() -> Iterator[Path]:
    """A folder with what ships, a catalog and data folder of its own, and tasks that the server begins with."""
    from resim.cli.demo import write_example
    from resim.results.catalog import Catalog
    from resim.results.database import VARIABLE, data_folder
    from resim.results.queue import TaskQueue, new_id

    with tempfile.TemporaryDirectory(prefix="resim-demo-", ignore_cleanup_errors=True) as folder:
        whole = Path(folder)
        example = whole / "example"
        write_example(example)
        (example / "two.toml").write_text(DEMO_SUITE, "utf-8")
        os.environ |= {"XDG_DATA_HOME": str(whole / "data"), VARIABLE: str(whole / "catalog.sqlite")}
        queue, drive = (
            TaskQueue(Catalog(str(whole / "catalog.sqlite"))),
            example / "scenarios" / "cut_in_brake",
        )
        build = f"--build={example / 'adfunc' / 'builds' / 'highway_pilot-1.0.toml'}"
        criteria = f"--criteria={example / 'scenarios' / 'criteria' / 'highway.toml'}"
        for job, called, *words in (
            ("assess", drive.name, "drive", drive, criteria),
            ("run", drive.name, drive, build, criteria),
            ("mine", drive.name, drive),
            ("verify", "two", example / "two.toml", build),
        ):
            name = new_id()
            task = data_folder() / "tasks" / name
            queue.add(name, job, [job, *map(str, words), f"--out={task / called}"], str(task))
        yield example


def refuse_without_extra() -> None:
    """Raise InputError where a package of the extra is missing."""
    lost = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if lost:
        remedy = "In resim's own folder: pip install '.[serve]'"
        raise InputError("resim serve", f"needs {', '.join(lost)}", remedy)
