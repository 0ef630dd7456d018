"""How far a parameter can be varied until something flips."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from resim.verification.validity_interval import POINTS, Unlike, search


def test_nothing_flips_as_far_as_is_tried() -> None:
    low, high, tried = search(lambda amount: Unlike(), 4.0, 0.1)
    assert (low.amount, high.amount) == (-4.0, 4.0)
    assert low.flips == high.flips == ()
    assert tried == 2 * POINTS


@given(st.floats(0.01, 3.99), st.floats(0.01, 3.99))
def test_ends_are_found_to_the_resolution(below: float, above: float) -> None:
    low, high, _ = search(
        lambda a: Unlike(("risk",) if a < -below else ("gap",) if a > above else ()), 4.0, 0.05
    )
    assert -below <= low.amount <= -below + 0.05
    assert above - 0.05 <= high.amount <= above
    assert (low.flips, high.flips) == (("risk",), ("gap",))


def test_what_flips_and_flips_back_ends_the_interval() -> None:
    """A bisection from the far end alone would see nothing: 4 is as good as 0."""
    _, high, _ = search(lambda a: Unlike(("risk",) if 1.2 < a < 2.1 else ()), 4.0, 0.05)
    assert high.amount == pytest.approx(1.2, abs=0.05)
    assert high.flips == ("risk",)


def test_what_is_no_kpi_ends_the_interval_too() -> None:
    low, high, _ = search(lambda a: Unlike(others=("the EGO collides",) if a > 2.0 else ()), 4.0, 0.05)
    assert high.amount == pytest.approx(2.0, abs=0.05)
    assert (high.flips, high.others, low.others) == ((), ("the EGO collides",), ())
