"""Halton points with reverse-radix scrambling, against published numbers and exact fractions."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resim.core.halton import halton, primes, reverse_radix

MATHWORKS = [
    [0.0928, 0.6950, 0.0029],
    [0.6958, 0.2958, 0.8269],
    [0.3013, 0.6497, 0.4141],
    [0.9087, 0.7883, 0.2166],
]
"""net(scramble(haltonset(3, 'Skip', 1000, 'Leap', 100), 'RR2'), 4) as MathWorks publishes it."""


def test_the_twelve_published_numbers() -> None:
    points = halton(1000, 304, 3)[::101]
    np.testing.assert_allclose(points, MATHWORKS, atol=0.5e-4)


def exact_permutation(base: int) -> list[int]:
    """All bit strings as long as the base's largest digit, last bit slowest, read as numbers; too large ones struck."""
    bits = 1
    while 2**bits < base:
        bits += 1
    numbers = [
        sum(bit << place for place, bit in enumerate(lowest_first))
        for lowest_first in product((0, 1), repeat=bits)
    ]
    return [number for number in numbers if number < base]


def exact_point(n: int, base: int, digits: list[int]) -> Fraction:
    """Algorithm B.1 with a permutation, in fractions."""
    r, place = Fraction(0), Fraction(1)
    while n > 0:
        place /= base
        r += place * digits[n % base]
        n //= base
    return r


def test_a_thousand_points_in_twenty_dimensions_are_exact() -> None:
    bases = [p for p in range(2, 72) if all(p % q for q in range(2, p))]
    assert len(bases) == 20
    points = halton(1, 1000, 20)
    for j, base in enumerate(bases):
        digits = exact_permutation(base)
        wanted = [float(exact_point(n, base, digits)) for n in range(1, 1001)]
        np.testing.assert_array_equal(points[:, j], wanted)


def test_plain_points_are_those_of_the_source() -> None:
    wanted = [[1 / 2, 1 / 3], [1 / 4, 2 / 3], [3 / 4, 1 / 9], [1 / 8, 4 / 9], [5 / 8, 7 / 9]]  # Eq. B.14
    np.testing.assert_array_equal(halton(1, 5, 2, scrambled=False), wanted)


@pytest.mark.parametrize("base", [2, 3, 5, 7, 61, 67, 521])
def test_scrambling_permutes_the_digits_and_keeps_zero(base: int) -> None:
    digits = reverse_radix(base)
    assert sorted(digits) == list(range(base))
    assert digits[0] == 0
    assert reverse_radix(5) == (0, 4, 2, 1, 3)


def test_scrambling_decorrelates_high_dimensions() -> None:
    plain, scrambled = (halton(1, 100, 20, scrambled=s)[:, 17:19] for s in (False, True))  # Fig. B.5
    assert np.corrcoef(plain.T)[0, 1] > 0.6
    assert abs(np.corrcoef(scrambled.T)[0, 1]) < 0.3


@settings(deadline=None, max_examples=30)
@given(st.integers(1, 10**9), st.integers(1, 50), st.integers(1, 40))
def test_any_stretch_is_a_part_of_the_same_sequence(first: int, count: int, dimensions: int) -> None:
    points = halton(first, count, dimensions)
    assert ((points >= 0.0) & (points < 1.0)).all()
    np.testing.assert_array_equal(points[-1:, :1], halton(first + count - 1, 1, 1))


def test_every_power_of_a_base_fills_its_parts_evenly() -> None:
    for j, base in enumerate(primes(6)):
        cells = np.floor(halton(base**2, base**2, 6)[:, j] * base**2)
        assert len(set(cells.tolist())) == base**2


def test_indices_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match="expected indices from 1"):
        halton(0, 3, 2)
