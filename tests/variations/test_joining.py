"""A varied maneuver is put back into its drive without a step in position, speed or heading."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from traced import kernel

from resim.core.geometry import Floats
from resim.road.path import Path
from resim.variations.features import POINTS, feature_vector
from resim.variations.joining import ManeuverChange, joined_motion, no_change
from resim.variations.lane_motion import LaneMotion

PATH: Path = None  # type: ignore[assignment]  a motion's places need no road here
FINE = 0.01


def motion(step: float = FINE) -> LaneMotion:
    """12 s with a lane change from 4 to 8 s and braking."""
    t = np.arange(0.0, 12.0 + 1e-9, step)
    phase = np.clip((t - 4.0) / 4.0, 0.0, 1.0)
    s = 30.0 * t - 0.3 * np.clip(t - 6.0, 0.0, None) ** 2
    return LaneMotion(PATH, t, s, -3.75 * (phase - np.sin(2.0 * np.pi * phase) / (2.0 * np.pi)))


KERNEL = kernel()


def varied(points: Floats, box: float = 0.05) -> tuple[LaneMotion, ManeuverChange]:
    offset = (2.0 * points - 1.0) * box * KERNEL.box
    change = ManeuverChange(4.0, 8.0, offset @ KERNEL.axes)
    return joined_motion(motion(), change), change


POINT = st.lists(st.floats(0.0, 1.0), min_size=KERNEL.count, max_size=KERNEL.count).map(np.array)


@settings(deadline=None, max_examples=40)
@given(POINT)
def test_no_step_in_position_speed_or_heading(points: Floats) -> None:
    found, _ = varied(points)
    for values, speeds in ((found.s, motion().s), (found.d, motion().d)):
        v = np.diff(values) / FINE
        a = np.abs(np.diff(v)) / FINE
        before = np.abs(np.diff(speeds, 2)) / FINE**2
        # a step of speed of 0.05 m/s would be 5 m/s² for a sample; of position far more
        assert a.max() < before.max() + 4.0
        assert np.abs(np.diff(v)).max() < 0.05
    heading = np.arctan2(np.diff(found.d), np.diff(found.s))
    assert np.abs(np.diff(heading)).max() < 0.002


@settings(deadline=None, max_examples=20)
@given(POINT)
def test_what_is_before_stays_and_what_follows_keeps_its_motion(points: Floats) -> None:
    found, change = varied(points)
    own = motion()
    before = own.t < 4.0
    np.testing.assert_allclose(found.s[before], own.s[before], atol=1e-9)
    np.testing.assert_allclose(found.d[before], own.d[before], atol=1e-9)
    late = change.moved[POINTS - 1]
    after = (own.t > 8.0 + late + 2.1) & (own.t < 12.0 - abs(late) - 0.1)
    speed = np.gradient(found.s, found.t)
    np.testing.assert_allclose(
        speed[after], np.interp(own.t[after] - late, own.t, np.gradient(own.s, own.t)), atol=1e-3
    )


def test_no_change_is_the_original() -> None:
    found = joined_motion(motion(), ManeuverChange(4.0, 8.0, no_change()))
    np.testing.assert_allclose(found.s, motion().s, atol=1e-9)
    np.testing.assert_allclose(found.d, motion().d, atol=1e-9)


def test_a_maneuver_from_the_first_moment_takes_its_own_speed() -> None:
    whole = motion()
    moved = np.concatenate(
        [np.zeros(POINTS), np.linspace(0.0, 4.0, POINTS), np.zeros(POINTS)]
    )  # 1 m/s faster
    found = joined_motion(whole, ManeuverChange(0.0, 4.0, moved))
    assert np.gradient(found.s, found.t)[0] == pytest.approx(31.0, abs=0.01)


def test_a_maneuver_that_would_take_no_time_is_refused() -> None:
    moved = np.concatenate([np.linspace(0.0, -3.9, POINTS), np.zeros(2 * POINTS)])
    with pytest.raises(ValueError, match="no time"):
        joined_motion(motion(), ManeuverChange(4.0, 8.0, moved))


def test_features_are_moved_to_the_origin() -> None:
    features = feature_vector(motion(), 4.0, 8.0)
    assert features.shape == (3 * POINTS,)
    assert features[0] == features[POINTS] == features[2 * POINTS] == 0.0
    assert features[POINTS - 1] == pytest.approx(4.0)
    assert features[-1] == pytest.approx(-3.75, abs=1e-6)
