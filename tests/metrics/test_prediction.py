from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from resim.cli.prediction import fit_prediction
from resim.core.errors import InputError, ResimError
from resim.core.geometry import wrap_angle
from resim.core.tracks import KINDS, Tracks
from resim.metrics.risk import PUBLISHED
from resim.metrics.risk.fitting import MotionPoints, free, log_likelihood, refit
from resim.metrics.risk.prediction import (
    CTRA,
    WALKING,
    Surfaces,
    WalkerMotion,
    prediction,
    read_prediction,
)
from resim.recordings import Recording, write_recording

ROAD = Path(__file__).parents[2] / "networks" / "proving_ground.xodr"

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


@pytest.mark.parametrize(("name", "own"), [("ngsim", {"car"}), ("mcity", {"car", "pedestrian"})])
def test_sets_that_were_fitted_say_to_what_and_hold_nothing_else(name, own):
    found, published = prediction(name), prediction()
    for kind in KINDS:
        followed = "car" if kind in ("van", "unknown") else kind
        assert (found.of(kind) == published.of(kind)) == (followed not in own)
        assert found.provenance[kind].startswith("fitted to") == (kind in own)


def test_pedestrians_walk_and_all_others_keep_their_inputs():
    motion = prediction().motion(np.array(["car", "pedestrian", "bicycle", "no such kind"]))
    assert motion.tolist() == [CTRA, WALKING, CTRA, CTRA]
    assert motion.dtype == np.uint8


def test_who_stands_steps_off_in_any_direction_and_who_walks_goes_on():
    found = prediction()
    kinds = np.array(["pedestrian", "pedestrian"])
    (still, walking) = found.inputs(kinds, np.array([0.0, 1.4]), np.array([0.0, 0.3]), np.array([5.0, 0.1]))
    model = found.of("pedestrian")
    assert isinstance(model, WalkerMotion)
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
        ({"car": {"provenance": "", "ctra": {**CAR, "a_most": -1.0}}}, "kinds.car.ctra.a_most: .*found -1.0"),
        ({"car": {"provenance": "", "ctra": {**CAR, "v_most": float("nan")}}}, "kinds.car.ctra.v_most"),
        ({"car": {"provenance": "", "ctra": {**CAR, "a_range": [1.0, -1.0]}}}, "a_range: .*lower bound first"),
        ({"car": {"provenance": "", "ctra": {**CAR, "mass": 1.0}}}, "kinds.car.ctra.mass"),
        ({"car": {"provenance": "", "ctra": {"a_most": 1.0}}}, "kinds.car.ctra.v_half: is missing"),
        ({"car": {"provenance": ""}}, "kinds.car: .*expected one of ctra, walking and like"),
        ({"car": {"provenance": "", "like": "horse"}}, "kinds.car.like"),
        ({"car": {"provenance": "", "like": "van"}}, "car like van like car"),
        ({"horse": {"provenance": "", "ctra": CAR}}, "a name is .horse."),
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


TRUE = Surfaces(
    a_most=1.5, v_half=20.0, sigma_a0=0.15, sigma_a1=0.1, lateral_most=1.5, sigma_lateral=0.1, sigma_w1=0.2,
    v_least=1.0, v_most=40.0, a_range=(-6.0, 6.0), lateral_range=(-4.0, 4.0),
)  # fmt: skip
TRUE_WALK = WalkerMotion(
    a_most=1.0, sigma_still=0.6, sigma_along=0.2, sigma_across=0.3, v_walk=1.4, v_most=3.0,
    along_range=(-2.0, 2.0), across_range=(-2.0, 2.0),
)  # fmt: skip


def drawn(motion, count, seed):
    """Points whose answers are drawn from a motion."""
    rng = np.random.default_rng(seed)
    walks = isinstance(motion, WalkerMotion)
    v = rng.uniform(0.0, 2.0, count) if walks else rng.uniform(2.0, 30.0, count)
    a0, w0 = rng.normal(0.0, 1.0, count), rng.normal(0.0, 0.5 if walks else 0.06, count)
    inputs = motion.inputs(v, a0, w0)
    first, second = (inputs[:, k] + inputs[:, k + 1] * rng.standard_normal(count) for k in (0, 2))
    return MotionPoints(
        v=v, a0=a0, w0=w0, a=first, w=second, along=first, across=second,
        item=np.arange(count) // 20, block=np.arange(count) // 5,
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["car", "pedestrian"])
def test_known_parameters_are_found_within_their_standard_errors(kind):
    """Over parameters and draws, what is off is normal with the standard error: RMS 1, none beyond 4."""
    truth = TRUE if kind == "car" else TRUE_WALK
    off = []
    for seed in range(8):
        found = refit(drawn(truth, 3000, seed), prediction().of(kind))
        assert set(found.errors) == set(free(truth))
        off += [
            (getattr(found.motion, name) - getattr(truth, name)) / error
            for name, error in found.errors.items()
        ]
        assert found.within == pytest.approx(0.9973**2, abs=0.005)
    assert np.abs(off).max() < 4.0
    assert 0.8 < np.sqrt(np.mean(np.square(off))) < 1.25


def test_the_fit_is_the_best_and_better_than_what_was():
    points = drawn(TRUE, 1000, 3)
    found = refit(points, PUBLISHED)
    assert found.before == log_likelihood(PUBLISHED, points)
    assert found.after > max(found.before, log_likelihood(TRUE, points))
    for name in free(TRUE):
        for factor in (0.9, 1.1):
            beside = replace(found.motion, **{name: factor * getattr(found.motion, name)})
            assert log_likelihood(beside, points) < found.after
    other = refit(points, replace(PUBLISHED, a_most=2.0, sigma_a0=1.0, sigma_w1=1.0, lateral_most=8.0))
    for name in free(TRUE):
        assert getattr(other.motion, name) == pytest.approx(getattr(found.motion, name), rel=1e-3)


def test_errors_grow_where_points_depend_on_each_other():
    points = drawn(TRUE, 1000, 5)
    fivefold = {
        name: np.repeat(getattr(points, name), 5) for name in ("v", "a0", "w0", "a", "w", "along", "across")
    }
    copies = MotionPoints(**fivefold, item=np.zeros(5000, dtype=int), block=np.repeat(np.arange(1000), 5))
    alone = replace(points, block=np.arange(1000))
    one, five = refit(alone, PUBLISHED), refit(copies, PUBLISHED)
    for name, error in one.errors.items():
        assert five.errors[name] == pytest.approx(error, rel=0.02)


def test_the_points_of_an_object_are_its_states_and_what_followed():
    v, heading = np.array([1.0, 2.0, 2.0]), np.array([0.0, 0.0, np.pi / 2])
    points = MotionPoints.of_object(v, heading, np.array([0.5, 0.6, 0.7]), np.array([0.0, 0.1, 0.2]))
    assert points.v.tolist() == [1.0, 2.0]
    assert points.a0.tolist() == [0.5, 0.6]
    assert points.a.tolist() == [1.0, 0.0]
    assert points.w == pytest.approx([0.0, np.pi / 2])
    assert points.along == pytest.approx([1.0, -2.0])
    assert points.across == pytest.approx([0.0, 2.0])
    joined = MotionPoints.joined([points, points])
    assert joined.item.tolist() == [0, 0, 1, 1]
    assert joined.block.tolist() == [0, 0, 1, 1]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda p: {"a": np.full(len(p), np.nan)}, "not finite"),
        (lambda p: {"a": np.zeros(len(p))}, "do not vary"),
        (lambda p: {"w0": np.zeros(len(p))}, "do not vary"),
        (lambda p: {"a": TRUE.inputs(p.v, p.a0, p.w0)[:, 0]}, "without any spread"),
    ],
)
def test_points_that_say_nothing_are_refused(change, told):
    points = drawn(TRUE, 200, 1)
    with pytest.raises(ResimError, match=told):
        refit(replace(points, **change(points)), PUBLISHED)


def driven(motion, count, seconds, seed, kind="car"):
    """Tracks of objects whose answer in every second is drawn from a motion; inputs linear within a second."""
    rng = np.random.default_rng(seed)
    parts = 50
    u = np.arange(1, parts + 1)[:, None] / parts
    a, w = rng.normal(0.0, 0.3, count), rng.normal(0.0, 0.02, count)
    v, heading = rng.uniform(14.0, 25.0, count), np.zeros(count)
    speeds, headings = [v[None]], [heading[None]]
    for _ in range(seconds):
        mu_a, sigma_a, mu_w, sigma_w = np.moveaxis(motion.inputs(v, a, w), -1, 0)
        mean_a, mean_w = (m + s * rng.standard_normal(count) for m, s in ((mu_a, sigma_a), (mu_w, sigma_w)))
        speeds.append(v + mean_a * u * u + a * (u - u * u))
        headings.append(heading + mean_w * u * u + w * (u - u * u))
        v, heading, a, w = v + mean_a, heading + mean_w, 2.0 * mean_a - a, 2.0 * mean_w - w
    v, heading = np.concatenate(speeds).T, np.concatenate(headings).T
    velocity = v * np.exp(1j * heading)
    z = np.zeros(velocity.shape, dtype=complex)
    np.cumsum(0.5 * (velocity[:, 1:] + velocity[:, :-1]) / parts, axis=1, out=z[:, 1:])
    z += 100.0 * np.arange(count)[:, None]
    z, v, heading = (x[:, :: parts // 10] for x in (z, v, heading))
    return Tracks(
        t=np.arange(z.shape[1]) / 10.0, ids=np.arange(count).astype(str), kind=np.full(count, kind), x=z.real,
        y=z.imag, heading=wrap_angle(heading), v=v, length=np.full(count, 4.7), width=np.full(count, 1.9),
        valid=np.ones(z.shape, dtype=bool),
    )  # fmt: skip


@pytest.fixture
def recorded(tmp_path):
    """Write tracks as a recording; gives its folder."""

    def write(tracks, name="drive"):
        recording = Recording(name=name, map=ROAD, ego=str(tracks.ids[0]), gt=tracks, gt_rate=10.0)
        write_recording(recording, tmp_path / name)
        return tmp_path / name

    return write


@pytest.mark.slow
def test_known_surfaces_come_out_of_recordings(recorded, tmp_path, capsys):
    """Through files and splines. A spline smooths over a second, which takes a tenth off the spreads."""
    folders = [recorded(driven(TRUE, 40, 20, seed), f"drive{seed}") for seed in range(2)]
    out = tmp_path / "mine.json"
    fit_prediction(folders, out)
    data = json.loads(out.read_text())
    fitted = data["kinds"]["car"]["fitted"]
    assert (fitted["points"], fitted["objects"]) == (1600, 80)
    assert set(fitted["sources"]) == {"drive0", "drive1"}
    assert fitted["log_likelihood"] > fitted["log_likelihood_published"]
    found = read_prediction(out)
    assert found.name == "mine"
    for name, error in fitted["standard_errors"].items():
        true, value = getattr(TRUE, name), getattr(found.of("car"), name)
        assert value == pytest.approx(true, abs=3.0 * error + 0.15 * true), name
    printed = capsys.readouterr().out
    assert "car: 1600 points of 80 objects" in printed
    assert "log-likelihood per point" in printed
    again = tmp_path / "again" / "mine.json"
    fit_prediction(folders, again)
    assert again.read_bytes() == out.read_bytes()


def test_a_kind_with_too_few_points_keeps_the_published_and_is_told(recorded, tmp_path, capsys):
    tracks = driven(TRUE, 8, 10, 0)
    kinds = np.array(["car"] * 6 + ["truck", "bus"])
    parked = replace(tracks, kind=kinds, v=np.where(kinds[:, None] == "bus", 0.0, tracks.v))
    out = tmp_path / "mine.json"
    fit_prediction([recorded(parked)], out)
    found = read_prediction(out)
    assert found.of("truck") == prediction().of("truck")
    assert set(json.loads(out.read_text())["kinds"]) == {"car"}
    assert "truck keeps the published parameters: 10 points, at least 50" in capsys.readouterr().out


def constant(tracks):
    """The same objects, all straight on at one speed."""
    x = 100.0 * np.arange(len(tracks))[:, None] + 20.0 * tracks.t
    still = np.zeros(x.shape)
    return replace(tracks, x=x, y=still, heading=still.copy(), v=still + 20.0)


def test_recordings_that_cannot_be_fitted_are_told_and_nothing_is_written(recorded, tmp_path):
    good = driven(TRUE, 6, 10, 0)
    out = tmp_path / "mine.json"
    cases = [
        ([recorded(constant(good), "constant")], {}, "nothing to fit.*car: "),
        ([recorded(good.window(0.0, 0.5), "short")], {}, "no object moves for 1 s"),
        ([recorded(good, "good")], {"kind": ["truck"]}, "--kind: truck: 0 points"),
        ([tmp_path / "good"], {"kind": ["horse"]}, "no kind 'horse'"),
        ([tmp_path / "good"] * 2, {}, "is a duplicate"),
        ([tmp_path / "none"], {}, "recording.toml"),
    ]
    for folders, more, told in cases:
        with pytest.raises(InputError, match=told):
            fit_prediction(folders, out, **more)
        assert not out.exists()
    for text in ("t,id,x,y,heading,v,length,width,kind\n0,0,0,0,0,1,4,2,car\n",
                 "t,id,x,y,heading,v,length,width,kind\n0,0,0,0,0,nan,4,2,car\n1,0,0,0,0,nan,4,2,car\n"):  # fmt: skip
        (tmp_path / "good" / "gt.csv").write_text(text)
        with pytest.raises(InputError, match="good"):
            fit_prediction([tmp_path / "good"], out)


def test_recordings_of_one_name_are_told_apart(recorded, tmp_path):
    one, other = (recorded(driven(TRUE, 6, 10, seed), f"{seed}/drive") for seed in range(2))
    fit_prediction([one, other], tmp_path / "mine.json")
    fitted = json.loads((tmp_path / "mine.json").read_text())["kinds"]["car"]["fitted"]
    assert list(fitted["sources"]) == ["drive", "drive~2"]
    assert fitted["objects"] == 12


def test_a_file_that_is_no_prediction_is_not_replaced(recorded, tmp_path):
    out = tmp_path / "notes.txt"
    out.write_text("mine")
    with pytest.raises(InputError, match="would be lost"):
        fit_prediction([recorded(driven(TRUE, 6, 10, 0))], out)
    assert out.read_text() == "mine"


def test_the_command_ends_with_0_or_with_2_and_one_line(call, recorded, tmp_path):
    folder, out = recorded(driven(TRUE, 6, 10, 0)), tmp_path / "mine.json"
    code, printed, errors = call("assess", "fit-prediction", folder, "--out", out, "--kind", "car")
    assert (code, errors) == (0, "")
    assert "car: 60 points of 6 objects" in printed
    code, printed, errors = call("assess", "fit-prediction", folder, "--out", out, "--kind", "bus")
    assert (code, printed) == (2, "")
    assert errors.startswith("resim: --kind: bus: 0 points")
    assert errors.count("\n") == 1
    assert read_prediction(out).of("car") != PUBLISHED  # the earlier file is still there
