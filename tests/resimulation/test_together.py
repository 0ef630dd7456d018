"""Drives that are assessed together are, to the bit, what each is alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from conftest import DATA, ROOT

from resim.metrics.assessment import Assessment
from resim.metrics.criteria import read_criteria
from resim.metrics.measures.registry import MEASURES
from resim.perception.model import read_model
from resim.perception.runtime.sensor import Sensor
from resim.recordings import Recording, read_commonroad, read_recording
from resim.resimulation import ResimulationOptions
from resim.resimulation.assessed import AssessmentOptions
from resim.resimulation.assessments import drive_block
from resim.resimulation.blocks import Block, assess_block, assess_blocks
from resim.resimulation.result import Resimulation
from resim.resimulation.run import prepare, runs_on_gt
from resim.simulation.function.interface import load_build
from resim.sweeps.engines import ENGINES

HOW = AssessmentOptions(criteria=read_criteria(ROOT / "scenarios/criteria/highway.toml"), rate=5.0)


def us_101() -> Recording:
    at = DATA / "ngsim" / "USA_US101-12_1_T-1.xml"
    if not at.is_file():
        pytest.skip("shared data is not there")
    return read_commonroad(at, map=at.with_suffix(".xodr"), ego="296")


def blocks(recording: Recording, seeds: Sequence[int]) -> tuple[list[Block], Resimulation]:
    """Drives with the trained model, some of which end at a collision."""
    build = load_build(ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml")
    result = Resimulation(prepare(recording, ()), build, ResimulationOptions(engine=ENGINES["direct"]))
    sensor = Sensor(read_model(ROOT / "adfunc" / "perception" / "proving_ground.json"))
    gt, out = result.described["GT"], []
    for seed, one in zip(seeds, runs_on_gt(result, [(sensor, seed) for seed in seeds]), strict=True):
        drive, refit, _ = one.of(seed)
        assert refit is not None
        made = replace(refit, objects=gt.objects)
        out.append(drive_block(drive, made, result.prepared.doubts["GT"], gt))
    return out, result


def same(one: Assessment, other: Assessment) -> None:
    assert one.measures.keys() == other.measures.keys()
    for name, values in one.measures.items():
        assert values.value.tobytes() == other.measures[name].value.tobytes(), name
        assert values.state.tobytes() == other.measures[name].state.tobytes(), name
    for name in ("r_to", "r_ind", "r_dep", "collision", "ttc", "ttr"):
        assert getattr(one.risk, name).tobytes() == getattr(other.risk, name).tobytes(), name
    assert one.verdicts == other.verdicts


@pytest.mark.parametrize("of", [lambda: read_recording(ROOT / "scenarios" / "cut_in_brake"), us_101])
@pytest.mark.parametrize("path", ["plan", "state"])
def test_every_measure_is_what_it_is_alone(of: object, path: str) -> None:
    each, result = blocks(of(), range(5))  # type: ignore[operator]
    each[1] = replace(
        each[1], scenario=replace(each[1].scenario, duration=3.3)
    )  # other times than the others
    how = replace(HOW, path=path)  # type: ignore[arg-type]
    for block, found in zip(each, assess_blocks(each, result.network, how), strict=True):
        same(assess_block(block, result.network, how), found)


def test_who_drives_very_fast_changes_nobody_elses_gap() -> None:
    each, result = blocks(read_recording(ROOT / "scenarios" / "cut_in_brake"), range(2))
    ego = each[1].scenario.ego
    v = type(ego.v)(ego.v.c * 4.0, ego.v.x)  # its least distance is more than is usually looked for
    each[1] = replace(each[1], plans=(), scenario=replace(each[1].scenario, ego=replace(ego, v=v)))
    assert v(0.0) * 3.6 / 2.0 > 150.0
    for block, found in zip(each, assess_blocks(each, result.network, HOW), strict=True):
        same(assess_block(block, result.network, HOW), found)


def test_a_measure_of_measures_says_so() -> None:
    """Else it is computed drive by drive, in a sweep as well."""
    asked: set[str] = set()

    class Asking:
        def __init__(self, inputs: object) -> None:
            self.inputs = inputs

        def __getattr__(self, name: str) -> object:
            if name == "measure":
                return lambda of: (asked.add(of), self.inputs.measure(of))[1]  # type: ignore[attr-defined]
            return getattr(self.inputs, name)

    each, result = blocks(read_recording(ROOT / "scenarios" / "cut_in_brake"), range(1))
    from resim.resimulation.blocks import _scenes_of

    inputs = _scenes_of(each[0], result.network, HOW).inputs
    for measure in MEASURES:
        asked.clear()
        measure.compute(Asking(inputs))  # type: ignore[arg-type]
        assert asked == set(measure.made_of), measure.name
    assert np.isfinite(inputs.risk.r_ind).any()


def test_as_many_as_there_may_be_are_assessed_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    each, result = blocks(read_recording(ROOT / "scenarios" / "cut_in_brake"), range(5))
    whole = assess_blocks(each, result.network, HOW)
    monkeypatch.setattr("resim.resimulation.blocks.TOGETHER", 2)
    for one, found in zip(whole, assess_blocks(each, result.network, HOW), strict=True):
        same(one, found)
    assert assess_blocks([], result.network, HOW) == []
