"""Parts of perception: adding one changes no number that the others draw."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from perception.worlds import everything, look, model, ring, same, standing, steps, traffic

from resim.perception import model as models
from resim.perception.fields import ParameterGroup
from resim.perception.model import PerceptionModel
from resim.perception.parts.definition import PerceptionPart, RunningPart
from resim.perception.parts.registry import PARTS
from resim.perception.runtime import sensor
from resim.perception.runtime.sensor import Sensor
from resim.perception.runtime.streams import PartStreams
from resim.simulation.function.interface import EgoState, Perceived
from resim.simulation.perception import World


class Restless(RunningPart):
    """Draws whenever it can, of its own and of each object, and puts an object of its own on every list."""

    def __init__(self, streams: PartStreams) -> None:
        self.streams, self.rng, self.drawn = streams, streams.of(), 0.0

    def localise(self, ego: EgoState, step: float) -> EgoState:
        self.drawn += self.rng.standard_normal(3).sum()
        return ego

    def change(self, seen: Perceived, world: World, step: float) -> Perceived:
        for name in seen.ids.tolist():
            self.drawn += self.streams.of(name).standard_normal(5).sum()
        more = [np.append(getattr(seen, f.name), "ghost" if f.name == "ids" else "car") for f in LISTS[:2]]
        more += [np.append(getattr(seen, f.name), self.rng.uniform(1.0, 2.0)) for f in LISTS[2:]]
        return Perceived(seen.t, seen.ego, *more)


LISTS = fields(Perceived)[2:]
RESTLESS = PerceptionPart(
    name="provenance", parameters=str, make=lambda of, streams: Restless(streams)
)  # under a name that every model has


@pytest.mark.parametrize("place", range(len(PARTS) + 1))
def test_a_new_part_leaves_the_draws_of_all_others_bit_for_bit(
    place: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = look(Sensor(everything()), traffic(6), steps(16.0), seed=4)
    monkeypatch.setattr(sensor, "PARTS", (*PARTS[:place], RESTLESS, *PARTS[place:]))
    after = look(Sensor(everything()), traffic(6), steps(16.0), seed=4)
    assert any("#" in name for p in before for name in p.ids.tolist())
    assert any(name.startswith("false") for p in before for name in p.ids.tolist())
    assert all("ghost" in p.ids for p in after)
    assert [_bits(p) for p in before] == [_bits(p) for p in after]


@pytest.mark.parametrize("gone", ["id_switch", "false_objects", "ego"])
def test_a_part_less_leaves_the_draws_of_the_others(gone: str) -> None:
    whole = everything().model_dump(by_alias=True)
    fewer = PerceptionModel.model_validate({k: v for k, v in whole.items() if k != gone})
    one, two = (look(Sensor(m), traffic(6), steps(16.0), seed=4) for m in (everything(), fewer))
    assert not all(same(a, b) for a, b in zip(one, two, strict=True))
    for a, b in zip(one, two, strict=True):
        real = [[k for k, n in enumerate(p.ids.tolist()) if not n.startswith("false")] for p in (a, b)]
        if gone != "ego":
            assert a.ego == b.ego
        if gone != "id_switch":
            assert a.ids[real[0]].tolist() == b.ids[real[1]].tolist()
        if a.ego == b.ego:  # a list that stands is told from where the EGO believes to be
            for name in ("x_ego", "y_ego", "heading_ego", "v", "length", "width"):
                assert getattr(a, name)[real[0]].tobytes() == getattr(b, name)[real[1]].tobytes()
        if gone != "false_objects":
            assert a.ids[len(real[0]) :].tolist() == b.ids[len(real[1]) :].tolist()


def test_errors_do_not_depend_on_detection() -> None:
    error = {"longitudinal": {"drift": {"constant": 0.2}, "noise": {"constant": 0.1}}}
    seldom = {
        "range_edges": (0, 100), "bearing_edges": (0, 4), "occlusion_edges": (0, 1),
        "loss": (((2.0,),),), "gain": (((2.0,),),),
    }  # fmt: skip
    always, lost = (
        look(Sensor(model(errors=error, **more)), ring(4), steps(20.0), standing)
        for more in ({}, {"detection": seldom})
    )
    assert 0.4 < sum(len(p.ids) for p in lost) / sum(len(p.ids) for p in always) < 0.6
    for a, b in zip(always, lost, strict=True):
        there = [a.ids.tolist().index(name) for name in b.ids.tolist()]
        assert a.x_ego[there].tobytes() == b.x_ego.tobytes()


def test_a_part_has_a_group_in_models_and_is_in_no_file_that_does_not_name_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Haze(ParameterGroup):
        reach: float = 1.0

    monkeypatch.setattr(
        models, "PARTS", (*PARTS, PerceptionPart(name="haze", parameters=Haze, make=lambda of, streams: None))
    )
    groups: dict[str, Any] = models._groups()
    assert list(groups) == ["haze"]
    hazy = models.create_model("hazy", __base__=PerceptionModel, **groups)
    said = {"schema": "resim-perception-1", "name": "test"}
    assert hazy.model_validate(said).hash == model().hash  # type: ignore[attr-defined]
    assert hazy.model_validate(said | {"haze": {"reach": 2.0}}).model_dump()["haze"] == {"reach": 2.0}


def test_a_part_cannot_have_the_name_of_something_else(monkeypatch: pytest.MonkeyPatch) -> None:
    late = PerceptionPart(name="latency", parameters=float, make=lambda of, streams: None)
    monkeypatch.setattr(models, "PARTS", (*PARTS, late))
    with pytest.raises(ValueError, match="'latency'"):
        models._groups()


def _bits(seen: Perceived) -> tuple[object, ...]:
    """The list without the ghost, numbers to the bit."""
    kept = seen.ids != "ghost"
    ids, kind, *values = (getattr(seen, f.name)[kept] for f in LISTS)
    return seen.t, seen.ego, ids.tolist(), kind.tolist(), *(value.tobytes() for value in values)
