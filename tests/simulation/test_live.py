"""States of a simulation as it runs: what is told, how often, and that nothing follows from it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from resim.core.watched import LIVE_VARIABLE
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario
from resim.simulation import live
from resim.simulation.case import Case
from resim.simulation.direct import Direct
from resim.simulation.engine import Engine
from resim.simulation.function.interface import Build
from resim.simulation.perception import Worlds
from resim.simulation.sumo.engine import Sumo


@pytest.fixture
def case(described: Callable[..., Scenario], network: RoadNetwork, build: Callable[[str], Build]) -> Case:
    return Case(described("cut_in_brake"), network, build("highway_pilot"), Direct())


@pytest.mark.parametrize("engine", [Direct(), Sumo()])
def test_a_watched_drive_is_the_same_and_what_is_told_is_as_in_its_result(
    engine: Engine,
    case: Case,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    set_constant: Callable[..., None],
) -> None:
    (one,) = engine.drive([case])
    file = tmp_path / "live.json"
    monkeypatch.setenv(LIVE_VARIABLE, str(file))
    set_constant(live, "EVERY", 0.0)
    (other,) = engine.drive([case])
    assert one.fingerprint() == other.fingerprint()
    state, truth = json.loads(file.read_text("utf-8")), other.truth
    k = int(abs(truth.t - state["t"]).argmin())
    assert (state["t"], state["end"]) == (pytest.approx(truth.t[k]), pytest.approx(truth.t[-1], abs=0.05))
    assert (state["build"], Path(state["map"])) == (case.build.label, case.network.path)
    ids = truth.ids.tolist()
    there = {n for n, valid in zip(ids, truth.valid[:, k], strict=True) if valid}
    assert state["boxes"][0][0] == case.scenario.ego.id
    assert {box[0] for box in state["boxes"]} == there
    for name, kind, x, y, heading, v, length, width in state["boxes"]:
        n = ids.index(name)
        assert (kind, length, width) == (
            truth.kind[n],
            pytest.approx(truth.length[n]),
            pytest.approx(truth.width[n]),
        )
        known = truth.x[n, k], truth.y[n, k], truth.heading[n, k], truth.v[n, k]
        assert (x, y, heading, v) == pytest.approx(known, abs=1e-3)
    assert [f.name for f in tmp_path.iterdir()] == ["live.json"]


def test_a_file_that_cannot_be_written_ends_no_drive(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(LIVE_VARIABLE, str(tmp_path / "absent" / "live.json"))
    assert case.drive().end == "duration"


def test_states_come_at_most_so_often_of_whom_is_there(case: Case, tmp_path: Path) -> None:
    file = tmp_path / "live.json"
    states, ids, one = live.LiveStates(case, str(file), 7.0), np.array(["a", "b", "c"]), np.ones(3)

    def show(t: float) -> float:
        position = np.array([3.0 + 1.0j, np.nan, 1e3 + 0.0j])
        ego, z = np.zeros((1, 6)), np.full(1, np.nan)
        states.show(Worlds(t, ego, ids, ids, position, 7.0 * one, one, one, one, None, z))
        return float(json.loads(file.read_text("utf-8"))["t"])

    assert (show(1.0), show(1.01)) == (1.0, 1.0)
    assert [box[0] for box in json.loads(file.read_text("utf-8"))["boxes"][1:]] == ["a", "c"]
    time.sleep(1.5 * live.EVERY)
    assert show(1.02) == 1.02
    states = live.LiveStates(case, str(file), 7.0)  # of the next drive: at most so often all the same
    assert show(0.0) == 1.02
