"""How far a verified drive can be varied: the range ends where a simulation is not as the drive, in whatever."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT

from resim.metrics.criteria import Criteria, read_criteria
from resim.perception.model import read_model
from resim.perception.runtime.sensor import Sensor
from resim.recordings.checked import load_checked
from resim.resimulation.assessed import AssessmentOptions
from resim.resimulation.assessments import assess_resimulation
from resim.resimulation.compute_outcome import outcomes, seed_outcomes
from resim.resimulation.result import Resimulation, ResimulationOptions
from resim.resimulation.run import prepare, resimulate, runs_on_gt
from resim.scenario.variation import vary
from resim.simulation.direct import Direct
from resim.simulation.function.interface import freeze_build, load_build
from resim.verification.sequential import SequentialTest
from resim.verification.tolerance import Tolerances
from resim.verification.validity_runs import DemandedShare, unlike_over_seeds
from resim.verification.verify import COMPARED, Demands, verify_recording

OPTIONS = ResimulationOptions(bases=("GT",), engine=Direct())


def criteria(home: Path, measure: str, limit: str) -> Criteria:
    text = f'name = "c"\n[[criterion]]\nname = "asked"\nmeasure = "{measure}"\n{limit}\n'
    (home / "c.toml").write_text(text, encoding="utf-8")
    return read_criteria(home / "c.toml")


def build(name: str):  # type: ignore[no-untyped-def]
    return load_build(freeze_build(ROOT / "adfunc" / "builds" / f"{name}-1.0.toml"))


def test_a_range_ends_where_the_ego_collides_though_no_criterion_asks(tmp_path: Path) -> None:
    """40 m behind somebody as fast, who is hit within 8 s where slower by more than (40 - 4.7) / 8 = 4.41 m/s."""
    t = np.arange(0.0, 8.01, 0.04).round(2)
    size = {"y": -1.75, "heading": 0.0, "v": 20.0, "length": 4.7, "width": 1.9, "kind": "car"}
    rows = [
        pd.DataFrame({"t": t, "id": who, "x": at + 20.0 * t, **size})
        for who, at in (("ego", 200.0), ("1", 240.0))
    ]
    pd.concat(rows).to_csv(tmp_path / "gt.csv", index=False)
    road = ROOT / "networks" / "proving_ground.xodr"
    told = f'name = "d"\nmap = "{road}"\nego = "ego"\nbuild = "constant_velocity-1.0"\n'
    (tmp_path / "recording.toml").write_text(told, encoding="utf-8")
    demands = Demands(criteria(tmp_path, "speed over limit", "above = 0.83"), Tolerances(), vary=("speed",))
    found = verify_recording(load_checked(tmp_path), build("constant_velocity"), demands, OPTIONS)
    assert found.verdict == "verified"
    (speed,) = found.validity
    assert speed.low.amount == pytest.approx(-4.41, abs=0.05)
    assert (speed.low.flips, speed.low.others) == ((), ("the EGO collides",))
    assert (speed.high.amount, speed.high.flips, speed.high.others) == (6.0, (), ())


@pytest.mark.slow
def test_a_change_has_to_show_the_agreement_that_the_verdict_shows(tmp_path: Path) -> None:
    """Most of the seeds are as measured at such a change, and fewer than are demanded."""
    model = read_model(ROOT / "adfunc" / "perception" / "proving_ground.json")
    recording = load_checked(ROOT / "scenarios" / "neighbours" / "lead_slows")
    asked = criteria(tmp_path, "longitudinal acceleration", "below = -2.93")
    bare = Resimulation(prepare(recording, ("GT",)), build("highway_pilot"), OPTIONS)
    how = AssessmentOptions(criteria=asked, only=COMPARED)
    whole = resimulate(recording, bare.build, OPTIONS)
    measured = outcomes(whole, assess_resimulation(whole, how))["GT"]
    sensor, demanded = Sensor(model), DemandedShare(range(60), SequentialTest(0.9, 60))
    assert not unlike_over_seeds(bare, sensor, measured, how, demanded)
    scenario = vary(bare.described["GT"], bare.network, "1", "gap", 5.0)
    changed = replace(bare, prepared=replace(bare.prepared, described={"GT": scenario}))
    some = range(20)
    each = seed_outcomes(list(zip(runs_on_gt(changed, [(sensor, s) for s in some]), some, strict=True)), how)
    (most, count), *_ = Counter(one.kpis["asked"].outcome for one in each).most_common()
    assert (most, count < 20) == (measured.kpis["asked"].outcome, True)
    found = unlike_over_seeds(changed, sensor, measured, how, demanded)
    assert found.flips == ("asked",)
    assert "seeds are as measured, which does not show more than 0.9 of all" in found.others[-1]
