from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from perception.generator import KNOWN, drives, make_recording, parameter

from resim.core.errors import InputError
from resim.core.tracks import Tracks
from resim.perception.model import (
    Error,
    ErrorModels,
    FieldOfView,
    Latency,
    PerceptionModel,
    Response,
    Spread,
    TrainedParameter,
)
from resim.perception.runtime.chain import detected_share
from resim.perception.runtime.sensor import Sensor
from resim.perception.training import train
from resim.perception.training.detection import DetectionSamples, fit_detection
from resim.perception.training.drive import drive_of
from resim.perception.training.matching import match
from resim.perception.validation import _worlds
from resim.recordings import Recording

QUANTITIES = ("longitudinal", "lateral", "speed", "heading")
PLAIN = KNOWN["noise"]


@cache
def trained(name: str, seed: int = 1) -> PerceptionModel:
    """Trained on 20 drives of 10 s at 25 Hz of a known model."""
    return train(drives(KNOWN[name], seed), name=name)


def estimate(model: PerceptionModel, name: str) -> TrainedParameter:
    assert model.training is not None
    return model.training.estimates[name]


@pytest.mark.parametrize(
    "model", ["noise", *(pytest.param(one, marks=pytest.mark.slow) for one in ("latency", "drift"))]
)
@pytest.mark.parametrize("what", ["position", "speed", "heading"])
def test_latencies_come_back_within_10_ms(model: str, what: str) -> None:
    true = parameter(KNOWN[model], f"latency.{what}")
    assert parameter(trained(model), f"latency.{what}") == pytest.approx(true, abs=0.01)


def test_averaging_comes_back_and_none_stays_none() -> None:
    assert trained("drift").averaging.speed == pytest.approx(1.2, abs=0.1)
    assert trained("drift").averaging.heading == pytest.approx(1.2, abs=0.1)
    assert trained("noise").averaging.speed == trained("noise").averaging.heading == 0.0


@pytest.mark.parametrize("model", ["noise", "drift"])
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_biases_and_spreads_come_back_within_5_percent(model: str, quantity: str) -> None:
    """Biases within 5 % of themselves, or of the standard deviation of the error; spreads within 5 %."""
    true, found = (getattr(m.errors, quantity) for m in (KNOWN[model], trained(model)))
    whole = np.hypot(true.drift.constant, true.noise.constant)
    for feature, value in true.bias.model_dump().items():
        near = pytest.approx(value, rel=0.05, abs=0.05 * whole if feature == "constant" else 0.0)
        assert getattr(found.bias, feature) == near
    for part in ("drift", "noise"):
        for feature, value in getattr(true, part).model_dump().items():
            slack = 0.05 if feature == "constant" else 0.1
            assert getattr(getattr(found, part), feature) == pytest.approx(value, rel=slack, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_correlation_times_come_back_within_10_percent(quantity: str) -> None:
    true = getattr(KNOWN["drift"].errors, quantity).correlation_time
    each = [getattr(trained("drift", seed).errors, quantity).correlation_time for seed in (1, 2)]
    assert each == pytest.approx([true, true], rel=0.1)


@pytest.mark.slow
def test_a_correlation_time_of_2_s_is_known_as_well_as_the_data_can() -> None:
    """20 drives of 10 s are some 400 times 2 s of objects: over 8 seeds estimates scatter by 7 % about 1.92 s, one of
    them is more than 10 % off. The interval says so, and holds the truth."""
    slow = Error(drift=Spread(constant=0.25), correlation_time=2.0, noise=Spread(constant=0.03))
    model = train(drives(PerceptionModel(name="slow", errors=ErrorModels(longitudinal=slow)), 1), name="slow")
    found = estimate(model, "errors.longitudinal.correlation_time")
    assert found.low < 2.0 < found.high
    assert 0.1 < (found.high - found.low) / (2 * 2.0) < 0.4
    assert model.errors.longitudinal.drift.constant == pytest.approx(0.25, rel=0.12)
    assert model.errors.longitudinal.noise.constant == pytest.approx(0.03, rel=0.05)


def test_drifts_that_go_together() -> None:
    coupling = trained("drift").errors.coupling
    assert coupling is not None
    assert coupling[0][1] == pytest.approx(0.4, abs=0.08)
    assert coupling[0][2] == pytest.approx(0.6, abs=0.08)
    assert coupling[1][2] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("model", ["detection", pytest.param("everything", marks=pytest.mark.slow)])
def test_detection_comes_back_within_2_points(model: str) -> None:
    found = trained(model).detection
    for middle, loss, gain in ((15.0, 0.2, 20.0), (45.0, 1.0, 16.0), (75.0, 4.0, 12.0)):
        k = int(np.clip(np.searchsorted(found.range_edges, middle) - 1, 0, len(found.loss) - 1))
        cell = found.gain[k][0][0] / (found.gain[k][0][0] + found.loss[k][0][0])
        assert cell == pytest.approx(gain / (gain + loss), abs=0.02)
        assert found.loss[k][0][0] == pytest.approx(loss, rel=0.35)
    assert len(found.bearing_edges) == len(found.occlusion_edges) == 2


@pytest.mark.slow
def test_everything_at_once_is_within_its_intervals() -> None:
    model = trained("everything")
    assert model.training is not None
    inside, far = [], []
    for name, e in model.training.estimates.items():
        if name.startswith(("detection", "errors.length", "errors.width")):
            continue
        true = parameter(KNOWN["everything"], name)
        inside.append(e.low - 1e-3 <= true <= e.high + 1e-3)
        far.append(abs(e.value - true) > 2.5 * (e.high - e.low) / 2 + 1e-3)
    assert np.mean(inside) > 0.85
    assert not any(far)
    assert model.field_of_view.range == pytest.approx(90.0, abs=0.2)
    assert model.field_of_view.bearing is None
    assert model.update.period == pytest.approx(0.05, rel=0.01)
    assert model.update.jitter == pytest.approx(0.004, rel=0.05)


@pytest.mark.slow
def test_what_is_not_there_stays_none() -> None:
    model = trained("latency")
    for quantity in QUANTITIES:
        error = getattr(model.errors, quantity)
        assert error.drift.constant == error.noise.constant == 0.0
        assert error.bias.model_dump() == pytest.approx(Response().model_dump(), abs=1e-3)
    assert model.detection.loss == ()
    assert model.id_switch == model.false_objects.rate == 0.0
    assert model.maneuvers == {}
    assert model.field_of_view.range is None


@pytest.mark.slow
def test_maneuvers_with_errors_of_their_own() -> None:
    """Objects that brake are seen farther off: their error is theirs, and that of the others is not spoilt."""

    def braking(seed: int) -> Recording:
        recording = make_recording(KNOWN["drift"], seed)
        drive, sd = drive_of(recording), recording.sd
        assert sd is not None
        x = sd.x.copy()
        for n, truth in enumerate(drive.truth):
            a = truth.states(sd.t - 0.8)[4]
            row = sd.index(f"{n + 1}.0")
            x[row] += np.where(a < -1.0, 2.0, 0.0) * np.cos(drive.ego[2])
        return replace(recording, sd=replace(sd, x=x))

    model = train([braking(5000 + k) for k in range(20)], name="braking")
    assert "braking" in model.maneuvers
    both = [e.longitudinal.bias.constant for e in (model.maneuvers["braking"].errors, model.errors)]
    assert both[0] - both[1] > 1.0


@pytest.mark.slow
def test_the_runtime_and_the_generator_mean_the_same() -> None:
    """What the loop's sensor perceives by a known model comes back too."""
    true = KNOWN["drift"]
    model = train([perceived(true, seed) for seed in range(7000, 7020)], name="runtime")
    assert model.latency.position == pytest.approx(true.latency.position, abs=0.01)
    assert model.latency.speed == pytest.approx(true.latency.speed, abs=0.02)
    assert model.latency.heading == pytest.approx(true.latency.heading, abs=0.02)
    for quantity in QUANTITIES:
        one, other = getattr(model.errors, quantity), getattr(true.errors, quantity)
        assert one.drift.constant == pytest.approx(other.drift.constant, rel=0.08)
        assert one.noise.constant == pytest.approx(other.noise.constant, rel=0.08)
        assert one.correlation_time == pytest.approx(other.correlation_time, rel=0.2)


def perceived(model: PerceptionModel, seed: int) -> Recording:
    recording = make_recording(PerceptionModel(name="true"), seed)
    drive, sd, sensor = drive_of(recording), recording.sd, Sensor(model)
    assert sd is not None
    sensor.reset(np.random.default_rng(seed))
    x, y, heading, v = (c.copy() for c in (sd.x, sd.y, sd.heading, sd.v))
    for k, world in enumerate(_worlds(drive)):
        seen = sensor.perceive(world)
        rows = [sd.index(f"{name}.0") for name in seen.ids.tolist()]
        x[rows, k], y[rows, k] = seen.map_positions()
        heading[rows, k], v[rows, k] = seen.heading_ego + seen.ego.heading, seen.v
    return replace(recording, sd=replace(sd, x=x, y=y, heading=heading, v=v))


def test_names_are_not_needed() -> None:
    some = [make_recording(KNOWN["noise"], 100 + k, named=False) for k in range(3)]
    assert all(d.own is not None for d in map(drive_of, some))
    assert sum(m.switches for m in match([drive_of(r) for r in some])) == 0


def test_the_same_drives_give_the_same_model() -> None:
    one, other = (train(drives(PLAIN, 3, 3), name="same").model_dump_json() for _ in range(2))
    assert one == other


def sd_of(recording: Recording) -> Tracks:
    assert recording.sd is not None
    return recording.sd


def shifted(r: Recording) -> Recording:
    return replace(
        r, sd=replace(sd_of(r), x=sd_of(r).x + np.where(sd_of(r).ids == "ego", 0.0, 500.0)[:, None])
    )


def elsewhen(r: Recording) -> Recording:
    return replace(r, sd=replace(sd_of(r), t=sd_of(r).t + 1000.0))


def far_out(r: Recording) -> Recording:
    """What a wrong unit, or a value for "not known", makes of positions."""
    return replace(r, gt=replace(r.gt, x=r.gt.x + 1e155), sd=replace(sd_of(r), x=sd_of(r).x + 1e155))


def alone(r: Recording) -> Recording:
    return replace(r, sd=sd_of(r).select(["ego"]), sd_gt_id=np.array(["ego"]))


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (lambda r: replace(r, sd=None, sd_gt_id=None), "no sensor data"),
        (shifted, "none of .* lies on an object"),
        (alone, "no object but the EGO"),
        (lambda r: replace(r, sd=sd_of(r).window(4.0, 4.09)), "9 samples|expected at least 50"),
        (lambda r: replace(r, ego="nobody"), "not in the ground truth"),
        (elsewhen, "no time in common"),
        (far_out, "errors that no model may have: bias"),
    ],
)
def test_what_cannot_be_learned_from_is_refused(spoil: Callable[[Recording], Recording], text: str) -> None:
    with pytest.raises(InputError, match=text):
        train([spoil(make_recording(PLAIN, 1, objects=3))], name="x")


def test_no_recordings_are_refused() -> None:
    with pytest.raises(InputError, match="no recording"):
        train([], name="x")


def test_two_objects_that_swap_their_ids_are_told_apart_by_where_they_are() -> None:
    recording = make_recording(PLAIN, 4, objects=2)
    sd = sd_of(recording)
    late = sd.t > 5.0
    one, other = sd.index("1.0"), sd.index("2.0")
    columns = {}
    for name in ("x", "y", "heading", "v"):
        values = getattr(sd, name).copy()
        values[np.ix_([one, other], late)] = values[np.ix_([other, one], late)]
        columns[name] = values
    swapped = replace(recording, sd=replace(sd, **columns))
    model = train([swapped], name="swapped")
    assert estimate(model, "id_switch").value == pytest.approx(2 / 20.0, rel=0.1)
    assert model.errors.longitudinal.bias.constant == pytest.approx(0.5, abs=0.5)


def test_constant_signals_tell_no_latency_and_the_interval_says_so() -> None:
    """All at one constant speed: offset and latency are one; none is claimed, and the interval is wide."""

    def even(seed: int) -> Recording:
        recording = make_recording(PerceptionModel(name="x", latency=Latency(position=0.0)), seed, objects=2)
        gt, sd = recording.gt, sd_of(recording)
        rng = np.random.default_rng(seed)
        start = np.array([0.0, 30.0, -20.0])
        gt = replace(
            gt, x=start[:, None] + 20.0 * gt.t, y=0.0 * gt.y, heading=0.0 * gt.y, v=np.full_like(gt.v, 20.0)
        )
        noise = 0.1 * rng.standard_normal((4, *gt.x.shape)) * (gt.ids != "ego")[None, :, None]
        moved = {c: getattr(gt, c) + 0.1 * n for c, n in zip(("y", "heading", "v"), noise, strict=False)}
        return replace(recording, gt=gt, sd=replace(sd, x=gt.x + 1.0 + noise[3], **moved))

    model = train([even(k) for k in range(4)], name="even")
    for name in ("position", "speed", "heading"):
        e = estimate(model, f"latency.{name}")
        assert e.high - e.low > 1.0
        assert e.low == 0.0
        assert e.value < 0.1


def test_one_drive_is_enough_for_wide_intervals() -> None:
    model = train([make_recording(KNOWN["drift"], 9)], name="one")
    assert model.training is not None
    assert model.training.drives == 1
    wide = estimate(model, "latency.speed")
    narrow = estimate(trained("drift"), "latency.speed")
    assert wide.high - wide.low > 2.0 * (narrow.high - narrow.low)
    assert all(np.isfinite([e.value, e.low, e.high]).all() for e in model.training.estimates.values())


@pytest.mark.parametrize("lost", [0.05, 0.2, 0.6])
def test_objects_that_are_lost_step_by_step_are_detected_as_often_in_the_model(lost: float) -> None:
    """Independently of the step before: the most usual drop-outs, which no slower rates may take the place of."""
    rng, n = np.random.default_rng(4), 20_000
    place = np.column_stack([rng.uniform(10.0, 60.0, n), rng.uniform(0.0, 0.3, n), np.zeros(n)])
    seen = rng.random(n) > lost
    pairs = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    of = np.zeros(n, dtype=int)
    samples = DetectionSamples(
        place, seen, pairs, np.full(n - 1, 0.05), of, of, np.zeros((n, 4)), np.full(n, "car"), np.arange(n)
    )
    found, estimates = fit_detection(samples, FieldOfView())
    share = detected_share(np.array(found.loss), np.array(found.gain))
    np.testing.assert_allclose(share, 1.0 - lost, atol=0.02)
    for name, one in estimates.items():
        assert one.low <= one.value <= one.high, name
