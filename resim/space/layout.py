"""Clusters laid out in a plane so that those that are alike lie beside each other."""

from __future__ import annotations

import numpy as np

from resim.core.geometry import Floats


def plane(distance: Floats) -> Floats:
    """Give places (C, 2) in a plane whose distances are near those given (C, C): classical multidimensional scaling.

    W. Torgerson, Multidimensional scaling: I. Theory and method, Psychometrika 17 (1952). Signs are such that the place
    with the largest coordinate, the first of several, has a positive one.
    """
    count = len(distance)
    out = np.zeros((count, 2))
    if count < 2:
        return out
    square = distance**2
    centred = -0.5 * (square - square.mean(axis=0) - square.mean(axis=1)[:, None] + square.mean())
    values, vectors = np.linalg.eigh(centred)
    for axis in range(min(2, count)):
        column = vectors[:, -1 - axis] * np.sqrt(max(values[-1 - axis], 0.0))
        out[:, axis] = column * np.sign(column[np.argmax(np.abs(column))] or 1.0)
    return out
