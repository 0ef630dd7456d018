from __future__ import annotations

import json

import numpy as np
import pytest

from resim.assess.risk import PUBLISHED
from resim.assess.risk.prediction import CTRA, WALKING, Surfaces, Walking, prediction, read_prediction
from resim.core.errors import InputError
from resim.core.tracks import KINDS

CAR = {
    "a_most": 3.0, "v_half": 14.0, "sigma_a0": 0.2, "sigma_a1": 0.15, "lateral_most": 4.46, "sigma_lateral": 0.14,
    "sigma_w1": 0.2, "v_least": 1.0, "v_most": 40.0, "a_range": [-6.0, 6.0], "lateral_range": [-4.46, 4.46],
}  # fmt: skip


@pytest.fixture
def written(tmp_path):
    """Write a set of these kinds; gives the file."""

    def write(kinds, **more):
        path = tmp_path / "mine.json"
        path.write_text(json.dumps({"name": "mine", "kinds": kinds, **more}))
        return path

    return write


def states(count, seed=0):
    """States v, a0, w0, each (4, count)."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 30, (4, count)), rng.normal(0, 2, (4, count)), rng.normal(0, 0.1, (4, count))


def test_the_published_set_has_every_kind_and_the_published_car():
    found = prediction()
    assert found.name == "published"
    assert set(found.motions) == set(found.provenance) == set(KINDS)
    state = states(len(KINDS))
    kinds = np.array(KINDS)
    inputs, covered = found.inputs(kinds, *state), found.covers(kinds, *state)
    assert inputs.shape == (4, len(KINDS), 4)
    assert (inputs[..., [1, 3]] > 0.0).all()
    for name in ("car", "van", "unknown"):
        k = KINDS.index(name)
        own = [x[:, k] for x in state]
        np.testing.assert_array_equal(inputs[:, k], PUBLISHED.inputs(*own))
        np.testing.assert_array_equal(covered[:, k], PUBLISHED.covers(*own))
    assert found.of("trailer") == found.of("truck") != PUBLISHED
    assert all("not fitted" in found.provenance[kind] for kind in KINDS if kind != "car")


def test_pedestrians_walk_and_all_others_keep_their_inputs():
    motion = prediction().motion(np.array(["car", "pedestrian", "bicycle", "no such kind"]))
    assert motion.tolist() == [CTRA, WALKING, CTRA, CTRA]
    assert motion.dtype == np.uint8


def test_who_stands_steps_off_in_any_direction_and_who_walks_goes_on():
    found = prediction()
    kinds = np.array(["pedestrian", "pedestrian"])
    (still, walking) = found.inputs(kinds, np.array([0.0, 1.4]), np.array([0.0, 0.3]), np.array([5.0, 0.1]))
    model = found.of("pedestrian")
    assert isinstance(model, Walking)
    assert still.tolist() == [0.0, model.sigma_still, 0.0, model.sigma_still]
    assert walking == pytest.approx([0.295, model.sigma_along, 0.139, model.sigma_across], abs=1e-3)


def test_no_mean_is_beyond_what_the_kind_can_do():
    """Whatever noise a track has: the means saturate."""
    found = prediction()
    kinds = np.array(KINDS)
    v, wild = np.full(len(KINDS), 10.0), np.full(len(KINDS), 30.0)
    mu = found.inputs(kinds, v, wild, wild)[:, [0, 2]]
    for row, kind in zip(mu, KINDS, strict=True):
        model = found.of(kind)
        most = model.lateral_most / 10.0 if isinstance(model, Surfaces) else model.a_most
        assert row[0] <= model.a_most
        assert row[1] <= most
    assert not found.covers(kinds, v, wild, wild).any()


def test_a_file_of_ones_own_goes_before_the_published_and_like_follows_it(written):
    found = read_prediction(written({"car": {"provenance": "mine", "ctra": CAR}}))
    assert found.name == "mine"
    assert found.of("car") == found.of("van") == Surfaces(**CAR)
    assert found.of("truck") == prediction().of("truck")
    assert found.provenance["car"] == "mine"


@pytest.mark.parametrize(
    ("kinds", "told"),
    [
        ({"car": {"provenance": "", "ctra": {**CAR, "a_most": -1.0}}}, "kinds.car.ctra.a_most: .*found '-1.0'"),
        ({"car": {"provenance": "", "ctra": {**CAR, "v_most": float("nan")}}}, "kinds.car.ctra.v_most"),
        ({"car": {"provenance": "", "ctra": {**CAR, "a_range": [1.0, -1.0]}}}, "a_range: .*lower bound first"),
        ({"car": {"provenance": "", "ctra": {**CAR, "mass": 1.0}}}, "kinds.car.ctra.mass"),
        ({"car": {"provenance": "", "ctra": {"a_most": 1.0}}}, "kinds.car.ctra.v_half: Field required"),
        ({"car": {"provenance": ""}}, "kinds.car: .*expected one of ctra, walking and like"),
        ({"car": {"provenance": "", "like": "horse"}}, "kinds.car.like"),
        ({"car": {"provenance": "", "like": "van"}}, "car like van like car"),
        ({"horse": {"provenance": "", "ctra": CAR}}, "kinds.horse"),
        ({}, "kinds"),
    ],
)  # fmt: skip
def test_a_wrong_field_is_named(written, kinds, told):
    with pytest.raises(InputError, match=told) as e:
        read_prediction(written(kinds))
    assert "mine.json" in str(e.value)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "[]", "\xff\xfe", '{"name": 1}'])
def test_no_text_ends_in_anything_but_an_input_error(tmp_path, text):
    path = tmp_path / "mine.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"mine\.json"):
        read_prediction(path)


def test_a_name_or_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(InputError, match=r"no set 'fast'.*published"):
        prediction("fast")
    with pytest.raises(InputError, match="Check the path"):
        read_prediction(tmp_path / "none.json")
