"""What follows from no files is kept, and put back into an empty catalog."""

from __future__ import annotations

import io
import json
import os
import shutil
import stat
import tarfile
from pathlib import Path
from typing import Any

import pytest
from conftest import Call

from resim.core.errors import InputError
from resim.results.backup import back_up, restore
from resim.results.catalog import Catalog
from resim.results.queue import TaskQueue, new_id
from resim.results.scanning import register, roots_of

ROOT = Path(__file__).parents[2]


def test_tasks_paths_audit_and_key_come_back(database: str, tmp_path: Path) -> None:
    catalog, data, file = Catalog(database), tmp_path / "mine", tmp_path / "kept.tar.gz"
    data.mkdir()
    for name in ("audit.jsonl", "serve.key"):
        (data / name).write_bytes(name.encode())
    register(catalog, [ROOT / "networks" / "urban.xodr"])
    queue = TaskQueue(catalog, "here")
    for k in range(3):
        queue.add(new_id(), "run", ("run", "--", f"/d {k}"), f"/tasks/{k}", ("--resume",))
    queue.end(queue.claim("me"), "failed", code=2, told="why")  # type: ignore[arg-type]
    counts = {"resim_root": 1, "resim_task": 3, "audit.jsonl": 1, "serve.key": 1}
    assert back_up(catalog, data, file) == counts
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    lost = Catalog(str(tmp_path / "again.sqlite"))
    assert restore(lost, tmp_path / "yours", file) == counts
    again = TaskQueue(lost, "here")
    assert (again.unfinished(), again.ended(0, 9)) == (queue.unfinished(), queue.ended(0, 9))
    assert roots_of(lost) == roots_of(catalog)
    assert (tmp_path / "yours" / "serve.key").read_bytes() == b"serve.key"
    assert stat.S_IMODE((tmp_path / "yours" / "serve.key").stat().st_mode) == 0o600
    assert again.cancel(again.unfinished()[0].id)
    assert restore(lost, tmp_path / "yours", file) == {"resim_root": 0, "resim_task": 0}
    assert again.counts()["cancelled"] == 1  # what is there stays as it is
    with pytest.raises(InputError, match="is there already"):
        back_up(catalog, data, file)


@pytest.mark.slow
def test_results_that_no_scan_finds_are_entered_again(tmp_path: Path, call: Call, monkeypatch: Any) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setenv("RESIM_CATALOG", str(tmp_path / "catalog.sqlite"))
    drive = ROOT / "scenarios" / "overtake"
    assert call("lake", "add", ROOT / "networks", drive)[0] == 0
    assert call("assess", "drive", drive, "--out", tmp_path / "one")[0] == 0
    shutil.copytree(tmp_path / "one", tmp_path / "gone")
    assert call("runs", "add", tmp_path / "gone")[0] == 0
    assert (
        call("lake", "backup", tmp_path / "kept")[1].strip() == "kept: 2 resim_root, 0 resim_task, 2 results"
    )
    shutil.rmtree(tmp_path / "gone")
    told = []
    for path in ("catalog.sqlite", "again.sqlite"):
        monkeypatch.setenv("RESIM_CATALOG", str(tmp_path / path))
        restored = call("lake", "restore", tmp_path / "kept")
        assert (restored[0], call("lake", "scan")[0]) == (0, 0)
        rows = call("lake", "find", "--format", "csv")[1].splitlines()
        told.append(sorted(row for row in rows if f"{tmp_path}/gone" not in row))
    assert restored[1].strip() == "put back: 2 resim_root, 0 resim_task, 1 results"
    assert told[0] == told[1]
    assert any(f"{tmp_path}/one" in row for row in told[1])


def test_what_is_no_backup_changes_nothing(tmp_path: Path) -> None:
    catalog, file = Catalog(str(tmp_path / "catalog.sqlite")), tmp_path / "kept.tar.gz"
    for tables in (b"{}", b"[]", b'{"resim-backup": "2", "resim_root": [{}], "resim_task": []}', b"{"):
        with tarfile.open(file, "w:gz") as archive:
            for name, content in (("tables.json", tables), ("../evil", b"x"), ("serve.key", b"k")):
                member = tarfile.TarInfo(name)
                member.size = len(content)
                archive.addfile(member, io.BytesIO(content))
        with pytest.raises(InputError, match="is no backup that can be read"):
            restore(catalog, tmp_path / "data", file)
    file.write_bytes(b"no archive")
    with pytest.raises(InputError, match="is no backup that can be read"):
        restore(catalog, tmp_path / "data", file)
    assert not (tmp_path / "data").exists()
    assert not (tmp_path / "evil").exists()


def test_the_commands(tmp_path: Path, call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RESIM_CATALOG", str(tmp_path / "catalog.sqlite"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert call("lake", "add", ROOT / "networks" / "urban.xodr")[0] == 0
    code, out, _ = call("lake", "backup", tmp_path / "kept")
    assert (code, out.strip()) == (0, "kept: 1 resim_root, 0 resim_task")
    monkeypatch.setenv("RESIM_CATALOG", str(tmp_path / "other.sqlite"))
    assert call("lake", "restore", tmp_path / "kept")[1].strip() == "put back: 1 resim_root, 0 resim_task"
    assert call("lake", "scan")[1].strip() == "1 there: 1 new, 0 changed; 0 gone"


@pytest.mark.parametrize(
    "change",
    [
        {"words": 5}, {"words": ["a", 5]}, {"again": None}, {"state": "evil"}, {"created": 1e300}, {"id": {}},
        {"attempt": "x"}, {"priority": 10**30}, {"folder": "/a\0b"}, {"folder": 5}, None,
    ],
)  # fmt: skip
def test_a_backup_with_what_no_queue_has_is_refused(tmp_path: Path, change: dict[str, object] | None) -> None:
    catalog, file = Catalog(str(tmp_path / "catalog.sqlite")), tmp_path / "kept.tar.gz"
    queue = TaskQueue(catalog, "here")
    queue.add("one", "run", ("run",), "/tasks/one")
    back_up(catalog, tmp_path, file)
    with tarfile.open(file) as archive:
        told = json.loads(archive.extractfile("tables.json").read())  # type: ignore[union-attr]
    told["resim_task"] = [{**told["resim_task"][0], "id": "two", **(change or {})}]
    content = b"[" * 100_000 if change is None else json.dumps(told).encode()
    with tarfile.open(file, "w:gz") as archive:
        member = tarfile.TarInfo("tables.json")
        member.size = len(content)
        archive.addfile(member, io.BytesIO(content))
    with pytest.raises(InputError, match="is no backup that can be read"):
        restore(catalog, tmp_path, file)
    assert queue.counts() == {"waiting": 1}


def test_paths_that_lead_nowhere_are_refused(tmp_path: Path) -> None:
    catalog, file, pipe = Catalog(str(tmp_path / "c.sqlite")), tmp_path / "kept.tar.gz", tmp_path / "pipe"
    back_up(catalog, tmp_path, file)
    os.mkfifo(pipe)
    for wrong in (file / "below", Path("a\0b")):
        with pytest.raises(InputError, match="cannot be written"):
            back_up(catalog, tmp_path, wrong)
    with pytest.raises(InputError):
        restore(catalog, tmp_path, pipe)
    with pytest.raises(InputError, match="cannot be made"):
        restore(catalog, file, file)


def test_restoring_says_that_tasks_will_begin(
    tmp_path: Path, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setenv("RESIM_CATALOG", str(tmp_path / "catalog.sqlite"))
    TaskQueue(Catalog(str(tmp_path / "catalog.sqlite"))).add(new_id(), "check", ("check",), "/tasks/1")
    assert call("lake", "backup", tmp_path / "kept")[0] == 0
    monkeypatch.setenv("RESIM_CATALOG", str(tmp_path / "again.sqlite"))
    code, out, error = call("lake", "restore", tmp_path / "kept")
    assert (code, out.strip()) == (0, "put back: 0 resim_root, 1 resim_task")
    assert "begin with the next `resim serve`" in error
