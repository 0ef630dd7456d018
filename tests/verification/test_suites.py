"""`resim verify` and `resim suite` on the drives that ship: what a user of a suite relies on."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from resealed import edit

from resim.core.errors import InputError
from resim.core.spec import to_json
from resim.recordings.content import content_hash, refuse_changed
from resim.verification.execution import verify
from resim.verification.inputs import VerificationRequest
from resim.verification.request import VerifyOptions as Wanted
from resim.verification.request import make_request
from resim.verification.suite import read_suite

ROOT = Path(__file__).parents[2]
SCENARIOS, BUILDS = ROOT / "scenarios", ROOT / "adfunc" / "builds"
HIGHWAY, CRITERIA = SCENARIOS / "suites" / "highway.toml", SCENARIOS / "criteria" / "highway.toml"
PILOT, REPLAY = BUILDS / "highway_pilot-1.0.toml", BUILDS / "replay-1.0.toml"
MODEL = ROOT / "adfunc" / "perception" / "proving_ground.json"
CORNER_CASE, OVERTAKE = SCENARIOS / "cut_in_brake", SCENARIOS / "overtake"
NEIGHBOURS = SCENARIOS / "neighbours"

VerifyOptions = Callable[..., tuple[int, str, str]]
WriteSuite = Callable[..., Path]


@pytest.fixture
def suite(tmp_path: Path) -> WriteSuite:
    """Write a suite of these folders, with more settings before the recordings."""

    def write(*folders: Path | str, more: str = "", name: str = "suite") -> Path:
        path = tmp_path / f"{name}.toml"
        entries = "".join(f'[[recording]]\nfolder = "{folder}"\n' for folder in folders)
        path.write_text(f'name = "{name}"\ncriteria = "{CRITERIA}"\n{more}\n{entries}')
        return path

    return write


def copied(drive: Path, to: Path) -> Path:
    """Copy a drive to a folder where it can be changed; it refers to the same map."""
    shutil.copytree(drive, to)
    settings = to / "recording.toml"
    lines = settings.read_text().splitlines()
    lines = [f'map = "{ROOT}/networks/proving_ground.xodr"' if s.startswith("map") else s for s in lines]
    settings.write_text("\n".join(lines) + "\n")
    return to


def result(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "verification.json").read_text())
    return found


def verdicts(out: Path) -> dict[str, str]:
    return {r["name"]: r["verdict"] for r in result(out)["recordings"]}


@pytest.mark.parametrize("agreement", ["1e-11", "0.0", "0.49", "0.995", "1.0", "nan", "-0.9"])
def test_an_agreement_that_nearly_anything_or_nothing_meets_is_refused(
    suite: WriteSuite, agreement: str
) -> None:
    with pytest.raises(InputError, match="agreement"):
        read_suite(suite(CORNER_CASE, more=f"agreement = {agreement}"))
    assert read_suite(suite(CORNER_CASE, more="agreement = 0.5")).file.agreement == 0.5


@pytest.mark.slow
def test_the_corner_case_on_the_truth_is_not_verified_because_of_the_sensor(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    code, said, error = call("verify", suite(CORNER_CASE), "--build", PILOT, "--out", out, "--workers", 1)
    assert code == 1
    assert "1 not verified" in error
    (found,) = result(out)["recordings"]
    assert (found["verdict"], found["way"], found["cause"]["step"]) == ("not verified", "rGT", "sensor")
    assert "first braking" in found["cause"]["text"]
    assert "sensor" in said
    assert [(out / report).is_file() for report in found["reports"]] == [True]
    assert {"verification.html", "junit.xml"} <= {path.name for path in out.iterdir()}


@pytest.mark.slow
def test_with_the_trained_model_the_corner_case_is_verified(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    """As soon as its seeds tell so, of all that the suite allows."""
    out, path = tmp_path / "out", suite(CORNER_CASE, more="agreement = 0.5")
    code, said, _ = call(
        "verify", path, "--build", PILOT, "--perception", MODEL, "--out", out, "--workers", 1
    )
    assert code == 0
    (found,) = result(out)["recordings"]
    assert (found["verdict"], found["way"]) == ("verified", "rGT+M")
    way = found["ways"]["rGT+M"]
    assert (way["share"]["count"], way["share"]["of"], way["share"]["confidence"]) == (16, 21, 0.9)
    assert way["share"]["low"] > 0.5
    assert "exact" in way["share"]["method"]
    assert ([s["seed"] for s in way["seeds"]], way["needed"]) == (list(range(21)), None)
    assert len(result(out)["inputs"]["seeds"]) == 200
    assert f"{way['share']['low']:.2f}" in said


@pytest.mark.slow
def test_seeds_that_do_not_tell_leave_it_undecided_which_is_not_good(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    out, path = tmp_path / "out", suite(CORNER_CASE, more="agreement = 0.7\nseeds = 12\nreports = 0")
    code, said, error = call(
        "verify", path, "--build", PILOT, "--perception", MODEL, "--out", out, "--workers", 1
    )
    assert (code, "1 undecided" in error) == (1, True)
    (found,) = result(out)["recordings"]
    assert (found["verdict"], found["cause"]["step"]) == ("undecided", "seeds")
    needed = found["ways"]["rGT+M"]["needed"]
    assert needed > 12
    assert f"some {needed} seeds would" in " ".join(said.split())
    assert "undecided" in (out / "verification.html").read_text()
    assert 'type="undecided"' in (out / "junit.xml").read_text()


@pytest.mark.slow
def test_the_mirrored_lane_check_is_found_with_scenario_and_second(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    out, name = tmp_path / "out", "slow_lead_left_taken"
    code, _, error = call(
        "verify", suite(OVERTAKE, NEIGHBOURS / name), "--build", BUILDS / "highway_pilot-1.2.toml", "--against", PILOT,
        "--out", out, "--workers", 1,
    )  # fmt: skip
    assert code == 1
    assert "lost" in error
    found = result(out)
    assert found["summary"]["worst"] == [name]
    worse = next(r for r in found["recordings"] if r["name"] == name)
    assert "no collision" in worse["pairs"][0]["lost"]
    assert 3.0 < worse["t"] < 6.0
    assert all((out / report).is_file() for report in worse["reports"])
    assert verdicts(out)["overtake"] == "same"


@pytest.mark.slow
def test_replay_is_verified_on_the_whole_highway_suite(call: VerifyOptions, tmp_path: Path) -> None:
    out = tmp_path / "out"
    call("verify", HIGHWAY, "--build", REPLAY, "--out", out, "--workers", 2)
    found = verdicts(out)
    assert len(found) >= 12
    assert {name: verdict for name, verdict in found.items() if verdict != "verified"} == {}


def test_a_broken_recording_stops_no_other_and_is_an_error(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    broken, out = copied(CORNER_CASE, tmp_path / "broken"), tmp_path / "out"
    (broken / "gt.csv").write_text("t,id\n0.0,ego\n")
    missing = tmp_path / "missing"
    code, _, error = call(
        "verify", suite(broken, missing, OVERTAKE), "--build", REPLAY, "--out", out, "--workers", 1
    )
    assert code == 2
    assert "broken" in error
    assert verdicts(out) == {"broken": "error", "missing": "error", "overtake": "verified"}
    assert all(r["error"] for r in result(out)["recordings"][:2])


def test_what_was_done_is_kept_and_only_what_changed_is_repeated(suite: WriteSuite, tmp_path: Path) -> None:
    changing, out = copied(OVERTAKE, tmp_path / "changing"), tmp_path / "out"
    path = suite(changing, NEIGHBOURS / "cut_in_only")

    def again() -> dict[str, bool]:
        told: dict[str, bool] = {}
        out.mkdir(exist_ok=True)
        wanted = make_request(read_suite(path), REPLAY, None, Wanted(), out)
        verify(wanted, out, out, workers=1, tell=lambda name, verdict, kept: told.update({name: kept}))
        return told

    assert again() == {"changing": False, "cut_in_only": False}
    assert again() == {"changing": True, "cut_in_only": True}
    with (changing / "recording.toml").open("a") as settings:
        settings.write("# another byte\n")
    assert again() == {"changing": False, "cut_in_only": True}


DAMAGE: dict[str, Callable[[str], str]] = {
    "verdict": lambda text: text.replace('"verdict": "verified"', '"verdict": "not verified"', 1),
    "figure": lambda text: text.replace('"weight": 1.0', '"weight": 2.0', 1),
    "key alone": lambda text: json.dumps({"key": json.loads(text)["key"]}),
    "no entry": lambda text: json.dumps({**json.loads(text), "entry": None}),
    "no object": lambda text: "[1]",
    "nested": lambda text: "[" * 100000,
    "no number": lambda text: text.replace('"weight": 1.0', '"weight": NaN', 1),
    "half": lambda text: text[: len(text) // 2],
}


@pytest.mark.slow
def test_a_result_that_is_not_as_it_was_written_is_made_again(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    path, out = suite(OVERTAKE), tmp_path / "out"
    command = ("verify", path, "--build", REPLAY, "--out", out, "--workers", 1)
    assert call(*command)[0] == 0
    (case,) = (out / "cases").glob("*.json")
    whole, found = case.read_text(), (out / "verification.json").read_bytes()
    damaged, wanted = [], VerificationRequest.model_validate(result(out)["inputs"])
    for name, damage in DAMAGE.items():
        assert damage(whole) != whole, name
        case.write_text(damage(whole))
        told: list[bool] = []
        verify(wanted, out, out, workers=1, tell=lambda name, verdict, kept, told=told: told.append(kept),
               damaged=damaged.append)  # type: ignore[misc]  # fmt: skip
        assert told == [False], name
    assert damaged == [case] * len(DAMAGE)
    case.write_text(DAMAGE["key alone"](whole))
    code, _, error = call(*command)
    assert (code, error.count("\n"), error.count("its recording is simulated again")) == (0, 3, 1)
    assert (out / "verification.json").read_bytes() == found


@pytest.mark.slow
def test_killed_and_repeated_it_gives_the_bytes_of_an_undisturbed_one_with_any_number_of_workers(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    path = suite(*(NEIGHBOURS / n for n in ("cut_in_only", "cut_in_softer", "slow_overtaking")), OVERTAKE)
    command = [sys.executable, "-m", "resim", "verify", path, "--build", REPLAY, "--workers", "1", "--out"]
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    process = subprocess.Popen([*map(str, command), str(killed)], cwd=ROOT, stdout=subprocess.DEVNULL)
    until = time.monotonic() + 60.0
    while not list((killed / "cases").glob("*.json")) and time.monotonic() < until:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not (killed / "verification.json").exists()
    assert call("verify", path, "--build", REPLAY, "--out", killed, "--workers", 1)[0] == 0
    assert call("verify", path, "--build", REPLAY, "--out", whole, "--workers", 2)[0] == 0
    assert (killed / "verification.json").read_bytes() == (whole / "verification.json").read_bytes()


BRAKING = """from resim.simulation.function.interface import Command

class Own:
    def __init__(self, a): self.a = a
    def reset(self, setup): pass
    def step(self, perceived): return Command(self.a, 0.0)
    def close(self): pass
"""


class StoppedError(Exception):
    """As if the process had been killed there."""


def braking(folder: Path, a: float) -> Path:
    """Write a build that brakes [m/s²] all the time, which the measured drive did not."""
    (folder / "own.py").write_text(BRAKING)
    path = folder / f"own{a:g}.toml"
    path.write_text(f'name = "own"\nversion = "{-a:g}"\nfactory = "own:Own"\n[parameters]\na = {a!r}\n')
    return path


def reported(
    path: Path, build: Path, out: Path, tell: Callable[..., None] = lambda *told: None
) -> dict[str, Any]:
    """Verify a suite driven by anybody; give the entries, with the `lost` reports."""
    out.mkdir(exist_ok=True)
    wanted = make_request(
        read_suite(path), build, None, Wanted(driven_by=("constant_velocity-1.0", "highway_pilot-1.0")), out
    )
    lost: dict[str, str] = {}
    found, _ = verify(wanted, out, out, workers=1, tell=tell, unreported=lost.__setitem__)
    return {"lost": lost, **{r["name"]: r for r in to_json(found)["recordings"]}}


@pytest.mark.slow
def test_a_report_is_of_the_result_that_links_it_whenever_it_was_stopped(
    suite: WriteSuite, tmp_path: Path
) -> None:
    path, out = suite(SCENARIOS / "rear_end", more='bases = ["GT"]'), tmp_path / "out"
    soft, hard = braking(tmp_path, -1.0), braking(tmp_path, -6.0)
    page = out / reported(path, soft, out)["rear_end"]["reports"][0]
    before = page.read_bytes()

    def stop(*told: object) -> None:
        raise StoppedError

    with pytest.raises(StoppedError):
        reported(path, hard, out, stop)
    assert list((out / "cases").glob("*.json"))  # the result is there, its report not yet
    assert not page.exists()  # and the other one leads nobody astray
    assert reported(path, hard, out)["rear_end"]["reports"] == ("reports/rear_end.html",)
    whole = page.read_bytes()
    assert b"own-6" in whole
    assert b"own-6" not in before
    page.write_bytes(before)
    reported(path, hard, out)
    assert b"own-6" in page.read_bytes()


def test_a_report_of_a_recording_that_has_changed_since_is_not_made_and_it_is_said(
    suite: WriteSuite, tmp_path: Path
) -> None:
    drive, out = copied(SCENARIOS / "rear_end", tmp_path / "rear_end"), tmp_path / "out"
    path = suite(drive, more='bases = ["GT"]')

    def change(*told: object) -> None:
        with (drive / "recording.toml").open("a") as settings:
            settings.write("# another byte\n")

    found = reported(path, braking(tmp_path, -1.0), out, change)
    assert found["rear_end"]["verdict"] == "not verified"
    assert found["rear_end"]["reports"] == ()
    assert not list((out / "reports").glob("*"))
    assert "its content has the hash" in found["lost"]["rear_end"]


@pytest.mark.slow
def test_replay_repeats_the_bytes_and_names_an_input_that_changed(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    drive, out = copied(OVERTAKE, tmp_path / "drive"), tmp_path / "out"
    assert call("verify", suite(drive), "--build", REPLAY, "--out", out, "--workers", 1)[0] == 0
    written = out / "verification.json"
    code, said, _ = call("verify", "--replay", written, "--workers", 1)
    assert code == 0
    assert "identical bytes, 1 recording" in said
    whole = written.read_text()
    written.write_text(whole.replace('"verdict": "verified"', '"verdict": "invalid"', 1))
    code, _, error = call("verify", "--replay", written, "--workers", 1)
    assert code == 2
    assert "verification.json: was changed after it was written" in error
    written.write_text(whole)
    edit(written, lambda said: said["recordings"][0].update(verdict="invalid"))
    code, _, error = call("verify", "--replay", written, "--workers", 1)
    assert code == 1
    assert "different bytes" in error
    with (drive / "recording.toml").open("a") as settings:
        settings.write("# another byte\n")
    code, _, error = call("verify", "--replay", written, "--workers", 1)
    assert code == 2
    assert "drive has changed" in error


def test_another_function_is_refused_unless_asked_for_by_name(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    out, other = tmp_path / "out", BUILDS / "highway_pilot-1.1.toml"
    code, _, error = call("verify", suite(OVERTAKE), "--build", other, "--out", out, "--workers", 1)
    assert code == 2
    assert "was driven by 'highway_pilot-1.0'" in error
    assert "--driven-by highway_pilot-1.0" in error
    assert not out.exists()
    asked_for = ("--driven-by", "highway_pilot-1.0", "--out", out, "--workers", 1)
    assert call("verify", suite(OVERTAKE), "--build", other, *asked_for)[0] == 0


def test_suite_new_writes_the_hash_of_every_recording_it_finds(call: VerifyOptions, tmp_path: Path) -> None:
    path = tmp_path / "new.toml"
    code, said, _ = call("suite", "new", NEIGHBOURS, "--criteria", CRITERIA, "--out", path)
    assert code == 0
    found = read_suite(path)
    drives = sorted(NEIGHBOURS.iterdir())
    assert f"{len(drives)} recordings" in said
    assert found.hashes == {drive.name: content_hash(drive) for drive in drives}
    code, _, error = call("suite", "new", NEIGHBOURS, "--criteria", CRITERIA, "--out", path)
    assert (code, "exists already" in error) == (2, True)
    code, _, error = call("suite", "new", BUILDS, "--criteria", CRITERIA, "--out", tmp_path / "none.toml")
    assert (code, "holds no recording" in error) == (2, True)


def test_the_hashes_of_the_highway_suite_are_those_of_the_recordings() -> None:
    found = read_suite(HIGHWAY)
    assert found.hashes == {name: content_hash(folder) for name, folder in found.folders.items()}
    assert set(found.folders) >= {drive.name for drive in NEIGHBOURS.iterdir()}


@pytest.mark.parametrize(
    ("more", "folder", "expected"),
    [
        ("seed_count = 3", str(OVERTAKE), "seed_count"),
        ("agreement = 1.5", str(OVERTAKE), "agreement"),
        ("agreement = 1e-11", str(OVERTAKE), "agreement"),
        ("agreement = 1.0", str(OVERTAKE), "agreement"),
        (f'seeds = 28\nperception = "{MODEL}"', str(OVERTAKE), "seeds = 29 or more"),
        ('vary = ["colour"]', str(OVERTAKE), "colour"),
        ("", "nothing/*", "there is no recording"),
    ],
)
def test_a_suite_that_is_wrong_is_refused_with_the_reason(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path, more: str, folder: str, expected: str
) -> None:
    path, out = suite(folder, more=more), tmp_path / "out"
    code, _, error = call("verify", path, "--build", REPLAY, "--out", out)
    assert code == 2
    assert expected in error
    assert str(path) in error
    assert not out.exists()


def test_a_recording_that_is_not_the_one_of_the_suite_is_an_error(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    path, out = suite(OVERTAKE), tmp_path / "out"
    path.write_text(path.read_text() + f'hash = "{64 * "0"}"\n')
    code, _, error = call("verify", path, "--build", REPLAY, "--out", out, "--workers", 1)
    assert code == 2
    assert "has the hash" in error


def test_a_recording_with_two_hashes_is_refused(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    path, out = suite(OVERTAKE), tmp_path / "out"
    text = path.read_text() + f'hash = "{64 * "0"}"\n'
    folder = f"{OVERTAKE.parent}/./{OVERTAKE.name}"
    path.write_text(text + f'[[recording]]\nfolder = "{folder}"\nhash = "{content_hash(OVERTAKE)}"\n')
    code, _, error = call("verify", path, "--build", REPLAY, "--out", out)
    assert code == 2
    assert "is a duplicate, with two hashes" in error


def test_a_table_of_any_size_has_a_hash(tmp_path: Path) -> None:
    """One of over 100 MB was read, and verified under no hash, so that it could be changed afterwards."""
    drive = copied(OVERTAKE, tmp_path / "large")
    before = content_hash(drive)
    with (drive / "gt.csv").open("a") as table:
        table.write("\n" * 101_000_000)
    assert content_hash(drive) != before


def test_a_recording_that_had_no_hash_when_the_verification_began_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="could not be read at the start"):
        refuse_changed(OVERTAKE, None)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems take no such names")
def test_a_name_that_is_no_utf_8_is_refused_before_anything_is_done(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    strange, out = os.fsdecode(b"drive\xff\xfe"), tmp_path / "out"
    drive = copied(OVERTAKE, tmp_path / strange)
    build, found = ("--build", REPLAY), suite("drive*")
    orders: list[tuple[object, ...]] = [
        ("verify", found, *build, "--out", out),
        ("verify", suite(OVERTAKE, name="plain"), *build, "--out", out / strange),
        ("run", drive, *build, "--out", out), ("assess", OVERTAKE, "--out", out / strange),
        ("suite", "new", tmp_path, "--criteria", CRITERIA, "--out", tmp_path / "new.toml"),
    ]  # fmt: skip
    for order in orders:
        code, _, error = call(*order)
        assert (code, error.count("\n")) == (2, 1), order
        assert "this name is not UTF-8" in error, order
    assert not out.exists()
    assert not (tmp_path / "new.toml").exists()


@pytest.mark.slow
def test_a_vehicle_model_is_recorded_and_its_results_are_its_own(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    out, told = tmp_path / "out", {}
    for vehicle in ("kinematic", "single-track", "kinematic"):
        call("verify", suite(OVERTAKE), "--build", PILOT, "--out", out, "--vehicle", vehicle)
        found = result(out)
        assert found["inputs"]["vehicle"] == vehicle
        told.setdefault(vehicle, []).append(found["recordings"][0]["cases"])
    assert told["kinematic"][0] == told["kinematic"][1]
    assert told["kinematic"][0]["rGT"] != told["single-track"][0]["rGT"]
    code, _, error = call("verify", suite(OVERTAKE), "--build", PILOT, "--out", out, "--vehicle", "boat")
    assert code == 2
    assert "there is no vehicle model 'boat'" in error


def test_the_verification_of_another_suite_or_build_is_not_replaced(
    call: VerifyOptions, suite: WriteSuite, tmp_path: Path
) -> None:
    out, mine = tmp_path / "out", suite(OVERTAKE)
    assert call("verify", mine, "--build", REPLAY, "--out", out, "--workers", 1)[0] == 0
    before = {path: path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}
    for other, build in ((suite(OVERTAKE, name="other"), REPLAY), (mine, PILOT)):
        code, _, error = call("verify", other, "--build", build, "--out", out, "--workers", 1)
        assert (code, "holds the verification of replay-1.0 on suite, not of " in error) == (2, True)
        assert {path: path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()} == before
    assert call("verify", mine, "--build", REPLAY, "--out", out, "--workers", 1)[0] == 0
