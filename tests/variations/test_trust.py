"""Trust: inside what was verified, outside, or unknown."""

from dataclasses import replace

import numpy as np
import pytest

from resim.variations.lane_motion import LaneMotion
from resim.variations.trust import ACROSS, judged_trust
from resim.verification.validity_interval import IntervalEnd, ValidityInterval

T = np.arange(0.0, 10.0, 0.04)
PHASE = np.clip((T - 3.0) / 4.0, 0.0, 1.0)
BEFORE = LaneMotion(None, T, 30.0 * T, -3.5 * (PHASE - np.sin(2 * np.pi * PHASE) / (2 * np.pi)))  # type: ignore[arg-type]


def interval(parameter: str, low: float, high: float, unit: str = "m/s") -> ValidityInterval:
    ends = (IntervalEnd(amount, (), ()) for amount in (low, high))
    return ValidityInterval(parameter, unit, "1", *ends, 0.05, 9)


RANGES = (
    interval("speed", -1.0, 0.5),
    interval("gap", -2.0, 3.0, "m"),
    interval("lane_change", -0.5, 0.5, "s"),
)


def level(motion: LaneMotion, ranges: tuple[ValidityInterval, ...] = RANGES) -> str:
    return judged_trust({"1": BEFORE}, {"1": motion}, ranges).level


def test_what_verify_varied_within_its_range_is_inside() -> None:
    assert level(BEFORE) == "inside"
    assert level(replace(BEFORE, s=BEFORE.s + 0.45 * T)) == "inside"
    assert level(replace(BEFORE, s=BEFORE.s - 1.9)) == "inside"
    for shift in (-0.45, 0.45):
        assert level(replace(BEFORE, d=np.interp(T - shift, T, BEFORE.d))) == "inside"


@pytest.mark.parametrize(
    "motion",
    [
        replace(BEFORE, s=BEFORE.s + 0.8 * T),
        replace(BEFORE, s=BEFORE.s + 5.0),
        replace(BEFORE, d=np.interp(T - 1.5, T, BEFORE.d)),
        replace(BEFORE, d=BEFORE.d + ACROSS + 0.3),
    ],
)
def test_what_is_beyond_is_outside_and_says_why(motion: LaneMotion) -> None:
    found = judged_trust({"1": BEFORE}, {"1": motion}, RANGES)
    assert found.level == "outside"
    assert found.reason.startswith("object 1: ")
    assert "verified" in found.reason


def test_beyond_a_range_by_less_than_its_resolution_is_outside() -> None:
    """A KPI flips one resolution beyond the range: what lies between was not simulated."""
    assert level(replace(BEFORE, s=BEFORE.s + 0.54 * T)) == "outside"
    assert level(replace(BEFORE, s=BEFORE.s - 2.04)) == "outside"
    assert level(replace(BEFORE, s=BEFORE.s + 0.04), (interval("gap", 0.0, 0.0, "m"),)) == "inside"


def test_another_vehicle_or_weather_is_outside() -> None:
    found = judged_trust({"1": BEFORE}, {"1": BEFORE}, RANGES, "object 1 is a truck of 12 m")
    assert (found.level, found.reason) == (
        "outside",
        "object 1 is a truck of 12 m: verified is the origin's own",
    )


def test_a_parameter_that_was_not_verified_does_not_cover() -> None:
    faster = replace(BEFORE, s=BEFORE.s + 0.45 * T)
    assert level(faster, RANGES[1:]) == "outside"


def test_an_object_without_ranges_is_unknown() -> None:
    found = judged_trust({"2": BEFORE}, {"2": BEFORE}, RANGES)
    assert (found.level, found.reason) == ("unknown", "no range of object 2 was verified")
