"""Traffic with an EGO: a function drives it among who reacts, it senses them, and its drives are test drives."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from resim.core.errors import InputError, ResimError
from resim.jobs.resimulate import resimulate
from resim.jobs.traffic import make_traffic
from resim.recordings import Recording, read_recording
from resim.resimulation import ResimulationOptions
from resim.simulation.direct import Direct
from resim.simulation.function.interface import load_build
from resim.simulation.reactive.settings import ReactiveSettings

ROOT = Path(__file__).parents[3]
MAP, SHIPPED = ROOT / "networks" / "motorway.xodr", ROOT / "scenarios" / "traffic" / "motorway.toml"
MODEL = ROOT / "adfunc" / "perception" / "proving_ground.json"
SECONDS, SIGHT = 14.0, 120.0
Call = Callable[..., tuple[int, str, str]]


def slow_build(folder: Path) -> Path:
    """A build that drives at 14 m/s, whoever is behind."""
    file = folder / "slow.toml"
    file.write_text(
        'name = "slow"\nversion = "1.0"\nfactory = "adfunc.idm:Idm"\ncycle_time = 0.2\n'
        "[parameters]\ndesired_speed = 14.0\n"
    )
    return file


def settings(folder: Path, ego: str) -> Path:
    text = SHIPPED.read_text().replace("recording = 120.0", f"recording = {SECONDS}", 1)
    text = re.sub(
        r"warm_up = [\d.]+", "warm_up = 50.0", re.sub(r"per_lane = [\d.]+", "per_lane = 500.0", text)
    )
    file = folder / "traffic.toml"
    file.write_text(f"{text}\n[ego]\nsight = {SIGHT}\naround = 250.0\n{ego}")
    return file


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("driven")
    build = slow_build(folder)
    asked = settings(folder, f'build = "slow.toml"\nperception = "{MODEL}"\n')
    for name in ("a", "b"):
        (one,) = make_traffic(MAP, folder / name, hours=SECONDS / 3600.0, settings=asked, seed=4)
        assert (one.driver, one.note, one.failed) == ("slow-1.0", "", False)
    return folder, build


def test_the_drive_says_who_drove_what_was_sensed_and_who_reacted(driven: tuple[Path, Path]) -> None:
    folder, build = driven
    made = read_recording(folder / "a" / "000")
    assert made.build == "slow-1.0"
    assert made.build_hash == load_build(build).hash
    assert made.sd is not None
    assert made.sd_rate == 5.0
    gt, ego = made.gt, made.gt.index(made.ego)
    assert gt.valid[ego].all()
    assert float(gt.v[ego, -1]) == pytest.approx(14.0, abs=2.0)
    assert float(gt.v[ego, 0]) > 20.0
    assert re.match(r"\d+ from [\d.]+ s", made.provenance["reacted"])
    assert "slow.toml" in made.provenance["driver"]
    assert MODEL.name in made.provenance["perception"]


def test_sensed_is_who_is_near_with_the_errors_of_the_model(driven: tuple[Path, Path]) -> None:
    folder, _ = driven
    made = read_recording(folder / "a" / "000")
    sd = made.sd_by_gt()
    assert sd is not None
    truth = made.gt.at(sd.t)
    off = []
    for name in sd.ids.tolist():
        if name == made.ego or name not in truth.ids:
            continue
        n, m = sd.index(name), truth.index(name)
        both = sd.valid[n] & truth.valid[m]
        own = truth.index(made.ego)
        away = np.hypot(truth.x[m] - truth.x[own], truth.y[m] - truth.y[own])[both]
        assert away.max() <= SIGHT + 1e-6
        off += np.hypot(sd.x[n] - truth.x[m], sd.y[n] - truth.y[m])[both].tolist()
    assert len(off) > 200
    assert 0.5 < np.median(off) < 4.0  # 1.5 m too far


def test_the_truth_is_that_of_who_moved(driven: tuple[Path, Path]) -> None:
    folder, _ = driven
    made, truth = read_recording(folder / "a" / "000"), pd.read_csv(folder / "a" / "000" / "truth.csv")
    assert not truth["object"].astype(str).eq(made.ego)[truth["label"].str.startswith("lane_change")].any()
    for one in truth.itertuples():
        own = made.gt.t[made.gt.valid[made.gt.index(str(one.object))]]
        assert own[0] - 1e-6 <= one.t <= own[-1] + 1e-6


def test_the_same_seed_gives_the_same_drive(driven: tuple[Path, Path]) -> None:
    folder, _ = driven
    for file in ("gt.parquet", "sd.parquet", "truth.csv", "recording.toml"):
        assert (folder / "a" / "000" / file).read_bytes() == (folder / "b" / "000" / file).read_bytes()


def test_the_drive_is_re_simulated_as_it_was_driven(driven: tuple[Path, Path]) -> None:
    folder, build = driven
    made = read_recording(folder / "a" / "000")
    options = ResimulationOptions(bases=("GT",), traffic=ReactiveSettings(), engine=Direct())
    found = resimulate(alone(made), load_build(build), options, accept=("REFERENCE_POINT",))
    drive = found.resimulation.drives["rGT"]
    gt = made.gt.at(drive.truth.t)
    row = gt.index(made.ego)
    off = np.hypot(drive.truth.x[0] - gt.x[row], drive.truth.y[0] - gt.y[row])
    assert np.nanmax(off) < 1.5  # it saw with the model's errors, and here as it is


def alone(made: Recording) -> Recording:
    """The recording with the five who come nearest: fits of all take long."""
    gt, row = made.gt, made.gt.index(made.ego)
    away = np.where(gt.valid, np.hypot(gt.x - gt.x[row], gt.y - gt.y[row]), np.inf).min(axis=1)
    return Recording(
        name=made.name, map=made.map, ego=made.ego, gt=gt.select(gt.ids[np.argsort(away)[:6]]), gt_rate=made.gt_rate,
        build=made.build, build_hash=made.build_hash,
    )  # fmt: skip


def test_sensors_alone_leave_the_traffic_as_it_is(tmp_path: Path, call: Call) -> None:
    code, said, _ = call(
        "traffic", MAP, "--hours", SECONDS / 3600.0, "--settings", settings(tmp_path, ""), "--seed", 4,
        "--perception", MODEL, "--out", tmp_path / "sensed",
    )  # fmt: skip
    assert code == 0
    assert "drives" not in said
    made = read_recording(tmp_path / "sensed" / "000")
    assert made.build is None
    assert made.sd is not None
    assert made.sd_rate == 25.0
    assert set(made.sd_gt_id.tolist()) <= {*made.gt.ids.tolist(), ""}  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("ego", "told"),
    [
        ('build = "nobody.toml"', "nobody.toml"),
        ('perception = "no_model.json"', "no_model.json"),
        ('build = "slow.toml"\nvehicle = "bobsled"', "bobsled"),
        ('kind = "tram"', "ego.kind"),
        ("sight = -1.0", "sight"),
    ],
)
def test_faults_are_told_before_anything_drives(tmp_path: Path, ego: str, told: str) -> None:
    slow_build(tmp_path)
    asked = settings(tmp_path, ego) if "sight" not in ego else settings(tmp_path, "")
    if "sight" in ego:
        asked.write_text(asked.read_text().replace(f"sight = {SIGHT}", ego))
    with pytest.raises((InputError, ResimError), match=re.escape(told)):
        list(make_traffic(MAP, tmp_path / "out", hours=0.01, settings=asked))
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_who_comes_near_a_slow_ego_is_there_however_far_it_was_from_the_vehicle_in_its_place(
    driven: tuple[Path, Path], tmp_path: Path
) -> None:
    folder, build = driven
    asked = settings(tmp_path, f'build = "{build}"\nperception = "{MODEL}"\n')
    asked.write_text(asked.read_text().replace("around = 250.0", "around = 40.0"))
    list(make_traffic(MAP, tmp_path / "out", hours=SECONDS / 3600.0, settings=asked, seed=4))
    wide, narrow = (read_recording(one / "000").gt for one in (folder / "a", tmp_path / "out"))
    row = wide.index(str(wide.ids[0]))
    away = np.hypot(wide.x - wide.x[row], wide.y - wide.y[row])
    met = set(wide.ids[np.nanmin(np.where(wide.valid, away, np.inf), axis=1) <= 40.0].tolist())
    assert met <= set(narrow.ids.tolist())
    assert len(narrow) < len(wide)


@pytest.mark.slow
def test_a_function_that_fails_at_once_is_recorded_or_refused(tmp_path: Path) -> None:
    (tmp_path / "fails.py").write_text(
        "from resim.simulation.function.interface import Command\n"
        "class Fails:\n"
        "    def __init__(self, at=0.0): self.at = at\n"
        "    def reset(self, setup): pass\n"
        "    def step(self, perceived):\n"
        "        if perceived.t >= self.at: raise ValueError('lost')\n"
        "        return Command(0.0, 0.0)\n"
        "    def close(self): pass\n"
    )
    build = tmp_path / "fails.toml"
    for at in (0.5, 0.0):
        build.write_text(f'name = "fails"\nversion = "1"\nfactory = "fails:Fails"\n[parameters]\nat = {at}\n')
        asked = make_traffic(
            MAP, tmp_path / f"out{at}", hours=0.003, settings=settings(tmp_path, ""), seed=4, build=build
        )
        if at:
            (one,) = asked
            assert one.failed
            assert "lost" in one.note
            assert read_recording(one.folder).gt.t[-1] == pytest.approx(at, abs=0.05)
        else:
            with pytest.raises(ResimError, match="was not driven at all"):
                list(asked)


def test_a_function_that_fails_is_recorded_up_to_there(tmp_path: Path, call: Call) -> None:
    (tmp_path / "fails.py").write_text(
        "from resim.simulation.function.interface import Command\n"
        "class Fails:\n"
        "    def reset(self, setup): pass\n"
        "    def step(self, perceived):\n"
        "        if perceived.t > 3.0: raise ValueError('lost')\n"
        "        return Command(0.0, 0.0)\n"
        "    def close(self): pass\n"
    )
    (tmp_path / "fails.toml").write_text('name = "fails"\nversion = "1"\nfactory = "fails:Fails"\n')
    code, said, _ = call(
        "traffic", MAP, "--hours", SECONDS / 3600.0, "--settings", settings(tmp_path, ""), "--seed", 4,
        "--build", tmp_path / "fails.toml", "--out", tmp_path / "out",
    )  # fmt: skip
    assert code == 1
    assert "lost" in said
    made = read_recording(tmp_path / "out" / "000")
    assert made.gt.t[-1] == pytest.approx(3.0, abs=0.1)
    assert "lost" in made.provenance["ended"]
