"""Variations of a drive: deterministic, extendable, possible, near, and trusted no further than verified."""

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from calling import called
from traced import kernel_file

from resim.core.errors import InputError
from resim.core.halton import halton
from resim.core.overlaps import first_overlaps
from resim.jobs.export import export_rocrate
from resim.jobs.play import played_drive
from resim.jobs.vary import Variations, VaryOptions, _found, _other, read_variations, vary
from resim.recordings import RecordingTables, read_recording
from resim.recordings.checks import examine
from resim.results import write_parquet
from resim.road.opendrive import load
from resim.scenario.augmentation.settings import VehicleType, Weather
from resim.scenario.jscen import read_jscen
from resim.scenario.scenario import describe
from resim.variations.candidate import varied_drive
from resim.variations.kernels import write_kernels
from resim.variations.origin import NamedManeuver, the_origin
from resim.variations.search import FoundVariation
from resim.variations.settings import VariationSettings, WhatVaries

DRIVE = Path(__file__).parents[2] / "scenarios" / "cut_in_brake"
THERE = WhatVaries(objects=("1",), labels=("lane_change_right",))
KERNELS = kernel_file("lane_change_right", "follow_lane")


@pytest.fixture(scope="module")
def kernels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("kernels") / "kernels.json"
    write_kernels(KERNELS, path)
    return path


@pytest.fixture(scope="module")
def varied(kernels: Path, tmp_path_factory: pytest.TempPathFactory) -> Variations:
    settings = VariationSettings(
        box=0.03,
        vehicle=(
            VehicleType(name="van", kind="van", length=5.4, width=2.0, top_speed=60.0, acceleration=5.0),
        ),
        weather=(Weather(precipitation="rain", intensity=2.0),),
    )
    out = tmp_path_factory.mktemp("varied") / "out"
    what = WhatVaries(objects=("1",))
    return vary(DRIVE, kernels, out, count=16, options=VaryOptions(what, settings, workers=1))


def test_what_was_changed_is_not_read_and_another_vehicle_is_told(varied: Variations, tmp_path: Path) -> None:
    shutil.copytree(varied.folder, tmp_path / "v")
    assert len(read_variations(tmp_path / "v").table) == 16
    write_parquet(varied.table.assign(trust="inside"), tmp_path / "v" / "variations.parquet")
    with pytest.raises(InputError, match="was changed after it was written"):
        read_variations(tmp_path / "v")
    drive = FoundVariation(1, np.zeros(1), None, "", (("1", "van", 5.4, 2.0),), (("rain", "yes"),))
    assert _other(drive) == "object 1 is a van of 5.4 m; its weather is another one"
    assert _other(replace(drive, sizes=(), environment=())) == ""


def test_more_start_with_the_same_whoever_works(varied: Variations, kernels: Path, tmp_path: Path) -> None:
    settings = VariationSettings.model_validate(varied.report.inputs.settings)
    options = VaryOptions(WhatVaries(objects=("1",)), settings, workers=2)
    more = vary(DRIVE, kernels, tmp_path / "more", count=24, options=options)
    pd.testing.assert_frame_equal(more.table.head(16), varied.table)
    for name in varied.table["file"]:
        assert (varied.folder / name).read_bytes() == (more.folder / name).read_bytes()


def test_a_row_tells_its_point_and_components(varied: Variations) -> None:
    table = varied.table
    count = sum(varied.report.inputs.components)
    points = table[[f"h{k + 1}" for k in range(count + 2)]].to_numpy()
    wanted = np.array([halton(n, 1, count + 2)[0] for n in table["halton_index"].tolist()])
    np.testing.assert_array_equal(points, wanted)
    assert (table["rejections"].cumsum() + table["variation"] == table["halton_index"]).all()
    components = table[[f"c{k + 1}" for k in range(count)]].to_numpy()
    box = np.concatenate([KERNELS.kernels[m.split(":")[1].split("@")[0]].box
                          for m in varied.report.inputs.maneuvers])  # fmt: skip
    away = np.diff(components - (2.0 * wanted[:, :count] - 1.0) * 0.03 * box, axis=0)
    np.testing.assert_allclose(away, 0.0, atol=1e-9)  # all around one original
    sd = np.concatenate([KERNELS.kernels[m.split(":")[1].split("@")[0]].sd
                         for m in varied.report.inputs.maneuvers])  # fmt: skip
    distance = np.linalg.norm((2.0 * wanted[:, :count] - 1.0) * 0.03 * box / sd, axis=1)
    np.testing.assert_allclose(table["distance"], distance)
    assert (table["trust"] == "unknown").all()


def test_discrete_parameters_take_their_share(varied: Variations) -> None:
    table = varied.table
    kinds = {one.partition(":")[2] for one in table["sizes"] if one}
    assert kinds == {"van:5.4:2"}
    assert 0 < (table["sizes"] != "").sum() < len(table)
    assert 0 < (table["environment"] != "").sum() < len(table)
    for row in table.itertuples():
        scenario = read_jscen(varied.folder / str(row.file))
        assert (scenario.objects[0].kind == "van") == (row.sizes != "")
        assert ("rain" in scenario.environment["precipitationDensity"]) == (row.environment != "")


def test_no_variation_fails_the_check_or_overlaps(varied: Variations) -> None:
    recording = read_recording(DRIVE)
    network = load(recording.map)
    for name in varied.table["file"]:
        scenario = read_jscen(varied.folder / name)
        tracks = scenario.tracks(network, recording.gt.t)
        assert first_overlaps(tracks) == []
        drive = replace(recording, gt=replace(tracks, a=None, yaw_rate=None), sd=None, plan=None, sd_gt_id=None,
                        existence_probability=None, build=None, build_hash=None)  # fmt: skip
        assert examine(RecordingTables.of(drive), network) == ()


def test_what_is_impossible_is_rejected_and_counted(kernels: Path, tmp_path: Path) -> None:
    """A box as wide as all data throws the object off the road and onto the EGO."""
    wide = VaryOptions(THERE, VariationSettings(box=1.0), write=False, workers=1)
    found = vary(DRIVE, kernels, tmp_path / "wide", count=4, options=wide)
    assert sum(found.report.rejected.values()) == found.report.looked - 4 > 0
    assert {*found.report.rejected} & {"off_road", "lateral", "braking", "acceleration", "overlap", "check"}
    table = found.table
    assert table["halton_index"].is_monotonic_increasing
    assert int(table["rejections"].sum()) <= found.report.looked - 4


def test_the_original_is_where_nothing_is_changed() -> None:
    recording = read_recording(DRIVE)
    network = load(recording.map)
    scenario = describe(recording.gt, network, ego=recording.ego, map_name=recording.map.name)
    maneuvers = [
        NamedManeuver("1", "lane_change_right", 1.92, 5.12),
        NamedManeuver("1", "follow_lane", 5.16, 9.2),
    ]
    origin = the_origin(scenario, network, KERNELS, maneuvers)
    found = varied_drive(origin, np.zeros(origin.dimensions))
    before, after = (one.tracks(network, recording.gt.t) for one in (scenario, found.scenario))
    np.testing.assert_allclose(after.x, before.x, atol=1e-4)
    np.testing.assert_allclose(after.y, before.y, atol=1e-4)
    assert found.distance == 0.0


def test_variations_are_packed_as_a_crate(varied: Variations, tmp_path: Path) -> None:
    found = export_rocrate(varied.folder, tmp_path / "crate")
    assert {"variations.json", "variations.parquet", "ro-crate-metadata.json"} <= set(found.files)


def test_the_player_shows_a_bundle(varied: Variations) -> None:
    drive = played_drive(varied.folder)
    origin, bundle = drive.layers
    assert "1" in origin.tracks.ids
    assert bundle.tracks.ids.tolist() == [f"1~{k}" for k in range(1, 17)]
    own = origin.tracks.index("1")
    away = np.hypot(bundle.tracks.x - origin.tracks.x[own], bundle.tracks.y - origin.tracks.y[own])
    assert 0.01 < np.nanmax(away) < 10.0


def test_what_cannot_be_varied_says_why(kernels: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no traffic object '7'"):
        vary(DRIVE, kernels, tmp_path / "a", count=1, options=VaryOptions(WhatVaries(("7",))))
    with pytest.raises(InputError, match="has no traffic object '7'"):  # no joint variation without it
        vary(DRIVE, kernels, tmp_path / "c", count=1, options=VaryOptions(WhatVaries(("1", "7"))))
    with pytest.raises(InputError, match="has no turn_left"):
        vary(DRIVE, kernels, tmp_path / "b", count=1, options=VaryOptions(WhatVaries(("1",), ("turn_left",))))
    assert not (tmp_path / "a").exists()


def test_too_many_rejected_points_are_told_by_reason(kernels: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reasons = ["fit", "", "overlap", "fit"]
    found = [FoundVariation(n, np.zeros(1), None, why) for n, why in enumerate(reasons, start=1)]
    monkeypatch.setattr("resim.jobs.vary.search", lambda *_: found)
    with pytest.raises(InputError, match=r"of 4 points 1 are kept: 2 fit, 1 overlap\. Take"):
        _found(SimpleNamespace(folder=DRIVE), 2, 1, lambda kept: None)  # type: ignore[arg-type]


def test_of_real_drives_too_few_held_out_traces_are_told_with_the_variations(tmp_path: Path) -> None:
    """100 traces were held out: nothing shows that the variations are as humans drive."""
    write_kernels(replace(KERNELS, data="real"), tmp_path / "kernels.json")
    found = vary(
        DRIVE, tmp_path / "kernels.json", tmp_path / "v", count=1, options=VaryOptions(THERE, workers=1)
    )
    missing = "are as humans drive: not shown: 100 of 500 held-out traces, 400 are missing"
    assert f"whether variations of lane_change_right {missing}" in found.report.notes
    assert missing in (tmp_path / "v" / "variations.html").read_text("utf-8")


@pytest.mark.parametrize("box", ["0", "-1", "nan", "11"])
def test_a_box_that_is_none_is_told_on_the_command_line(
    box: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert called("vary", DRIVE, "--kernels", "k.json", "--out", tmp_path / "out", f"--box={box}") == 2
    assert f"--box: expected a share above 0, up to 10, found {float(box):g}" in capsys.readouterr().err


def test_from_the_command_line(kernels: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    code = called("vary", DRIVE, "--kernels", kernels, "--object", "1", "--maneuver", "follow_lane", "--count", 3,
                  "--workers", 1, "--out", out)  # fmt: skip
    told = capsys.readouterr()
    assert code == 0, told.err
    assert "3 variations of 3 points" in told.out
    assert "synthetic drives: nothing is claimed of how humans drive" in told.out
    assert read_variations(out).table["variation"].tolist() == [1, 2, 3]
    assert "not legitimised" in (out / "variations.html").read_text("utf-8")
