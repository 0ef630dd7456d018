"""Scrambled Sobol points in the plane, the same bits as `scipy.stats.qmc.Sobol(2, scramble=True)`.

To load scipy.stats takes longer than all else that a run loads together, and this is all that is needed of it there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats

_Integers = NDArray[np.int64]
_BITS = 30
_DIMENSIONS = 2


def sobol_points(count: int, seed: int) -> Floats:
    """Give the first points (count, 2) in the unit square.

    Direction numbers of Joe and Kuo (2008), scrambled by random lower triangular matrices and a shift (Matousek 1998).
    """
    (random,) = np.random.default_rng(seed).spawn(1)
    bits = random.integers(2, size=(_DIMENSIONS, _BITS), dtype=np.uint32)
    quasi = bits.astype(np.int64) @ (1 << np.arange(_BITS))
    lower = np.tril(random.integers(2, size=(_DIMENSIONS, _BITS, _BITS), dtype=np.uint32)).astype(np.int64)
    lower[:, np.arange(_BITS), np.arange(_BITS)] = 1
    directions = _scrambled(_directions(), lower)
    out = np.empty((count, _DIMENSIONS))
    for k in range(count):
        out[k] = quasi
        lowest_zero = (~k & (k + 1)).bit_length() - 1
        quasi = quasi ^ directions[:, lowest_zero]
    return out * 2.0**-_BITS


def _directions() -> _Integers:
    """Direction numbers (2, bits) as integers: van der Corput's, and those of the polynomial x + 1."""
    numbers = np.ones((_DIMENSIONS, _BITS), dtype=np.int64)
    for k in range(1, _BITS):
        numbers[1, k] = 2 * numbers[1, k - 1] ^ numbers[1, k - 1]
    return numbers << np.arange(_BITS - 1, -1, -1)


def _scrambled(directions: _Integers, lower: _Integers) -> _Integers:
    """The directions, whose bits, the highest first, are multiplied by matrices (2, bits, bits) modulo 2."""
    places = np.arange(_BITS - 1, -1, -1)
    bits = directions[:, :, None] >> places & 1
    mixed = np.einsum("dpk,djk->djp", lower, bits) % 2
    return np.asarray(mixed @ (1 << places))
