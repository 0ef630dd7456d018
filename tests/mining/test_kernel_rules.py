"""The compiled rules of labels find what the plain ones of tools/mining_rules.py, written from the text, do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resim.mining import kernel

ROOT = Path(__file__).parents[2]
whole = settings(max_examples=60, deadline=None)


@whole
@given(
    st.lists(st.lists(st.integers(-9, 9), min_size=1, max_size=30), min_size=1, max_size=4),
    st.integers(1, 12),
)
def test_swings_are_those_of_the_plain_rule(pieces: list[list[int]], least: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "tools"))
        from mining_rules import swings
    first = np.cumsum([0, *map(len, pieces)])
    found = kernel.swings(np.concatenate(pieces).astype(float), first, float(least))
    expected = [
        (int(low) + one, int(low) + other)
        for low, piece in zip(first, pieces, strict=False)
        for one, other in swings(piece, least)
    ]
    assert [tuple(one) for one in found.tolist()] == expected


@whole
@given(
    st.lists(st.tuples(st.integers(1, 9), st.integers(-9, 9)), min_size=2, max_size=40),
    st.integers(1, 12),
    st.integers(1, 20),
    st.integers(0, 10**9),
)
def test_what_rises_within_a_time_is_marked_from_where_to_where_it_does(
    samples: list[tuple[int, int]], least: int, within: int, clock: int
) -> None:
    t = np.cumsum([one for one, _ in samples]) + float(clock)
    values = np.array([float(value) for _, value in samples])
    wanted = np.zeros(len(t), dtype=bool)
    for low in range(len(t)):
        for high in range(low, len(t)):
            if t[high] - t[low] <= within and values[high] - values[low] > least:
                wanted[low : high + 1] = True
    found = kernel.within_rises(t, values, np.array([0, len(t)]), float(least), float(within))
    np.testing.assert_array_equal(found, wanted)
    doubled = kernel.within_rises(
        np.r_[t, t], np.r_[values, values], np.array([0, len(t), 2 * len(t)]), float(least), float(within)
    )
    np.testing.assert_array_equal(doubled, np.r_[wanted, wanted])


def test_somebody_who_stays_aside_or_half_way_swings_when_it_comes_and_goes() -> None:
    """Whatever micrometres say of where on level ground it turns back, or passes the middle."""
    t = np.arange(0.0, 16.0, 0.04)
    over = np.clip(t - 2.0, 0.0, 1.0) - np.clip(t - 9.0, 0.0, 0.5) - np.clip(t - 13.0, 0.0, 0.5)
    rng = np.random.default_rng(1)
    for _ in range(20):
        values = 3.5 * over + rng.normal(0.0, 1e-6, len(t))
        found = t[kernel.swings(values, np.array([0, len(t)]), 1.0)]
        assert found == pytest.approx(np.array([[2.3, 2.7], [9.3, 13.2]]), abs=0.041)
