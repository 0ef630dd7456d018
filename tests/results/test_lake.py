"""The lake: told by content, found again by what is known of it, and the same when its index is made again."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select

from resim.core.errors import InputError
from resim.recordings.content import content_hash
from resim.results.catalog import Catalog
from resim.results.lake import ITEM_KINDS, LakeQuery, find_page, with_content
from resim.results.scanning import is_up_to_date, register, scan, unregister
from resim.results.tables import INDEX, ROOT

ROOT_FOLDER = Path(__file__).parents[2]


def dump(catalog: Catalog) -> dict[str, list[Any]]:
    """All rows of the index, ids included."""
    with catalog.connected() as connection:
        return {t.name: sorted(map(repr, connection.execute(select(t)))) for t in (*INDEX, ROOT)}


def names(catalog: Catalog, **query: Any) -> list[str]:
    return [item.name for item in find_page(catalog, LakeQuery(**query), sort="name").items]


@pytest.fixture
def shipped(tmp_path: Path) -> Path:
    """Recordings, maps, builds, models, criteria, suites and files of sweeps, as they ship."""
    scenarios = ("cut_in_brake", "overtake", "criteria", "suites", "sweeps", "kernels")
    for name in (*(f"scenarios/{s}" for s in scenarios), "networks", "adfunc/builds", "adfunc/perception"):
        shutil.copytree(ROOT_FOLDER / name, tmp_path / "lake" / name)
    return tmp_path / "lake"


def test_everything_is_told_by_its_content(database: str, shipped: Path, made: Path) -> None:
    catalog = Catalog(database)
    found = register(catalog, [shipped, made])
    assert (found.new, found.changed, found.gone, found.absent) == (found.seen, 0, 0, ())
    assert names(catalog, kinds=("recording",)) == ["cut_in_brake", "cut_in_brake+ego+1", "overtake"]
    assert "highway_pilot-1.0" in names(catalog, kinds=("build",))
    assert names(catalog, kinds=("suite",)) == ["highway", "two", "us101"]
    assert "late" in names(catalog, kinds=("sweep-file",))
    assert {"highway", "traffic"} <= {*names(catalog, kinds=("criteria",))}
    assert len(names(catalog, kinds=("model",))) == 4
    assert names(catalog, kinds=("kernels",)) == ["motorway"]
    assert {"motorway", "proving_ground", "urban"} == {*names(catalog, kinds=("map",))}
    for kind in ("run", "assessment", "verification", "sweep", "mining"):
        (one,) = find_page(catalog, LakeQuery(kinds=(kind,))).items  # type: ignore[arg-type]
        assert Path(one.folder).parent == made
    faults = [i for i in find_page(catalog, LakeQuery(), most=100).items if i.fault]
    assert {i.name for i in faults} <= {"reactive_planner-2025.1"}  # whose environment need not be here


def test_it_is_found_by_what_is_known_of_it(database: str, shipped: Path, made: Path, tmp_path: Path) -> None:
    catalog = Catalog(database)
    register(catalog, [shipped, made])
    drive = content_hash(shipped / "scenarios" / "cut_in_brake")
    both = ["cut_in_brake", "cut_in_brake+ego+1"]
    drives = {"kinds": ("recording",)}
    for query, expected in (
        ({"text": "CUT bra"}, both), ({"text": "rake"}, []), ({"text": "%"}, []), ({"text": "' OR 1=1"}, []),
        ({"text": drive[:9]}, both), ({"maneuver": "strong_brak"}, ["cut_in_brake"]), ({"maneuver": "turn"}, []),
        ({"place": "proving"}, [*both, "overtake"]), ({"place": "urban"}, []), ({"tag": "mined=lane"}, both[1:]),
        ({"weather": "fogDensity=Excellent"}, [*both, "overtake"]), ({"finding": "SPEED"}, both),
        ({"risk_above": 0.009}, ["cut_in_brake"]), ({"risk_below": 0.009}, []), ({"build": "highway_pilot-1.0"},
        [*both, "overtake"]), ({"text": "cut", "maneuver": "pass"}, ["cut_in_brake"]),
        ({"hashes": (drive,)}, both[1:]),
    ):  # fmt: skip
        assert names(catalog, **drives, **query) == expected, query
    (tmp_path / "scenarios").mkdir()
    for name in ("GT.jscen.json", "proving_ground.xodr"):
        shutil.copy(made / "run" / name, tmp_path / "scenarios" / name)
    register(catalog, [tmp_path / "scenarios"])
    for kind in ("map", "run", "assessment", "verification", "sweep", "mining", "scenario"):
        every, there = names(catalog, kinds=(kind,)), names(catalog, kinds=(kind,), place="proving")
        assert there, kind  # all that came from drives there, and nothing of another map
        assert kind == "map" or there == every
        assert names(catalog, kinds=(kind,), place="urban") == (["urban"] if kind == "map" else []), kind
    assert names(catalog, place="proving", maneuver="pass") == ["cut_in_brake"]
    assert names(catalog, kinds=("run",), verdict="fail") == ["cut_in_brake"]
    assert names(catalog, kinds=("run",), verdict="PASS", build="highway") == []
    assert {i.kind for i in find_page(catalog, LakeQuery(hashes=(drive,))).items} == {
        "run", "assessment", "verification", "sweep", "mining", "recording", "suite",
    }  # fmt: skip
    (risky,) = find_page(catalog, LakeQuery(kinds=("recording",)), sort="risk").items
    assert (risky.name, round(risky.risk or 0.0, 4)) == ("cut_in_brake", 0.009)
    assert [i.kind for i in with_content(catalog, [drive, ""])[drive]] == ["recording"]


def test_a_lost_index_is_made_again_and_is_the_same(
    tmp_path: Path, shipped: Path, made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = Catalog(str(tmp_path / "first.sqlite"))
    register(first, [shipped, made])
    again = Catalog(str(tmp_path / "again.sqlite"))
    scan(again, [made])
    scan(again, [shipped / "networks"])
    scan(again, [shipped, made])
    unregister(again, [shipped / "networks"])
    scan(again)
    assert dump(again) == dump(first)
    version = first.version()
    counts = scan(first)
    assert (counts.new, counts.changed, counts.gone) == (0, 0, 0)
    assert (first.version(), is_up_to_date(first)) == (version, True)


def test_a_scan_sees_what_is_new_what_changed_and_what_is_gone(tmp_path: Path, shipped: Path) -> None:
    catalog = Catalog(str(tmp_path / "catalog.sqlite"))
    register(catalog, [shipped])
    seen: list[tuple[str, str]] = []

    def looked() -> list[tuple[str, str]]:
        seen.clear()
        assert not is_up_to_date(catalog)
        scan(catalog, noted=lambda what, path: seen.append((what, Path(path).name)))
        assert is_up_to_date(catalog)
        return seen

    drive = shipped / "scenarios" / "overtake"
    shutil.copytree(drive, shipped / "scenarios" / "drive")
    assert looked() == [("new", "drive")]
    road = shipped / "networks" / "proving_ground.xodr"
    road.write_bytes(road.read_bytes() + b"<!-- -->\n")  # another map is another recording
    changed = ("proving_ground.xodr", "cut_in_brake", "drive", "overtake")
    assert looked() == [("changed", name) for name in changed]
    shutil.rmtree(drive)
    assert looked() == [("gone", "overtake")]
    (shipped / "scenarios" / "cut_in_brake" / "gt.csv").unlink()
    assert looked() == [("changed", "cut_in_brake")]
    (faulty,) = find_page(catalog, LakeQuery(text="cut_in_brake", kinds=("recording",))).items
    assert "gt" in faulty.fault
    other = Catalog(str(tmp_path / "other.sqlite"))
    scan(other, [shipped])
    assert dump(other) == dump(catalog)
    shipped.rename(tmp_path / "away")  # a folder that is not there now may come back
    assert scan(catalog).absent == (str(shipped),)
    assert dump(other) == dump(catalog)
    assert unregister(catalog, [shipped]) > 10
    assert find_page(catalog, LakeQuery()).count == 0


def test_what_is_nothing_is_refused(tmp_path: Path, made: Path) -> None:
    catalog = Catalog(str(tmp_path / "catalog.sqlite"))
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "a.toml").write_text("[x]\n")
    for path in (tmp_path / "notes", tmp_path / "notes" / "a.toml"):
        with pytest.raises(InputError, match=r"holds nothing that the lake knows\. Give recordings"):
            register(catalog, [made, path])
    with pytest.raises(InputError, match="is not there"):
        register(catalog, [tmp_path / "nowhere"])
    half = tmp_path / "half"
    shutil.copytree(made / "sweep", half)
    (half / "manifest.json").unlink()
    with pytest.raises(InputError, match="holds a sweep that is not finished"):
        register(catalog, [half])
    assert find_page(catalog, LakeQuery()).count == 0


def test_results_that_broke_are_gone_and_come_back(tmp_path: Path, made: Path) -> None:
    catalog = Catalog(str(tmp_path / "catalog.sqlite"))
    shutil.copytree(made / "run", tmp_path / "out" / "run")
    register(catalog, [tmp_path / "out"])
    whole = (tmp_path / "out" / "run" / "report.json").read_bytes()
    (tmp_path / "out" / "run" / "report.json").write_bytes(whole + b" ")
    told: list[str] = []
    assert scan(catalog, noted=lambda what, path: told.append(what)).gone == 1
    assert told == ["unreadable", "gone"]
    (tmp_path / "out" / "run" / "report.json").write_bytes(whole)
    assert scan(catalog).new == 1


def test_names_that_are_no_text_hide_nothing_else(tmp_path: Path) -> None:
    for name in (b"good", b"bad\xff"):
        folder = Path(os.fsdecode(os.fsencode(tmp_path / "drives") + b"/" + name))
        folder.mkdir(parents=True)
        (folder / "recording.toml").write_text("")
    catalog = Catalog(str(tmp_path / "catalog.sqlite"))
    register(catalog, [tmp_path / "drives"])
    assert names(catalog) == ["good"]


def test_links_are_not_followed(tmp_path: Path) -> None:
    (tmp_path / "lake").mkdir()
    (tmp_path / "lake" / "linked").symlink_to(ROOT_FOLDER / "scenarios" / "overtake")
    shutil.copy(ROOT_FOLDER / "networks" / "urban.xodr", tmp_path / "lake")
    catalog = Catalog(str(tmp_path / "catalog.sqlite"))
    register(catalog, [tmp_path / "lake"])
    assert names(catalog) == ["urban"]


def test_pages_are_the_same_whether_few_or_many_fit(
    database: str, shipped: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    catalog = Catalog(database)
    register(catalog, [shipped])
    queries: list[dict[str, Any]] = [
        {}, {"kinds": ("recording", "map")}, {"text": "high"}, {"text": "a"}, {"place": "proving"}, {"build": "high"},
        {"finding": "s"}, {"text": "lake", "kinds": ("build",)},
    ]  # fmt: skip
    for query in queries:
        pages = []
        for few in (10_000, 0):
            monkeypatch.setattr("resim.results.lake.FEW", few)
            wanted = LakeQuery(**query)
            whole = find_page(catalog, wanted, sort="name", most=200)
            parts = [find_page(catalog, wanted, sort="name", first=k, most=3).items for k in range(0, 90, 3)]
            assert [i for part in parts for i in part] == [*whole.items][:90]
            pages.append(whole.items)
        assert pages[0] == pages[1] != (), query
    assert set(ITEM_KINDS) >= {"recording", "cluster", "sweep-file", "run"}


@pytest.mark.parametrize("name", ["x.json", "x.toml"])
def test_a_pipe_in_a_folder_holds_up_no_scan(tmp_path: Path, name: str) -> None:
    from resim.results.inputs import input_kind

    os.mkfifo(tmp_path / name)
    assert input_kind(tmp_path / name) is None


def test_scans_at_once_of_a_new_catalog_find_all_once_and_none_fails(database: str, tmp_path: Path) -> None:
    for name in ("scenarios/cut_in_brake", "scenarios/overtake", "scenarios/criteria", "networks"):
        shutil.copytree(ROOT_FOLDER / name, tmp_path / "lake" / name)
    for k in range(60):  # several writes each, and many things of one content
        shutil.copy(ROOT_FOLDER / "networks" / "urban.xodr", tmp_path / "lake" / f"town_{k:02}.xodr")
    command = [sys.executable, "-m", "resim", "lake", "scan", str(tmp_path / "lake")]
    scans = [
        subprocess.Popen(
            command, env={**os.environ, "RESIM_CATALOG": database}, stderr=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    for one in scans:
        _, error = one.communicate(timeout=120)
        assert one.returncode == 0, error
    alone = Catalog(str(tmp_path / "alone.sqlite"))
    scan(alone, [tmp_path / "lake"])
    assert dump(Catalog(database)) == dump(alone)


def test_who_writes_at_once_waits_for_each_other(database: str, tmp_path: Path) -> None:
    catalog = Catalog(database)
    begun, order = threading.Event(), list[str]()
    version = catalog.version()

    def write() -> None:
        begun.wait(10.0)
        with Catalog(database).changing():
            order.append("second")

    thread = threading.Thread(target=write)
    thread.start()
    with catalog.changing():
        begun.set()
        thread.join(0.5)
        order.append("first")
    thread.join(30.0)
    assert (order, catalog.version()) == (["first", "second"], version + 2)


def test_a_recording_is_found_by_the_name_that_it_gives_itself(database: str, shipped: Path) -> None:
    drive = shipped / "scenarios" / "cut_in_brake"
    told = (drive / "recording.toml").read_text()
    (drive / "recording.toml").write_text(
        told.replace('name = "cut_in_brake"', 'name = "Motorway A9, exit 61"')
    )
    catalog = Catalog(database)
    register(catalog, [shipped])
    assert names(catalog, text="a9 exit") == ["cut_in_brake"]
    assert names(catalog, text="overtake", kinds=("recording",)) == ["overtake"]
    (drive / "recording.toml").write_text(told)
    scan(catalog)
    assert names(catalog, text="a9 exit") == []
