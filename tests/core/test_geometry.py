from __future__ import annotations

import math

import numpy as np
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from resim.core.geometry import (
    Boxes,
    box_corners,
    boxes_overlap,
    from_frame,
    to_frame,
    unwrap_angle,
    wrap_angle,
)

ANGLE = st.floats(-50.0, 50.0)
PLACE = st.floats(-1e4, 1e4)
BOX = st.tuples(st.floats(-8, 8), st.floats(-8, 8), ANGLE, st.floats(0.3, 15.0), st.floats(0.3, 3.0))


@given(ANGLE)
def test_wrapped_angles_are_in_the_half_open_turn_and_the_same_direction(angle: float) -> None:
    wrapped = float(wrap_angle(angle))
    assert -math.pi < wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-12)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-12)


def test_wrapping_keeps_pi_and_turns_minus_pi() -> None:
    np.testing.assert_array_equal(wrap_angle([math.pi, -math.pi, 0.0]), [math.pi, math.pi, 0.0])
    assert np.isnan(wrap_angle(np.nan))


@given(st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=30), st.sets(st.integers(0, 29)))
def test_unwrapping_undoes_wrapping_across_gaps(turns: list[float], gaps: set[int]) -> None:
    angle = np.cumsum(np.clip(turns, -1.5, 1.5))
    hidden = [g for g in gaps if 0 < g < len(angle) and g % 2]  # single samples: less than a half turn apart
    wrapped = np.array(wrap_angle(angle))
    wrapped[hidden] = np.nan
    unwrapped = unwrap_angle(wrapped)
    known = np.isfinite(wrapped)
    np.testing.assert_array_equal(np.isfinite(unwrapped), known)
    np.testing.assert_allclose(
        unwrapped[known] - unwrapped[0], angle[known] - angle[0], atol=1e-9, err_msg=str(hidden)
    )


def test_unwrapping_takes_rows_by_themselves_and_leaves_its_input() -> None:
    rows = np.array([[3.0, -3.0, np.nan, -2.9], [np.nan, np.nan, np.nan, np.nan]])
    before = rows.copy()
    out = unwrap_angle(rows)
    np.testing.assert_array_equal(rows, before)
    np.testing.assert_allclose(out[0], [3.0, -3.0 + 2 * math.pi, np.nan, -2.9 + 2 * math.pi])
    assert np.isnan(out[1]).all()


@given(PLACE, PLACE, PLACE, PLACE, ANGLE)
def test_frames_are_inverse(x: float, y: float, x0: float, y0: float, heading: float) -> None:
    there = to_frame(x, y, x0, y0, heading)
    np.testing.assert_allclose(from_frame(*there, x0, y0, heading), (x, y), atol=1e-7)
    np.testing.assert_allclose(math.hypot(*there), math.hypot(x - x0, y - y0), atol=1e-7)


def test_a_frame_has_x_forward_and_y_left() -> None:
    np.testing.assert_allclose(to_frame(10.0, 7.0, 10.0, 5.0, math.pi / 2), (2.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(to_frame(9.0, 5.0, 10.0, 5.0, math.pi / 2), (0.0, 1.0), atol=1e-12)


def test_corners_run_anticlockwise_from_the_front_left() -> None:
    corners = box_corners(1.0, 2.0, math.pi / 2, 4.0, 2.0)
    np.testing.assert_allclose(corners, [(0.0, 4.0), (0.0, 0.0), (2.0, 0.0), (2.0, 4.0)], atol=1e-12)


@given(BOX, BOX)
def test_overlap_is_that_of_shapely(one: tuple[float, ...], two: tuple[float, ...]) -> None:
    a, b = (shapely.Polygon(box_corners(*box)) for box in (one, two))
    apart, shared = a.distance(b), a.intersection(b).area
    assume(apart > 1e-9 or shared > 1e-9)  # where they just touch, rounding decides
    assert bool(boxes_overlap(Boxes(*one), Boxes(*two))) == (shared > 1e-9)
    assert bool(boxes_overlap(Boxes(*two), Boxes(*one))) == (shared > 1e-9)


def test_overlap_of_many_boxes_near_each_other_is_that_of_shapely() -> None:
    rng, n = np.random.default_rng(0), 5000
    x, y = rng.uniform(-5.0, 5.0, (2, n))
    turn, (length, width) = rng.uniform(-4.0, 4.0, n), rng.uniform(0.5, 6.0, (2, n))
    own = shapely.polygons(box_corners(0.0, 0.0, 0.3, 4.7, 1.9))
    expected = shapely.intersects(own, shapely.polygons(box_corners(x, y, turn, length, width)))
    assert 500 < expected.sum() < 4500
    one, many = Boxes(0.0, 0.0, 0.3, 4.7, 1.9), Boxes(x, y, turn, length, width)
    np.testing.assert_array_equal(boxes_overlap(one, many), expected)
    np.testing.assert_array_equal(boxes_overlap(many, one), expected)


def test_a_crossing_without_a_corner_inside_is_an_overlap() -> None:
    assert boxes_overlap(Boxes(0.0, 0.0, 0.0, 10.0, 2.0), Boxes(0.0, 0.0, math.pi / 2, 10.0, 2.0))


def test_touching_boxes_overlap_and_nan_never_does() -> None:
    x = np.array([4.0, 4.001, np.nan])
    hit = boxes_overlap(Boxes(0.0, 0.0, 0.0, 4.0, 2.0), Boxes(x, 0.0, 0.0, 4.0, 2.0))
    np.testing.assert_array_equal(hit, [True, False, False])
