"""Points of the Halton sequence with reverse-radix scrambling (Kocis and Whiten 1997, RR2; Wagner 2021, B.3).

Readings taken: points begin at n = 1 (B.12 to B.14). "Reverse the binary digits" alone is no permutation of the digits
of a base; RR2 reverses the bits of 0, 1, ..., 2^k - 1 in order, with k bits as b - 1 has, and strikes out what is b or
larger: base 5 has 0 4 2 1 3. The j-th coordinate has the j-th prime as base.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats

LARGEST = 1 << 40
"""Index up to which points are exact: of them, numerator and denominator are whole numbers of 64 bits."""


@lru_cache(maxsize=8)
def primes(count: int) -> tuple[int, ...]:
    """Give the first `count` primes."""
    found: list[int] = []
    number = 2
    while len(found) < count:
        if all(number % p for p in found if p * p <= number):
            found.append(number)
        number += 1
    return tuple(found)


@lru_cache(maxsize=256)
def reverse_radix(base: int) -> tuple[int, ...]:
    """Give the permutation (base,) of the digits of a base: what each digit becomes."""
    bits = max((base - 1).bit_length(), 1)
    reversed_bits = (int(f"{digit:0{bits}b}"[::-1], 2) for digit in range(1 << bits))
    return tuple(digit for digit in reversed_bits if digit < base)


def halton(first: int, count: int, dimensions: int, *, scrambled: bool = True) -> Floats:
    """Give points (count, dimensions) in [0, 1) of the sequence, those of n = first, first + 1, ...

    first: 1 or more. scrambled: by reverse radix; else the plain sequence of Algorithm B.1. Each coordinate is the
    number of the sequence, rounded once. Raises ValueError for an index that is none.
    """
    if first < 1 or first + count - 1 > LARGEST:
        raise ValueError(f"expected indices from 1 to {LARGEST}, got {first} to {first + count - 1}")
    index = np.arange(first, first + count, dtype=np.int64)
    out = np.empty((count, dimensions))
    for j, base in enumerate(primes(dimensions)):
        digits = np.array(reverse_radix(base) if scrambled else range(base), dtype=np.int64)
        out[:, j] = _radical_inverse(index, base, digits)
    return out


def _radical_inverse(index: NDArray[np.int64], base: int, digits: NDArray[np.int64]) -> Floats:
    """Digits (K,) behind the point, as one fraction: rounded once only, as both of its numbers are below 2^53."""
    numerator, denominator, rest = np.zeros_like(index), 1, index
    while rest.any():
        numerator = numerator * base + digits[rest % base]
        denominator *= base
        rest = rest // base
    return np.asarray(numerator / denominator)
