"""Results as RO-Crates: all files are in them, and nothing is told that is not there."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT

from resim.core.errors import InputError
from resim.exports.rocrate import crate
from resim.jobs.convert import convert
from resim.jobs.export import export_rocrate


@pytest.fixture(scope="module")
def converted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("map") / "out"
    convert(ROOT / "networks" / "proving_ground.xodr", out)
    return out


def entities(folder: Path) -> dict[str, dict[str, Any]]:
    told = json.loads((folder / "ro-crate-metadata.json").read_text(encoding="utf-8"))
    found = {one["@id"]: one for one in told["@graph"]}
    assert len(found) == len(told["@graph"])
    return found


def references(told: Any) -> set[str]:
    if isinstance(told, dict):
        own = {told["@id"]} if set(told) == {"@id"} else set()
        return own.union(*(references(value) for value in told.values()))
    return set().union(*(references(one) for one in told)) if isinstance(told, list) else set()


@pytest.mark.parametrize("what", ["result", "converted"])
def test_a_crate_holds_what_it_names(what: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    source = request.getfixturevalue(what)
    for _ in range(2):  # an earlier crate there is replaced
        export_rocrate(source, tmp_path / "out")
    found = entities(tmp_path / "out")
    parts = {one["@id"] for one in found["./"]["hasPart"]}
    assert parts == {file.relative_to(source).as_posix() for file in source.rglob("*") if file.is_file()}
    for name in parts:
        raw = (tmp_path / "out" / name).read_bytes()
        assert raw == (source / name).read_bytes()
        assert found[name]["sha256"] == hashlib.sha256(raw).hexdigest()
        assert found[name]["contentSize"] == str(len(raw))
    outside = {name for name in references([*found.values()]) if name not in found}
    assert all(name.startswith("https://w3id.org/ro/") for name in outside), outside
    (action,) = (one for one in found.values() if one["@type"] == "CreateAction")
    assert action["object"]


def test_inputs_are_told_by_their_hashes(result: Path, tmp_path: Path) -> None:
    export_rocrate(result, tmp_path / "out")
    mark = json.loads((result / "run.json").read_text(encoding="utf-8"))
    found = entities(tmp_path / "out")
    for name, digest in mark["hashes"].items():
        if digest:
            assert found[f"#hashes/{name}"]["identifier"] == digest


def test_what_is_no_folder_of_results_is_refused(converted: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is no folder of results"):
        export_rocrate(ROOT / "scenarios" / "rear_end", tmp_path / "out")
    import shutil

    other = tmp_path / "other"
    shutil.copytree(converted, other)
    (other / "notes.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=r"holds notes\.txt, which is not a resim result"):
        export_rocrate(other, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_crate_is_not_put_into_what_it_packs(converted: Path) -> None:
    with pytest.raises(InputError, match="which is to be packed"):
        export_rocrate(converted, converted / "crate")
    assert not (converted / "crate").exists()


def test_names_are_references_that_a_reader_can_resolve() -> None:
    """Spaces, umlauts and marks are encoded, and two names are never one."""
    told = {
        "versions": {"resim": "1", "code": "c"},
        "maps": {"a b": "0" * 32, "a_b": "1" * 32, "ä#": "2" * 64},
    }
    made = crate("t", "run.json", told, {"cases/ä b#1?.json": (1, "3" * 64)}, "2026-01-01T00:00:00+00:00")
    ids = [one["@id"] for one in made["@graph"]]
    assert len(set(ids)) == len(ids)
    assert "cases/%C3%A4%20b%231%3F.json" in ids
    assert {"#maps/a%20b", "#maps/a_b", "#maps/%C3%A4%23"} <= set(ids)
    assert all(re.fullmatch(r"#?[A-Za-z0-9._~:/%-]+", one) for one in ids)
