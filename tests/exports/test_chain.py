"""A result with all that it came from as one crate: whole, with the contents that the result names."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from calling import called
from conftest import ROOT

from resim.core.errors import InputError
from resim.jobs.chain import export_chain, write_chain
from resim.jobs.lake import lake_add, lake_show
from resim.jobs.mirror import mirrored
from resim.recordings.content import content_hash
from resim.results.catalog import Catalog
from resim.simulation.function.interface import freeze_build


@pytest.fixture
def lake(result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A lake of a run and what it came from; gives the folder of the run."""
    monkeypatch.setenv("RESIM_CATALOG", str(tmp_path / "catalog.sqlite"))
    home = tmp_path / "home"
    shutil.copytree(ROOT / "scenarios" / "cut_in_brake", home / "scenarios" / "cut_in_brake")
    shutil.copytree(ROOT / "adfunc", home / "adfunc", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("networks/proving_ground.xodr", "scenarios/criteria/highway.toml"):
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, home / name)
    shutil.copytree(result, home / "out" / "run")
    lake_add([home])
    return home / "out" / "run"


def entities(folder: Path) -> dict[str, dict[str, Any]]:
    told = json.loads((folder / "ro-crate-metadata.json").read_text(encoding="utf-8"))
    found = {one["@id"]: one for one in told["@graph"]}
    assert len(found) == len(told["@graph"])
    return found


def test_a_chain_holds_what_the_result_was_made_of_and_says_how(lake: Path, tmp_path: Path) -> None:
    out = tmp_path / "crate"
    report = export_chain(str(lake), out)
    assert report.notes == ()
    found = entities(out)
    files = [one for one in found.values() if one["@type"] == "File"]
    assert {one["name"] for one in files} == {
        p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file() and p.parent != out
    }
    for one in files:
        assert one["sha256"] == hashlib.sha256((out / one["name"]).read_bytes()).hexdigest()
    links = lake_show(str(lake))
    hashes = {i.role: i.hash for i, _ in links.origins}
    assert (
        content_hash(out / "scenarios" / "cut_in_brake") == hashes["recording"]
    )  # with its map where it names it
    assert freeze_build(out / "adfunc" / "builds" / "highway_pilot-1.0.toml").hash == hashes["build"]
    identifiers = {one.get("identifier") for one in found.values()}
    assert {*hashes.values()} <= identifiers
    (action,) = [one for one in found.values() if one["@type"] == "CreateAction"]
    assert (
        "resim run scenarios/cut_in_brake --build adfunc/builds/highway_pilot-1.0.toml"
        in action["description"]
    )
    assert action["description"].endswith("--seeds 2 --out again")
    told = {found[one["@id"]]["name"]: found[one["@id"]].get("value") for one in action["object"]}
    assert (told["seed"], told["engine"]) == ("0", links.origin.settings["engine"])
    assert links.origin.versions["code"] in found[action["instrument"]["@id"]]["softwareVersion"]


def test_what_is_not_at_hand_is_named_with_the_reason(lake: Path, tmp_path: Path) -> None:
    home = lake.parents[1]
    model = home / "adfunc" / "perception" / "proving_ground.json"
    model.write_text(model.read_text() + "\n")
    catalog = Catalog(str(tmp_path / "catalog.sqlite"))
    catalog.forget(*catalog.of_folder(home / "networks" / "proving_ground.xodr"))
    criteria = home / "scenarios" / "criteria" / "highway.toml"
    criteria.rename(home / "kept.toml")
    criteria.symlink_to(home / "kept.toml")
    notes = " ".join(export_chain(str(lake), tmp_path / "crate").notes)
    assert "perception proving_ground: its files hold something else now" in notes
    assert "is a link, which is not followed" in notes
    assert "map" not in notes.replace("cut_in_brake", "")  # the run has a copy of it
    assert not (tmp_path / "crate" / "scenarios" / "criteria").exists()
    with pytest.raises(InputError, match="which is to be packed"):
        export_chain(str(lake), lake / "crate")
    (lake / "secret.txt").write_text("not a result")
    with pytest.raises(InputError, match=r"holds secret\.txt, which is not a resim result"):
        export_chain(str(lake), tmp_path / "crate")
    (lake / "secret.txt").unlink()
    with pytest.raises(InputError, match="GB with all that it came from"):
        write_chain(catalog, catalog.of_folder(lake)[0], tmp_path / "crate", 1e5)
    shutil.rmtree(lake)
    with pytest.raises(InputError, match="its files are gone"):
        export_chain(str(lake), tmp_path / "crate")


def test_the_command_writes_it_and_says_what_is_missing(lake: Path, tmp_path: Path) -> None:
    (lake.parents[1] / "scenarios" / "criteria" / "highway.toml").unlink()
    assert called("lake", "crate", lake, "--out", tmp_path / "crate") == 0
    assert (tmp_path / "crate" / "export.json").is_file()


def test_a_result_is_mirrored_with_its_kpis_settings_and_verdicts(lake: Path, tmp_path: Path) -> None:
    (entry,) = Catalog(str(tmp_path / "catalog.sqlite")).of_folder(lake)
    one = mirrored(entry)
    assert (one.params["build"], one.params["seed"], one.params["seeds"]) == ("highway_pilot-1.0", "0", "2")
    assert one.tags["resim.verdict"] == entry.verdict != ""
    assert one.tags["verdict.cut_in_brake/highway_pilot-1.0/rGT"] == "FAIL"
    assert 0.0 < one.metrics["kpi/GT/TTC"] < 10.0
    assert one.metrics["risk/GT"] > 0.0
