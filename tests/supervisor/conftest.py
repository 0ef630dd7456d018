"""A Supervisor over a catalog of its own, called in process, and one as a process of its own."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from supervised import at_home

ROOT = Path(__file__).parents[2]
KEY = b"k" * 32
ORIGIN = "http://127.0.0.1:8765"

pytest.importorskip("starlette", reason="the extra serve is not installed")
pytest.importorskip("httpx2", reason="httpx2 is not installed")


@pytest.fixture
def catalog(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Path of a catalog that nobody else uses, which resim takes for the user's."""
    path = str(tmp_path / "catalog.sqlite")
    monkeypatch.setenv("RESIM_CATALOG", path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return path


@pytest.fixture(scope="session")
def scanned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A catalog in which some of what ships is registered."""
    from resim.results.catalog import Catalog
    from resim.results.scanning import scan

    path = tmp_path_factory.mktemp("scanned") / "catalog.sqlite"
    scenarios = ("cut_in_brake", "overtake", "rear_end", "criteria", "suites", "sweeps")
    scan(Catalog(str(path)), [*(ROOT / "scenarios" / name for name in scenarios), ROOT / "adfunc"])
    return path


@pytest.fixture
def supervisor(catalog: str, scanned: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A Supervisor whose worker does nothing, and that sees at once what tests change."""
    monkeypatch.setattr("resim.supervisor.parts.NOTICED", -1.0)
    from resim.cli.job_forms import job_forms
    from resim.results.catalog import Catalog
    from resim.supervisor.access import Access
    from resim.supervisor.guard import Door
    from resim.supervisor.parts import Supervisor, SupervisorSettings
    from resim.supervisor.users import Users

    shutil.copy(scanned, catalog)
    door = Door((ORIGIN, "http://localhost:8765"))
    settings = SupervisorSettings(
        Catalog(catalog),
        job_forms(),
        tmp_path / "tasks",
        Access(KEY, 8765, Users(tmp_path / "users.json")),
        door,
        tmp_path / "audit.jsonl",
    )
    return Supervisor(settings)


@pytest.fixture
def client(supervisor: Any) -> Any:
    """A browser that was not let in yet; no thread of the server runs."""
    from starlette.testclient import TestClient

    from resim.supervisor.app import make_app

    return at_home(TestClient(make_app(supervisor), base_url=ORIGIN, follow_redirects=False), ORIGIN)


@pytest.fixture
def user(supervisor: Any, client: Any) -> Any:
    """A browser that was let in."""
    assert client.get("/", params={"token": supervisor.access.tokens["administer"]}).status_code == 200
    return client


@pytest.fixture
def seal(supervisor: Any, user: Any) -> str:
    """What the forms of this user hold."""
    sealed: str = supervisor.access.form_seal(user.cookies["resim_8765"])
    return sealed


Started = tuple[subprocess.Popen[str], str, str]


@pytest.fixture
def served(catalog: str, tmp_path: Path) -> Iterator[Callable[..., Started]]:
    """Start `resim serve` as a process of its own; gives it, its address and its token."""
    processes: list[subprocess.Popen[str]] = []

    def start(*options: object) -> Started:
        command = [sys.executable, "-m", "resim", "serve", "--no-open", "--port", "0", *map(str, options)]
        command += ["--tasks", str(tmp_path / "tasks"), str(tmp_path / "files")]
        (tmp_path / "files").mkdir(exist_ok=True)
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
        processes.append(process)
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.fullmatch(r"(http://127\.0\.0\.1:\d+)/\?token=(\S+)\n", line)
        assert found, line
        return process, found[1], found[2]

    yield start
    for process in processes:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()
    for begun in (tmp_path / "tasks").glob("*/begun.json"):  # what was left to run
        from resim.supervisor.processes import is_alive, number_of, read_whole

        if is_alive(name := str(read_whole(begun).get("process"))):
            with suppress(OSError):
                os.killpg(number_of(name), signal.SIGKILL)
