"""An EGO that turns off at a crossing: who follows its route, who leaves it, and where that is told."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from junction import write_junction
from turns import driven, turns

from resim.core.tracks import Tracks
from resim.recordings import Recording, write_recording
from resim.road.opendrive import load
from resim.simulation.function.interface import load_build

CROSSING = Path(__file__).parents[3] / "shared/data/xodr/esmini/fabriksgatan.xodr"
PACE = 7.0

STRAIGHT = """
from resim.simulation.function.interface import Command

class Own:
    def reset(self, setup):
        self.way = setup.start
        assert setup.route.steps[0] == ({first!r},), setup.route
        assert set().union(*setup.route.steps) >= {roads!r}, setup.route
        assert set(setup.road.roads) >= set(setup.route.roads)

    def step(self, perceived):
        return Command(0.0, 0.0)

    def close(self):
        pass
"""


@pytest.fixture(scope="module", params=["ours", "fabriksgatan"])
def crossing(request, tmp_path_factory) -> Path:
    """A crossing of our own, and a real one where it is at hand."""
    if request.param == "ours":
        return write_junction(tmp_path_factory.mktemp("map") / "junction.xodr")
    if not CROSSING.is_file():
        pytest.skip("no shared data")
    return CROSSING


@pytest.fixture(scope="module")
def turn(crossing):
    """The sharpest turn of the crossing whose way goes on elsewhere without it: what a drive along it passes."""
    net = load(crossing)
    return max(
        ((*driven(net, one, far=60.0), one) for one in turns(net)),
        key=lambda drive: abs(np.unwrap(drive[2])[-1] - drive[2][0]),
    )


@pytest.fixture
def recording(turn, crossing, tmp_path) -> Path:
    """A drive along the turn, as the EGO of a recording."""
    x, y, heading, _ = turn
    s = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
    t = np.arange(0.0, s[-1] / PACE, 0.04)
    at = PACE * t
    rows = [np.interp(at, s, values)[None] for values in (x, y, np.unwrap(heading))]
    tracks = Tracks(
        t=t, ids=np.array(["ego"]), kind=np.array(["car"]), x=rows[0], y=rows[1], heading=rows[2],
        v=np.full((1, len(t)), PACE), length=np.array([4.5]), width=np.array([1.8]),
        valid=np.ones((1, len(t)), dtype=bool),
    )  # fmt: skip
    write_recording(
        Recording(name="turn", map=crossing, ego="ego", gt=tracks, gt_rate=25.0), tmp_path / "turn"
    )
    return tmp_path / "turn"


def test_the_shipped_functions_turn_off_where_the_measured_ego_did(recording, call, tmp_path):
    import resim

    for name in ("idm", "constant_velocity"):
        build = Path(__file__).parents[2] / f"adfunc/builds/{name}-1.0.toml"
        report = resim.resimulate(recording, build).report
        assert report.end["rGT"] == "duration"
        assert report.left_route == {"rGT": None}
        assert "leave_route" not in report.decision["rGT"]
        assert report.end_position_error["rGT"] < 15.0


def test_who_does_not_turn_leaves_the_route_and_it_is_told(turn, recording, write_build, call, tmp_path):
    (before, _), (inside, _), _ = turn[3]
    build = write_build(STRAIGHT.format(first=before[0], roads={before[0], inside}), name="Own")
    assert load_build(build).label
    status, out, _ = call("run", recording, "--build", build, "--out", tmp_path / "out")
    assert status == 0
    assert "rGT left the measured route at " in out
    assert "leave_route" in out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "leave route" in page
    assert "leaves the measured route" in page  # a mark of the player

    import resim

    report = resim.resimulate(recording, build).report
    left = report.left_route["rGT"]
    assert left is not None
    assert 0.0 < left < 20.0
    assert "leave_route" not in report.decision["GT"]
    assert any(w == f"rGT left the measured route at {left:.1f} s" for w in report.warnings)


@pytest.mark.slow
def test_who_leaves_the_route_is_not_verified(turn, recording, write_build, call, tmp_path):
    (before, _), (inside, _), _ = turn[3]
    build = write_build(STRAIGHT.format(first=before[0], roads={before[0], inside}), name="Own")
    criteria = Path(__file__).parents[2] / "scenarios/criteria/highway.toml"
    suite = tmp_path / "suite.toml"
    status, out, err = call("suite", "new", recording.parent, "--criteria", criteria, "--out", suite)
    assert status == 0, out + err
    status, out, err = call(
        "verify",
        suite,
        "--build",
        build,
        "--driven-by",
        "unknown",
        "--out",
        tmp_path / "out",
        "--workers",
        "1",
    )
    assert status == 1, out + err
    told = json.loads((tmp_path / "out" / "verification.json").read_text(encoding="utf-8"))
    assert "leave_route" in told["recordings"][0]["decision"]["rGT"]
    assert "leave route" in (tmp_path / "out" / "verification.html").read_text(encoding="utf-8")
