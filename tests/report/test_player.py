"""The player's data, read back by a decoder of its own, and what `resim play` refuses."""

import base64
import dataclasses
import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import Call
from hostile import HOSTILE, harmless
from played import CORNER, PILOT, ROOT, drive_of, fifty

from resim.core.errors import InputError
from resim.core.geometry import Floats
from resim.core.spec import exactly
from resim.core.tracks import Tracks
from resim.jobs.play import played_drive
from resim.jobs.resimulate import resimulate
from resim.metrics.assessment_report import DriveAssessment
from resim.recordings import read_recording
from resim.report import write_player_page
from resim.report.player import player
from resim.report.player.drive import TimelineMark, danger
from resim.report.player.packing import packed_tracks
from resim.road.opendrive import RoadNetwork

CONSTANT = ROOT / "adfunc" / "builds" / "constant_velocity-1.0.toml"


def data(page: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="player-data">(.*?)</script>', page, re.DOTALL)
    assert found
    loaded: dict[str, Any] = json.loads(found.group(1))
    return loaded


def integers(text: str) -> list[int]:
    """The integers in packed bytes, one by one."""
    out, value, shift = [], 0, 0
    for byte in base64.b64decode(text):
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            out.append(-(value + 1) // 2 if value % 2 else value // 2)
            value = shift = 0
    return out


def summed(values: list[int], order: int) -> Floats:
    found = np.array(values, dtype=float)
    for _ in range(order):
        found = np.cumsum(found)
    return found


def decoded(packed: dict[str, Any], units: dict[str, float]) -> dict[str, dict[str, Floats]]:
    """The tracks by id: t, x, y, heading, v."""
    numbers = iter(integers(packed["data"]))
    times = summed([next(numbers) for _ in range(packed["count"])], 2) * units["t"]
    out = {}
    for thing in packed["objects"]:
        places = [first + k * step for first, step, count in thing["times"] for k in range(count)]
        own = {"t": times[places]}
        for name, order in zip(("x", "y", "heading", "v"), thing["orders"], strict=True):
            own[name] = summed([next(numbers) for _ in places], order) * units[name]
        out[thing["id"]] = own
    assert next(numbers, None) is None
    return out


def same(found: dict[str, dict[str, Floats]], tracks: Tracks, origin: list[float]) -> None:
    assert set(found) == {i for n, i in enumerate(tracks.ids.tolist()) if tracks.valid[n].any()}
    for name, own in found.items():
        n = tracks.index(name)
        there = tracks.valid[n]
        np.testing.assert_allclose(own["t"], tracks.t[there], atol=5.1e-5)
        np.testing.assert_allclose(own["x"] + origin[0], tracks.x[n, there], atol=5.1e-3)
        np.testing.assert_allclose(own["y"] + origin[1], tracks.y[n, there], atol=5.1e-3)
        np.testing.assert_allclose(own["v"], tracks.v[n, there], atol=5.1e-3)
        turned = np.angle(np.exp(1j * (own["heading"] - tracks.heading[n, there])))
        assert np.abs(turned).max() < 5.1e-4


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that `resim run` writes."""
    out = tmp_path_factory.mktemp("player") / "run"
    resimulate(CORNER, PILOT).write(out)
    return out


@pytest.mark.parametrize("name", ["cut_in_brake", "overtake", "rear_end"])
def test_the_page_holds_the_recording_to_half_a_centimetre(name: str, call: Call, tmp_path: Path) -> None:
    page = tmp_path / "play.html"
    code, said, _ = call("play", ROOT / "scenarios" / name, "--out", page)
    assert code == 0
    assert f"{name}: GT" in said
    found = data(page.read_text(encoding="utf-8"))
    recording = read_recording(ROOT / "scenarios" / name)
    (drive,) = found["drives"]
    origin, layers = found["maps"][0]["origin"], {layer["name"]: layer for layer in drive["layers"]}
    same(decoded(layers["GT"]["tracks"], found["units"]), recording.gt, origin)
    if recording.sd is None:
        assert set(layers) == {"GT"}
    else:
        sd = recording.sd_by_gt()
        assert sd is not None
        same(decoded(layers["SD"]["tracks"], found["units"]), sd, origin)


def test_tracks_with_gaps_and_samples_of_their_own_come_back() -> None:
    rng = np.random.default_rng(7)
    n, samples = 9, 400
    valid = rng.random((n, samples)) < np.linspace(0.02, 1.0, n)[:, None]
    valid[0] = False  # who is never there is not in the page
    valid[1, :] = np.arange(samples) % 3 == 1

    def values(scale: float) -> Floats:
        return np.where(valid, np.cumsum(rng.normal(0.0, scale, (n, samples)), axis=1), np.nan)

    tracks = Tracks(
        t=np.asarray(np.cumsum(rng.uniform(0.01, 0.2, samples)), dtype=float),
        ids=np.array([f"o{k}" for k in range(n)]),
        kind=np.full(n, "van"), x=values(900.0), y=values(5.0), heading=values(2.0), v=values(3.0),
        length=np.full(n, np.nan), width=np.full(n, 2.0), valid=valid,
    )  # fmt: skip
    origin = np.array([12.0, -40.0])
    packed = json.loads(json.dumps(packed_tracks(tracks, origin), default=vars, allow_nan=False))
    units = {"t": 1e-4, "x": 0.01, "y": 0.01, "heading": 1e-3, "v": 0.01}
    same(decoded(packed, units), tracks, origin.tolist())
    assert {thing["length"] for thing in packed["objects"]} == {None}
    assert next(o for o in packed["objects"] if o["id"] == "o1")["times"] == [[1, 3, 133]]


@pytest.mark.parametrize(
    ("seconds", "names", "most"),
    [
        (10, ("GT", "SD", "rGT", "rSD", "perceived rGT", "perceived rSD"), 1e6),
        (600, ("GT", "SD", "rGT", "rSD"), 20e6),
    ],
)
def test_fifty_boxes_are_a_small_page(
    seconds: int, names: tuple[str, ...], most: float, network: RoadNetwork, tmp_path: Path
) -> None:
    write_player_page([fifty(network, 25 * seconds, names)], tmp_path / "play.html")
    size = (tmp_path / "play.html").stat().st_size
    print(f"{seconds} s, {len(names)} sources, 50 boxes: {size / 1e6:.2f} MB")
    assert size < most


def test_within_another_page_a_long_drive_has_fewer_samples(network: RoadNetwork) -> None:
    whole = fifty(network, 25 * 600, ("GT",))
    (layer,) = data(player([whole]))["drives"][0]["layers"]
    assert layer["tracks"]["count"] == 25 * 600 / 2
    (layer,) = data(player([whole], alone=True))["drives"][0]["layers"]
    assert layer["tracks"]["count"] == 25 * 600


def test_a_result_has_all_its_sources_curves_and_marks(result: Path, tmp_path: Path) -> None:
    drive = played_drive(result)
    layers = {layer.name: layer for layer in drive.layers}
    assert list(layers) == ["GT", "SD", "rGT", "rSD", "perceived rGT", "perceived rSD"]
    assert [name for name, layer in layers.items() if layer.shown] == ["GT", "SD", "rGT", "rSD"]
    told = json.loads((result / "report.json").read_text())
    marks = [(m.kind, m.source, round(m.start, 2)) for m in drive.marks]
    for source in ("GT", "rGT", "rSD"):
        assert ("reaction", source, round(told["reaction"][source], 2)) in marks
    assert [m.text for m in drive.marks if m.kind == "decision"] == ["changes lane to the left"] * 2
    assessed = json.loads((result / "assessment.json").read_text())["GT"]
    danger = layers["GT"].danger
    assert danger is not None
    np.testing.assert_array_equal(danger.risk, assessed["risk"]["r_ind"])
    ttc = [np.nan if v is None else v for v in assessed["measures"]["TTC"]["1"]]
    np.testing.assert_array_equal(danger.ttc, ttc)
    assert {who for who, value in zip(danger.ttc_of, ttc, strict=True) if np.isfinite(value)} == {"1"}
    assert {who for who, value in zip(danger.ttc_of, ttc, strict=True) if np.isnan(value)} == {""}
    assert all(layers[name].plans for name in ("GT", "rGT", "rSD"))
    for name in ("one", "two"):
        write_player_page([played_drive(result)], tmp_path / name)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_a_collision_and_its_end_are_marks(tmp_path: Path) -> None:
    resimulate(ROOT / "scenarios" / "rear_end", CONSTANT).write(tmp_path / "run")
    drive = played_drive(tmp_path / "run")
    told = json.loads((tmp_path / "run" / "report.json").read_text())
    hits = {(source, hit["t"]) for source, found in told["collisions"].items() for hit in found}
    assert hits
    assert {(m.source, m.start) for m in drive.marks if m.kind == "collision"} == hits
    ended = {source for source, end in told["end"].items() if end == "collision"}
    assert {m.source for m in drive.marks if m.kind == "end"} == ended


def test_a_run_that_failed_and_what_is_not_known_are_told(tmp_path: Path) -> None:
    (tmp_path / "lost.py").write_text(
        "class Lost:\n"
        "    def reset(self, setup): pass\n"
        "    def step(self, perceived): raise ValueError('lost')\n"
        "    def close(self): pass\n"
    )
    build = tmp_path / "lost.toml"
    build.write_text('name = "lost"\nversion = "1"\nfactory = "lost:Lost"\n[parameters]\n')
    resimulate(ROOT / "scenarios" / "rear_end", build).write(tmp_path / "run")
    drive = played_drive(tmp_path / "run")
    assert [layer.name for layer in drive.layers if layer.shown] == ["GT", "SD"]
    assert [note.partition(":")[0] for note in drive.notes] == ["rGT is not shown", "rSD is not shown"]
    assert all("ValueError: lost" in note for note in drive.notes)
    told = json.loads((tmp_path / "run" / "assessment.json").read_text())["GT"]
    whole = exactly(told, DriveAssessment)
    assert not danger(whole).unknown.any()
    holes = {"1": (*whole.reasons["TTC"]["1"][:-1], "not computed")}
    unknown = danger(dataclasses.replace(whole, reasons={**whole.reasons, "TTC": holes})).unknown
    assert unknown.tolist() == [False] * (len(unknown) - 1) + [True]


def test_a_scenario_is_played_as_its_splines_have_it(result: Path, tmp_path: Path) -> None:
    drive = played_drive(result / "rGT.jscen.json")
    (layer,) = drive.layers
    assert (drive.name, layer.name, drive.ego) == ("rGT", "JSCEN", "ego")
    assert {m.text for m in drive.marks} == {"first braking", "changes lane to the left"}
    driven = next(x for x in played_drive(result).layers if x.name == "rGT").tracks
    at = layer.tracks.at(driven.t)
    both = at.valid[0] & driven.valid[0]
    assert np.hypot(at.x[0] - driven.x[0], at.y[0] - driven.y[0])[both].max() < 0.1


def test_several_drives_share_a_page_and_one_with_errors_is_played(call: Call, tmp_path: Path) -> None:
    broken = tmp_path / "kmh"
    shutil.copytree(CORNER, broken)
    text = (broken / "recording.toml").read_text()
    (broken / "recording.toml").write_text(text.replace("../../networks", str(ROOT / "networks")))
    table = pd.read_csv(broken / "gt.csv")
    table.assign(v=3.6 * table.v).to_csv(broken / "gt.csv", index=False)
    assert call("run", broken, "--build", PILOT, "--out", tmp_path / "no")[0] == 2
    code, _, _ = call("play", CORNER, broken, "--out", tmp_path / "play.html")
    assert code == 0
    found = data((tmp_path / "play.html").read_text(encoding="utf-8"))
    assert [drive["name"] for drive in found["drives"]] == ["cut_in_brake", "cut_in_brake"]
    assert any(m["kind"] == "finding" and m["text"].startswith("error") for m in found["drives"][1]["marks"])


def test_hostile_names_are_text(tmp_path: Path) -> None:
    recording = read_recording(CORNER)
    ids = np.array([HOSTILE if i == "1" else i for i in recording.gt.ids])
    gt = dataclasses.replace(recording.gt, ids=ids, kind=np.full(len(ids), HOSTILE))
    named = drive_of(dataclasses.replace(recording, name=HOSTILE, gt=gt, sd=None))
    marks = (TimelineMark("finding", 0.0, 1.0, HOSTILE, HOSTILE, HOSTILE),)
    write_player_page([dataclasses.replace(named, marks=marks, notes=(HOSTILE,))], tmp_path / "play.html")
    harmless((tmp_path / "play.html").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("name", "problem"),
    [("nowhere", "there is no such file or folder"), ("empty", "holds neither recording.toml nor run.json"),
     ("sweep", "keeps no drives"), ("verified", "recording is in its drives"), ("text.txt", "is no JSCEN file"),
     ("broken.json", "is not JSON"), ("alone.jscen.json", "map.xodr")],
)  # fmt: skip
def test_what_is_no_drive_is_refused(
    name: str, problem: str, result: Path, call: Call, tmp_path: Path
) -> None:
    for folder in ("empty", "sweep", "verified"):
        (tmp_path / folder).mkdir()
    (tmp_path / "sweep" / "sweep.json").write_text("{}")
    (tmp_path / "verified" / "verification.json").write_text("{}")
    (tmp_path / "text.txt").write_text("t,id,x,y\n")
    (tmp_path / "broken.json").write_text("{")
    scenario = (result / "GT.jscen.json").read_text().replace("proving_ground.xodr", "map.xodr")
    (tmp_path / "alone.jscen.json").write_text(scenario)
    code, _, told = call("play", tmp_path / name, "--out", tmp_path / "play.html")
    assert code == 2
    assert problem in told
    assert str(tmp_path) in told
    assert not (tmp_path / "play.html").exists()


def test_a_result_that_was_changed_is_refused(result: Path, tmp_path: Path) -> None:
    changed = tmp_path / "run"
    shutil.copytree(result, changed)
    report = changed / "report.json"
    report.write_text(report.read_text().replace("cut_in_brake", "another"))
    with pytest.raises(InputError, match=r"report\.json.*was changed"):
        played_drive(changed)


def test_the_page_takes_the_place_of_no_other_file(call: Call, tmp_path: Path) -> None:
    other = tmp_path / "mine.html"
    other.write_text("<p>mine</p>")
    code, _, told = call("play", CORNER, "--out", other)
    assert code == 2
    assert "would be lost" in told
    assert other.read_text() == "<p>mine</p>"


@pytest.mark.parametrize(
    ("name", "problem"), [("film.avi", "no video of a known kind"), ("film.gif", "exists already")]
)
def test_a_video_that_cannot_be_made_is_refused_at_once(
    name: str, problem: str, call: Call, tmp_path: Path
) -> None:
    (tmp_path / "film.gif").write_text("mine")
    code, _, told = call("play", CORNER, "--out", tmp_path / "play.html", "--video", tmp_path / name)
    assert code == 2
    assert problem in told
    assert (tmp_path / "film.gif").read_text() == "mine"
    assert not (tmp_path / "play.html").exists()
