"""`resim space` on drawn traffic: from mined drives to a release verdict."""

from __future__ import annotations

import itertools
import json
import shutil
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

import jsonschema
import numpy as np
import pytest
from mining.planted import random_traffic, write_straight
from typer.testing import CliRunner

from resim.cli import app
from resim.core.errors import InputError
from resim.core.sealed import read_sealed, sealed
from resim.core.tracks import Tracks
from resim.exports.rocrate import FILE
from resim.jobs import space as job
from resim.jobs.export import export_rocrate
from resim.jobs.mine import MineOptions, mine
from resim.jobs.schemas import schema_of
from resim.recordings import Recording, read_recording, write_recording
from resim.recordings.tables import read_parquet
from resim.results import write_json, write_parquet
from resim.space.folder import read_space
from resim.space.sources import read_mined

LIMITS = Path(__file__).parents[2] / "scenarios" / "criteria" / "release.toml"


@pytest.fixture(scope="module")
def mined(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two mined folders of drawn traffic."""
    root = tmp_path_factory.mktemp("mined")
    road = write_straight(root / "straight.xodr")
    out = []
    for seed in (1, 2):
        tracks = random_traffic(np.random.default_rng(seed), 24, 16.0, 10.0)
        write_recording(Recording(f"r{seed}", road, str(tracks.ids[0]), tracks, 10.0), root / f"r{seed}")
        mine([root / f"r{seed}"], root / f"mined{seed}", MineOptions(write=False, accept=("OVERLAP",)))
        out.append(root / f"mined{seed}")
    return out


def run(*told: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["space", *map(str, told)])
    return done.exit_code, done.output


def test_from_mined_drives_to_a_verdict(tmp_path: Path, mined: list[Path]) -> None:
    space = tmp_path / "space"
    code, words = run("build", mined[0], "--out", space)
    assert code == 0, words
    assert "kind not seen" in words
    before = job.read_result(space)
    clusters = before.clusters
    assert clusters.columns.tolist() == [
        "scenario",
        "source",
        "batch",
        "bucket",
        "cluster",
        "medoid",
        "to_medoid",
    ]
    assert clusters["medoid"].sum() == len(before.report.clusters())
    n = clusters.groupby("bucket").size()
    assert len(before.distances) == (n * (n - 1) // 2).sum()
    assert before.distances["distance"].between(0.0, 12.0).all()
    code, words = run("grow", space, mined[1])
    assert code == 0, words
    grown = job.read_result(space)
    assert grown.report.scenarios == before.report.scenarios + len(
        read_parquet(mined[1] / "scenarios.parquet")
    )
    assert [one.batch for one in grown.report.sources] == [0, 1]
    code, words = run("release", space, "--limits", LIMITS, "--out", tmp_path / "release")
    assert code == 1
    assert words.startswith("not shown: The function may not be released")
    assert "every scenario counts as an accident" in words
    for name, file in (("space", space / "space.json"), ("release", tmp_path / "release" / "release.json")):
        jsonschema.validate(json.loads(file.read_text()), schema_of(name))
    code, words = run("build", mined[1], "--out", tmp_path / "other")
    assert code == 0
    code, words = run("compare", space, tmp_path / "other", "--out", tmp_path / "compared")
    assert code == 0, words
    for folder in (mined[0], space, tmp_path / "release", tmp_path / "compared"):
        export_rocrate(folder, tmp_path / "crate")
        (root,) = (
            one for one in json.loads((tmp_path / "crate" / FILE).read_text())["@graph"] if one["@id"] == "./"
        )
        assert {part["@id"] for part in root["hasPart"]} == {
            quote(file.relative_to(folder).as_posix()) for file in folder.rglob("*") if file.is_file()
        }
    told = json.loads((tmp_path / "compared" / "comparison.json").read_text())
    jsonschema.validate(told, schema_of("space_comparison"))
    assert told["only_other"] == 0  # all of it is in the first one, too
    for page in (
        space / "space.html",
        tmp_path / "release" / "release.html",
        tmp_path / "compared" / "comparison.html",
    ):
        assert page.read_text().startswith("<!DOCTYPE html>")


def test_the_same_input_gives_the_same_bytes(tmp_path: Path, mined: list[Path]) -> None:
    for name, workers in (("a", 1), ("b", 3)):
        job.build(mined, tmp_path / name, workers=workers)
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes(), file.name


def test_the_same_folders_elsewhere_give_the_same_bytes(tmp_path: Path, mined: list[Path]) -> None:
    """Drives, what was mined of them, and the space lie beside each other, here and there."""
    asked = MineOptions(accept=("OVERLAP",), fit=False)
    for name in ("here", "far/away/there"):
        shutil.copytree(mined[0].parent / "r1", tmp_path / name / "r1")
        shutil.copy(mined[0].parent / "straight.xodr", tmp_path / name)
        mine([tmp_path / name / "r1"], tmp_path / name / "mined", asked)
        job.build([tmp_path / name / "mined"], tmp_path / name / "space")
    here, there = tmp_path / "here", tmp_path / "far" / "away" / "there"
    files = [one.relative_to(here) for one in here.rglob("*") if one.is_file()]
    assert Path("space", "scenarios.parquet") in files
    for file in files:
        assert (here / file).read_bytes() == (there / file).read_bytes(), file
    space, told = read_space(there / "space")
    assert told.sources[0].folder == "../mined"
    assert all((Path(one) / "recording.toml").is_file() for one in space.rows["folder"])
    grown = job.grow(there / "space", [mined[1]], tmp_path / "grown")
    assert (grown.folder / grown.report.sources[0].folder / "mined.json").is_file()
    # the paths of a space that was written by an earlier version, which were absolute
    old = read_sealed(here / "space" / "space.json", "")
    old["sources"][0]["folder"] = "/somewhere/mined"
    write_json(sealed(old), here / "space" / "space.json")
    with pytest.raises(
        InputError, match=r"earlier version of resim: it names /somewhere/mined .*Build the space again"
    ):
        job.read_result(here / "space")


def test_what_is_wrong_is_said(tmp_path: Path, mined: list[Path]) -> None:
    with pytest.raises(InputError, match="no folder is given"):
        job.build([], tmp_path / "space")
    with pytest.raises(InputError, match=r"mined\.json"):
        job.build([tmp_path], tmp_path / "space")
    space = tmp_path / "space"
    job.build([mined[0]], space)
    with pytest.raises(InputError, match="in the space already"):
        job.grow(space, [mined[0]])
    with pytest.raises(InputError, match="no simulated drive is given"):
        job.cover(space, [])
    settings = tmp_path / "settings.toml"
    settings.write_text('linkage = "ward"\n')
    with pytest.raises(InputError, match="linkage"):
        job.read_space_settings(settings)
    settings.write_text('threshold = "silhouette"\nbucket = "vehicles"\n[distance]\nspeed = 0.5\n')
    found = job.build([mined[0]], tmp_path / "chosen", job.read_space_settings(settings))
    assert {one.chosen for one in found.report.buckets} == {"silhouette"}
    with pytest.raises(InputError, match="Build both spaces with the same settings"):
        job.compare(space, tmp_path / "chosen", tmp_path / "compared")
    (space / "clusters.parquet").write_bytes(b"")
    with pytest.raises(InputError, match="was changed"):
        job.grow(space, [mined[1]])


def test_several_egos_of_one_lane_change_are_one_occasion(mined: list[Path]) -> None:
    source = job.read_mined(mined[0])
    assert 1 <= source.rows["occasion"].nunique() < len(source.rows)
    assert source.rows["map"].iloc[0].startswith("straight-")
    hours = source.rows["hours"].to_numpy()
    assert (hours >= 0.0).all()
    assert hours.max() <= source.recordings[0].hours


def test_occasions_are_the_same_where_names_have_spaces(mined: list[Path], tmp_path: Path) -> None:
    whole = read_recording(mined[0].parent / "r1")
    names = np.array([f"car no {name}" for name in whole.gt.ids.tolist()])
    write_recording(
        replace(whole, ego=f"car no {whole.ego}", gt=replace(whole.gt, ids=names)), tmp_path / "r1"
    )
    mine([tmp_path / "r1"], tmp_path / "mined", MineOptions(write=False, accept=("OVERLAP",)))
    told = [
        {f"{ego.removeprefix('car no ')} {start:.3f}": number for ego, start, number in columns}
        for columns in (
            zip(*(job.read_mined(f).rows[c] for c in ("ego", "start", "occasion")), strict=True)
            for f in (mined[0], tmp_path / "mined")
        )
    ]
    pairs = sorted(set(told[0]))
    assert pairs == sorted(told[1])
    for a, b in itertools.combinations(pairs, 2):
        assert (told[0][a] == told[0][b]) is (told[1][a] == told[1][b])


def test_own_egos_alone(tmp_path: Path, mined: list[Path]) -> None:
    folder = mined[0].parent / "r1"
    found = mine(
        [folder], tmp_path / "own", MineOptions(write=False, around="surroundings", accept=("OVERLAP",))
    )
    assert found.report.egos == "own"
    assert set(found.scenarios["ego"]) <= {found.report.parts[0].ego}
    source = job.read_mined(tmp_path / "own")
    assert source.egos == "own"
    assert source.recordings[0].hours == pytest.approx(found.report.parts[0].ego_hours)
    assert source.recordings[0].hours < job.read_mined(mined[0]).recordings[0].hours


def test_tables_that_were_changed_are_refused(tmp_path: Path, mined: list[Path]) -> None:
    shutil.copytree(mined[0], tmp_path / "mined")
    read_mined(tmp_path / "mined")
    frame = read_parquet(tmp_path / "mined" / "maneuvers.parquet")
    write_parquet(frame[frame["label"] != "collision"].iloc[1:], tmp_path / "mined" / "maneuvers.parquet")
    with pytest.raises(InputError, match="was changed after it was written"):
        read_mined(tmp_path / "mined")


def test_a_copy_of_a_drive_under_another_name_does_not_count_twice(tmp_path: Path, mined: list[Path]) -> None:
    """It would make kinds that were seen once into such that were seen twice."""
    first = mined[0].parent / "r1"
    shutil.copytree(first, tmp_path / "copy")
    told = tmp_path / "copy" / "recording.toml"
    told.write_text(
        told.read_text()
        .replace('name = "r1"', 'name = "another"')
        .replace('map = "', f'map = "{first.as_posix()}/')
    )
    assert "another" in told.read_text()
    mine([tmp_path / "copy"], tmp_path / "mined", MineOptions(write=False, accept=("OVERLAP",)))
    with pytest.raises(InputError, match="recording copy is in the space already"):
        job.build([mined[0], tmp_path / "mined"], tmp_path / "space")


def test_hours_in_which_the_ego_stands_are_none(tmp_path: Path) -> None:
    """Else a car that is left standing would make every rate as small as one likes."""
    t = np.arange(0.0, 40.0, 0.1)
    still = np.random.default_rng(1).normal(0.0, 0.02, len(t))
    x = np.stack([100.0 + 20.0 * np.minimum(t, 10.0) + still, 50.0 + 15.0 * t])
    v = np.stack([np.where(t < 10.0, 20.0, 0.0), np.full(len(t), 15.0)])
    zero = np.zeros((2, len(t)))
    lanes = zero + np.array([[-1.75], [-5.25]])
    tracks = Tracks(
        t=t, ids=np.array(["ego", "a"]), kind=np.array(["car", "car"]), x=x, y=lanes, heading=zero, v=v,
        length=np.full(2, 4.7), width=np.full(2, 1.9), valid=np.ones((2, len(t)), bool),
    )  # fmt: skip
    road = write_straight(tmp_path / "straight.xodr")
    write_recording(Recording("r", road, "ego", tracks, 10.0), tmp_path / "r")
    accepted = ("OVERLAP",)
    for around, driven in (("surroundings", 10.0), (None, 50.0)):
        out = tmp_path / str(around)
        mine([tmp_path / "r"], out, MineOptions(write=False, around=around, accept=accepted))
        (one,) = read_mined(out).recordings
        assert one.hours == pytest.approx(driven / 3600.0, rel=0.05)


@pytest.mark.parametrize("last", [8.0, 4.96, 4.8])
def test_a_collision_in_no_scenario_is_an_accident_of_the_build(tmp_path: Path, last: float) -> None:
    """The EGO drives into a standing car 5 s after its begin, which is recorded, or recorded up to there, or not."""
    t = np.arange(0.0, 8.0, 0.04)
    seen = np.stack([np.ones(len(t)), (t <= last + 1e-6) | (t > 5.5)]) > 0.0
    x, v = np.stack([100.0 + 20.0 * t, np.full(len(t), 204.7 - 0.02)]), np.array([[20.0], [0.0]])
    zero = np.zeros((2, len(t)))
    tracks = Tracks(
        t=t, ids=np.array(["ego", "a"]), kind=np.array(["car", "car"]), x=x, y=zero - 1.75, heading=zero, v=zero + v,
        length=np.full(2, 4.7), width=np.full(2, 1.9), valid=seen,
    )  # fmt: skip
    road = write_straight(tmp_path / "straight.xodr")
    recording = Recording("r", road, "ego", tracks, 25.0, build="f-1", build_hash="abc")
    write_recording(recording, tmp_path / "r")
    around = {
        what: MineOptions(around=what, write=False, accept=("OVERLAP", "GAP"))
        for what in ("surroundings", "risk")
    }
    mine([tmp_path / "r"], tmp_path / "m", around["surroundings"])
    (one,) = read_mined(tmp_path / "m").recordings
    assert (one.build, one.accidents) == ("abc", 1)
    mine([tmp_path / "r"], tmp_path / "risk", around["risk"])
    rows = read_mined(tmp_path / "risk").rows
    assert len(rows)
    assert rows["collided"].isna().all() == (last < 8.0)  # nobody says whether the EGO hit it
    assert rows["collided"].fillna(True).all()
    (one,) = read_mined(tmp_path / "risk").recordings
    assert one.accidents == (last < 8.0)  # it may have hit somebody outside of the scenario
