from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resim.core.errors import ResimError
from resim.core.tracks import Tracks


def tracks(valid: object = ((1, 1, 1, 1), (0, 1, 1, 0)), *, t: object = (0.0, 0.1, 0.2, 0.3)) -> Tracks:
    """Objects a, b, ... that drive east at 10, 11, ... m/s, 5 m apart."""
    t_, mask = np.array(t, dtype=float), np.array(valid, dtype=bool)
    n = len(mask)
    v = 10.0 + np.arange(n)[:, None] + np.zeros(len(t_))

    def there(values: object) -> np.ndarray:
        return np.where(mask, values, np.nan)

    return Tracks(
        t=t_, ids=np.array(list("abcdefgh"[:n])), kind=np.array(["car"] * n), x=there(v * t_), valid=mask,
        y=there(5.0 * np.arange(n)[:, None] + 0.0 * t_), heading=there(0.0 * v), v=there(v),
        length=4.0 + np.arange(n), width=np.full(n, 2.0),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"ids": np.array(["a", "a"])}, "is a duplicate"),
        ({"t": np.array([0.0, 0.1, 0.1, 0.3])}, "increase strictly"),
        ({"t": np.array([0.0, 0.2, 0.1, 0.3])}, "increase strictly"),
        ({"x": np.zeros((2, 3))}, r"x has shape \(2, 3\), expected \(2, 4\)"),
        ({"yaw_rate": np.zeros((1, 4))}, "yaw_rate has shape"),
        ({"kind": np.array(["car"])}, r"kind has shape \(1,\), expected \(2,\)"),
        ({"length": np.zeros(3)}, "length has shape"),
        ({"v": np.full((2, 4), np.nan)}, "v holds NaN in a valid sample"),
        ({"heading": np.full((2, 4), np.inf)}, "heading holds NaN"),
    ],
)
def test_tracks_that_contradict_themselves_are_refused(change: dict[str, np.ndarray], text: str) -> None:
    with pytest.raises(ResimError, match=text):
        replace(tracks(), **change)


def test_rows_are_found_selected_and_left_out_by_id() -> None:
    three = tracks(np.ones((3, 4)))
    assert three.index("b") == 1
    assert three.select(["c", "a"]).ids.tolist() == ["c", "a"]
    np.testing.assert_array_equal(three.select(["c", "a"]).x, three.x[[2, 0]])
    assert three.without("b").ids.tolist() == ["a", "c"]
    assert three.without("nobody").ids.tolist() == ["a", "b", "c"]
    with pytest.raises(ResimError, match="no object 'z' among a, b, c"):
        three.index("z")


def test_span_is_the_first_and_last_valid_time() -> None:
    first, last = tracks([[0, 1, 0, 1], [1, 1, 0, 0], [0, 0, 0, 0]]).span()
    np.testing.assert_array_equal(first, [0.1, 0.0, np.nan])
    np.testing.assert_array_equal(last, [0.3, 0.1, np.nan])


def test_a_window_has_its_borders_and_nobody_who_is_not_there() -> None:
    cut = tracks([[1, 1, 1, 1], [1, 0, 0, 0]]).window(0.1, 0.2)
    np.testing.assert_array_equal(cut.t, [0.1, 0.2])
    assert cut.ids.tolist() == ["a"]
    assert cut.length.tolist() == [4.0]


def test_shifting_moves_the_times_only() -> None:
    one, two = tracks(), tracks().shifted(2.5)
    np.testing.assert_array_equal(two.t, one.t + 2.5)
    np.testing.assert_array_equal(two.x, one.x)


def test_between_samples_values_are_linear_and_nothing_is_extrapolated() -> None:
    at = tracks().at([-0.01, 0.0, 0.05, 0.25, 0.3, 0.31])
    np.testing.assert_allclose(at.x[0], [np.nan, 0.0, 0.5, 2.5, 3.0, np.nan])
    np.testing.assert_array_equal(at.valid[1], [False] * 6)  # b is there from 0.1 to 0.2 s only
    np.testing.assert_allclose(tracks().at([0.1, 0.15]).x[1], [1.1, 1.65])


def test_gaps_are_bridged_up_to_the_limit_and_samples_beside_a_gap_stay() -> None:
    gap = tracks([[1, 1, 0, 1, 1]], t=[0.0, 0.1, 0.3, 0.5, 0.6])
    np.testing.assert_array_equal(gap.at([0.1, 0.3, 0.5], max_gap=0.3).valid, [[True, False, True]])
    np.testing.assert_allclose(gap.at([0.3], max_gap=0.4).x, [[3.0]])


def test_a_time_beside_a_gap_that_differs_by_rounding_is_the_sample() -> None:
    gap = tracks([[1, 1, 0, 0, 1]], t=[0.0, 0.3, 0.5, 0.7, 0.9])
    assert gap.at([0.1 + 0.2]).valid.all()


def test_headings_are_interpolated_the_short_way_round() -> None:
    turning = replace(tracks(np.ones((1, 2)), t=[0.0, 0.1]), heading=np.array([[3.1, -3.1]]))
    middle = float(turning.at([0.05]).heading[0, 0])
    assert abs(abs(middle) - np.pi) < 1e-12


@given(st.lists(st.lists(st.booleans(), min_size=5, max_size=5), min_size=1, max_size=5))
def test_the_table_of_tracks_gives_them_back(valid: list[list[bool]]) -> None:
    mask = np.array(valid)
    mask[:, 0] = True  # someone at every time, everyone at some
    mask[0] = True
    one = tracks(mask, t=[0.0, 0.04, 0.1, 0.5, 2.0])
    one = replace(one, a=np.where(mask, 0.5, np.nan))
    two = Tracks.from_frame(one.to_frame())
    assert two.ids.tolist() == one.ids.tolist()
    for name in ("t", "kind", "x", "y", "heading", "v", "length", "width", "valid", "a"):
        np.testing.assert_array_equal(getattr(two, name), getattr(one, name), err_msg=name)
    assert two.yaw_rate is None
    pd.testing.assert_frame_equal(two.to_frame(), one.to_frame())


def test_a_table_names_objects_in_the_order_they_come() -> None:
    frame = tracks([[0, 1, 1, 1], [1, 1, 1, 1]]).to_frame()
    assert frame["id"].tolist() == ["b", "a", "b", "a", "b", "a", "b"]
    assert Tracks.from_frame(frame).ids.tolist() == ["b", "a"]


def test_concatenating_keeps_what_all_parts_measured() -> None:
    one = tracks(np.ones((1, 4)))
    two = replace(one, ids=np.array(["z"]), a=np.ones((1, 4)))
    both = Tracks.concatenate([one, two])
    assert both.ids.tolist() == ["a", "z"]
    assert both.a is None
    again = Tracks.concatenate([two, replace(two, ids=np.array(["y"]))])
    np.testing.assert_array_equal(again.a, np.ones((2, 4)))
    with pytest.raises(ResimError, match="is a duplicate"):
        Tracks.concatenate([one, one])


def test_concatenating_parts_of_other_times_is_refused() -> None:
    one = tracks(np.ones((1, 4)))
    with pytest.raises(ResimError, match="times"):
        Tracks.concatenate([one, replace(one, ids=np.array(["z"]), t=one.t + 1.0)])


def test_split_and_joined_are_inverse() -> None:
    t = np.arange(0.0, 10.0, 0.1)
    x = np.stack([t, t + 50.0])
    x[0, (t > 2.0) & (t < 4.0)] = np.nan
    x[0, (t > 6.0) & (t < 6.5)] = np.nan
    x[1, (t > 3.0) & (t < 8.0)] = np.nan
    valid = np.isfinite(x)
    other = np.where(valid, 1.0, np.nan)
    whole = Tracks(
        t=t, ids=np.array(["a", "e"]), kind=np.array(["car", "car"]), x=x, y=other, heading=other, v=other,
        length=np.array([4.0, 5.0]), width=np.array([2.0, 2.0]), valid=valid,
    )  # fmt: skip
    parts = whole.split(1.0, keep="e")
    assert parts.ids.tolist() == ["a", "a~2", "e"]
    assert parts.length.tolist() == [4.0, 4.0, 5.0]
    first, last = parts.span()
    np.testing.assert_allclose((first[1], last[0]), (4.0, 2.0))
    np.testing.assert_array_equal(parts.joined().x, whole.x)
    np.testing.assert_array_equal(parts.joined().valid, whole.valid)
    assert whole.split(20.0, keep="e") is whole


def test_ids_that_read_as_parts_are_refused_where_it_would_matter() -> None:
    one = np.ones((2, 3))
    both = Tracks(
        t=np.arange(3.0), ids=np.array(["a", "a~2"]), kind=np.array(["car", "car"]), x=one, y=one, heading=one, v=one,
        length=np.ones(2), width=np.ones(2), valid=one > 0.0,
    )  # fmt: skip
    with pytest.raises(ResimError, match="the id 'a~2' reads as a part of object 'a'"):
        both.split(1.0, keep="a")
    assert both.select(["a~2"]).split(1.0, keep="") is not None
