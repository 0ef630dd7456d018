"""Databases for the catalog: SQLite, and a PostgreSQL server that is started for the tests alone."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from calling import called

ROOT = Path(__file__).parents[2]
SERVER_USER = "nobody"
"""Who runs the server where the tests run as root, which PostgreSQL refuses to."""


def _programs() -> Path | None:
    """The folder with initdb and pg_ctl: on the path, or where Debian and Red Hat have it."""
    if (found := shutil.which("initdb")) is not None:
        return Path(found).resolve().parent
    places = [*Path("/usr/lib/postgresql").glob("*/bin"), *Path("/usr").glob("pgsql-*/bin")]
    return next((folder for folder in sorted(places, reverse=True) if (folder / "initdb").is_file()), None)


@pytest.fixture(scope="session")
def postgresql() -> Iterator[str]:
    """URL of a server of its own, on a socket in a folder of its own; skips where PostgreSQL is not installed."""
    programs = _programs()
    if programs is None:
        pytest.skip("PostgreSQL is not installed: no initdb on the path or in /usr/lib/postgresql/*/bin")
    root = os.geteuid() == 0
    with tempfile.TemporaryDirectory(prefix="pg-", dir="/tmp") as name:  # a socket's path is short
        folder = Path(name)
        if root:
            shutil.chown(folder, SERVER_USER)

        def call(program: str, *arguments: str) -> None:
            command = [str(programs / program), "-D", str(folder / "data"), *arguments]
            done = subprocess.run(
                command, user=SERVER_USER if root else None, extra_groups=[] if root else None, cwd=folder,
                capture_output=True, text=True, timeout=120,
            )  # fmt: skip
            assert done.returncode == 0, f"{program}: {done.stdout}{done.stderr}"

        call("initdb", "--username=resim", "--auth=trust", "--no-sync", "--encoding=UTF8", "--locale=C")
        options = f"-k {folder} -c listen_addresses='' -c fsync=off"
        call("pg_ctl", "start", "-w", "-l", str(folder / "log"), "-o", options)
        try:
            yield f"postgresql://resim@/postgres?host={folder}"
        finally:
            call("pg_ctl", "stop", "-m", "immediate")


@pytest.fixture(params=["SQLite", "PostgreSQL"])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A path or URL of a database with no catalog in it."""
    if request.param == "SQLite":
        return str(tmp_path / "data" / "catalog.sqlite")
    import psycopg

    server = str(request.getfixturevalue("postgresql"))
    name = f"catalog_{abs(hash(tmp_path))}"
    with psycopg.connect(server, autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}".encode())
    return server.replace("/postgres?", f"/{name}?")


SUITE = """
name = "two"
criteria = "{root}/scenarios/criteria/highway.toml"
reports = 1

[[recording]]
folder = "{root}/scenarios/cut_in_brake"

[[recording]]
folder = "{root}/scenarios/overtake"
"""

SWEEP = """
name = "late"
criteria = "{root}/scenarios/criteria/highway.toml"
build = ["{root}/adfunc/builds/highway_pilot-1.0.toml"]
perception = "{root}/adfunc/perception/proving_ground.json"
seeds = 1

[[recording]]
folder = "{root}/scenarios/cut_in_brake"

[[parameter]]
name = "perception.latency.speed"
low = 0.0
high = 1.2
steps = 2
"""


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with results of each kind, as the commands write them: run, assessment, verification, sweep."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "two.toml").write_text(SUITE.format(root=ROOT))
    (folder / "late.toml").write_text(SWEEP.format(root=ROOT))
    pilot, criteria = ROOT / "adfunc/builds/highway_pilot-1.0.toml", ROOT / "scenarios/criteria/highway.toml"
    drive = ROOT / "scenarios" / "cut_in_brake"
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setenv("RESIM_CATALOG", "none")
    for name, command in {
        "run": ("run", drive, "--build", pilot, "--criteria", criteria),
        "assessment": ("assess", folder / "run"),
        "verification": ("verify", folder / "two.toml", "--build", pilot),
        "sweep": ("sweep", folder / "late.toml"),
        "mining": ("mine", drive, "--scenarios", "recordings"),
    }.items():
        assert called(*command, "--out", folder / name) in (0, 1)
    monkeypatch.undo()
    return folder
