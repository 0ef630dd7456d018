"""Models that do not fit are told, with what it costs; one that fits is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from perception.generator import KNOWN, Beyond, drives

from resim.perception.model import (
    Error,
    ErrorModels,
    FailedAssumption,
    Latency,
    LeftOut,
    ModelFit,
    PerceptionModel,
    Response,
    Spread,
)
from resim.perception.parameters import fit_in_words
from resim.perception.training import train
from resim.perception.training.clusters import FEWEST
from resim.perception.training.drive import drive_of
from resim.perception.validation import measured_errors, model_errors

PROPER = PerceptionModel(
    name="proper",
    latency=Latency(position=0.1, speed=0.4, heading=0.2),
    errors=ErrorModels(
        longitudinal=Error(
            bias=Response(constant=0.5),
            drift=Spread(constant=0.1),
            correlation_time=1.0,
            noise=Spread(constant=0.15),
        ),
        lateral=Error(noise=Spread(constant=0.1)),
        speed=Error(drift=Spread(constant=0.15), correlation_time=0.5, noise=Spread(constant=0.1)),
        heading=Error(noise=Spread(constant=0.01)),
    ),
)


def fit_of(beyond: Beyond, count: int = 10, seed: int = 3) -> tuple[PerceptionModel, ModelFit]:
    model = train(drives(PROPER, seed, count, rate=10.0, beyond=beyond), name="trained")
    assert model.training is not None
    assert model.training.fit is not None
    return model, model.training.fit


def told(fit: ModelFit, quantity: str, assumption: str, on: str = "") -> FailedAssumption:
    found = [m for m in fit.misfits if (m.quantity, m.assumption) == (quantity, assumption) and on in m.on]
    assert found, [m.text for m in fit.misfits]
    return found[0]


def test_a_model_that_fits_is_told_nothing() -> None:
    model, fit = fit_of(Beyond())
    assert fit.misfits == ()
    assert fit.tests > 50
    assert model.training is not None
    assert fit_in_words(model.training) == (f"no misfit found by {fit.tests} tests on 10 drives", [])


def test_heavy_tails_are_told_with_their_share() -> None:
    """Of Student's t with 3 degrees of freedom 1.4 % lie beyond 3 standard deviations, of a normal one 0.27 %."""
    tails = told(fit_of(Beyond(tails=3.0))[1], "lateral", "tails")
    assert tails.size == pytest.approx(0.014, abs=0.004)
    assert "heavy tails" in tails.text


@pytest.mark.slow
def test_a_latency_that_varies_is_told_in_seconds() -> None:
    found = told(fit_of(Beyond(late=0.15))[1], "longitudinal", "latency")
    assert (found.size, found.unit) == (pytest.approx(0.15, rel=0.1), "s")
    assert fit_of(Beyond(late=0.15, late_time=2.0))[1].misfits


def test_a_scale_of_speeds_is_told_in_percent() -> None:
    found = told(fit_of(Beyond(scale=0.03))[1], "speed", "bias", "speed")
    assert "(+3.0%)" in found.text or "(+2.9%)" in found.text or "(+3.1%)" in found.text
    assert found.size == pytest.approx(0.03 * 25.0, rel=0.3)


def test_a_bias_while_braking_is_not_taken_for_latency_without_a_word() -> None:
    model, fit = fit_of(Beyond(braking=(("speed", 0.6),)))
    assert model.latency.speed > 0.5
    found = told(fit, "speed", "bias", "braking")
    assert 0.25 < found.size < 0.7
    late = float(found.text.rpartition("latency: ")[2].split()[0])
    assert abs(late - 0.4) < 0.5 * (model.latency.speed - 0.4)


@pytest.mark.parametrize("at_120", [8.0, 2.0])
def test_an_error_that_bends_with_range_is_told_with_how_far_it_is_off_a_line(at_120: float) -> None:
    """Held against a parabola's distance to a straight line through the same ranges, at the ends of 90 % of them."""
    made = drives(PROPER, 4, 10, rate=10.0)
    ranges = np.concatenate(
        [np.hypot(*(c[1:] - c[0] for c in (r.gt.x, r.gt.y))).ravel() for r in made if r.gt is not None]
    )
    ends = np.quantile(ranges, (0.05, 0.95))
    off = at_120 * (ends / 120.0) ** 2 - np.polyval(
        np.polyfit(ranges, at_120 * (ranges / 120.0) ** 2, 1), ends
    )
    _, fit = fit_of(Beyond(bend=(("longitudinal", at_120),)), seed=4)
    found = told(fit, "longitudinal", "bias", "range_bend")
    assert (found.size, found.unit) == (pytest.approx(np.max(np.abs(off)), rel=0.2), "m")
    assert found.text.startswith("longitudinal error bends with range: off a straight line by +")
    near, far = (end.split() for end in found.text.rpartition(" by ")[2].split(" and "))
    assert [float(near[0]), float(far[0])] == pytest.approx(off, rel=0.2)
    assert [float(near[3]), float(far[3])] == pytest.approx(ends, abs=3.0)


@pytest.mark.parametrize(("seed", "quantity", "jump"), [(3, "lateral", 0.5), (4, "speed", -0.6)])
def test_an_error_that_jumps_from_side_to_side_is_told(seed: int, quantity: str, jump: float) -> None:
    found = told(fit_of(Beyond(side=((quantity, jump),)), seed=seed)[1], quantity, "bias", "bearing_side")
    assert found.size == pytest.approx(abs(jump), rel=0.2)
    assert f"{quantity} error jumps between the sides: {'+' if jump > 0 else '-'}" in found.text
    assert found.text.endswith("on the left against the right")


def test_errors_along_straight_lines_by_range_and_bearing_are_no_bend_and_no_jump() -> None:
    lines = Error(bias=Response(constant=0.5, range=0.03, bearing=0.5), noise=Spread(constant=0.15))
    model = PROPER.model_copy(update={"errors": PROPER.errors.model_copy(update={"longitudinal": lines})})
    found = train(drives(model, 3, 10, rate=10.0), name="lines").training
    assert found is not None
    assert found.fit is not None
    assert found.fit.misfits == ()


@pytest.mark.parametrize(("quantity", "spread"), [("longitudinal", 0.6), ("speed", 1.0)])
def test_an_offset_that_all_objects_of_a_drive_share_is_told(quantity: str, spread: float) -> None:
    found = told(fit_of(Beyond(drive=((quantity, spread),)), 20)[1], quantity, "together", "one drive")
    assert found.size == pytest.approx(spread, rel=0.3)


def test_errors_that_are_larger_in_some_drives_are_told() -> None:
    found = told(fit_of(Beyond(weather=0.5), 20)[1], "speed", "spread", "one drive")
    assert found.size == pytest.approx(np.exp(0.5) - 1.0, rel=0.4)


def test_a_sensor_that_loses_everybody_at_once_is_told() -> None:
    found = told(fit_of(Beyond(blind=0.2), 20)[1], "detection", "detected", "together")
    assert found.size > 0.7
    assert "lost and found together" in found.text


def test_too_few_drives_test_nothing_and_say_so() -> None:
    model, fit = fit_of(Beyond(tails=3.0), FEWEST - 1)
    assert fit == ModelFit(drives=FEWEST - 1)
    assert model.training is not None
    assert "was not tested" in fit_in_words(model.training)[0]
    unasked = model.training.model_copy(update={"fit": None})
    assert "was not tested" in fit_in_words(unasked)[0]


def test_what_is_left_out_is_counted_by_reason() -> None:
    """An object perceived once, one never, and one that is nobody; and the first 0.4 s, whose truth is not known."""
    recordings = drives(PROPER, 5, 6, rate=10.0, objects=4)
    sd = recordings[0].sd
    assert sd is not None
    valid = sd.valid.copy()
    valid[sd.index("1.0")] = False
    valid[sd.index("2.0"), 1:] = False
    x = sd.x + np.where(sd.ids == "3.0", 500.0, 0.0)[:, None]
    names = recordings[0].sd_gt_id
    assert names is not None
    names = np.where(names == "3", "", names)
    spoilt = replace(sd, x=np.where(valid, x, np.nan), **{
        name: np.where(valid, getattr(sd, name), np.nan) for name in ("y", "heading", "v")
    }, valid=valid)  # fmt: skip
    model = train([replace(recordings[0], sd=spoilt, sd_gt_id=names), *recordings[1:]], name="spoilt")
    assert model.training is not None
    seen = 24 * 101 - 101 - 100
    counts = {(part.what, part.reason.split()[0]): (part.count, part.of) for part in model.training.left_out}
    assert counts["objects", "no"] == (2, 24)
    assert counts["samples", "they"] == (101, seen)
    assert counts["samples", "their"] == (1, seen)
    # 5 drives of 4 objects and one of 1: lists at 0 to 0.3 s; at 0.4 s the truth of 0 s is known
    assert counts["samples", "the"] == (21 * 4, seen)
    assert all(isinstance(part, LeftOut) for part in model.training.left_out)


@pytest.mark.slow
def test_drives_of_other_models_that_fit_are_told_nothing() -> None:
    """Everything at once, with what is lost, taken for another, or not there."""
    fit = train(drives(KNOWN["everything"], 3, 10), name="everything").training
    assert fit is not None
    assert fit.fit is not None
    assert fit.fit.misfits == ()


def shares(model: PerceptionModel, beyond: Beyond) -> np.ndarray:
    """Share of time that objects are detected, measured and by the model, up to 30, 60, 90 m."""
    found = np.zeros((3, 3))
    made = [drive_of(r) for r in drives(PROPER, 9, 20, rate=10.0, beyond=beyond, objects=8)]
    for drive, measured in zip(made, measured_errors(made), strict=True):
        x, y, _ = drive.in_frame(drive.states)
        inside = np.digitize(np.hypot(x, y), (30.0, 60.0, 90.0))
        modelled = [model_errors(model, drive, seed) for seed in range(4)]
        for k in range(3):
            there = measured.there & (inside == k)
            seen = [np.isfinite(e.values[0][there]).sum() for e in (measured, *modelled)]
            found[:, k] += seen[0], np.mean(seen[1:]), there.sum()
    return found[:2] / found[2]


@pytest.mark.slow
def test_objects_that_are_found_late_are_found_late_by_the_model() -> None:
    beyond = Beyond(found=0.02)
    model = train(drives(PROPER, 3, 20, rate=10.0, beyond=beyond, objects=8), name="late")
    measured, modelled = shares(model, beyond)
    np.testing.assert_allclose(modelled, measured, atol=0.08)
    assert measured.max() < 0.75
    assert model.training is not None
    assert model.training.fit is not None
    assert not [m for m in model.training.fit.misfits if m.quantity == "detection"]


def test_a_sensor_that_confirms_objects_first_is_told_with_the_shares_of_time() -> None:
    beyond = Beyond(confirmed=2.0)
    fit = train(drives(PROPER, 3, 10, rate=10.0, beyond=beyond, objects=8), name="late").training
    assert fit is not None
    assert fit.fit is not None
    found = told(fit.fit, "detection", "detected", "time")
    assert "after they appeared are detected" in found.text
    assert "it sees more than the sensor" in found.text
    assert found.size > 0.1
