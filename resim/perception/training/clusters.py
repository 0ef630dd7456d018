"""What can be said from few drives: standard errors from how drives differ, and how many of them are sure.

Drives are independent of each other; what is within one is not. Dividing a sum over drives by the root of its squared
parts cannot give more than the root of their number, whatever is there. So estimates are judged, not scores: a drive
is left out at a time (one Newton step; CV3 of MacKinnon, Nielsen and Webb, Cluster-robust inference, 2023), and the
statistic is held against Student's t of as many drives less one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher
from scipy.stats import norm
from scipy.stats import t as student

from resim.core.geometry import Floats

FEWEST = 5
"""Drives below which how they differ says nothing."""


def by_drive(rows: Floats, drive: NDArray[np.intp]) -> Floats:
    """Sum rows (R, ...) by drive (R,): (D, ...), of the drives that there are, in their order."""
    names, index = np.unique(drive, return_inverse=True)
    out = np.zeros((len(names), *rows.shape[1:]))
    np.add.at(out, index, rows)
    return out


def between_drives(scores: Floats, information: Floats, held: Floats | float = 0.0) -> Floats:
    """Give the covariance (P, P) of P estimates from how they change as each of D drives is left out.

    scores (D, P), information (D, P, P): of each drive, at the estimates; held (P, P): what else holds them.
    """
    count, whole = len(scores), information.sum(axis=0) + held
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    rest = (whole - information) / scale[:, None] / scale[None, :]
    moves = np.stack([_inverse(r) @ (s / scale) for r, s in zip(rest, scores, strict=True)]) / scale
    return np.asarray((count - 1) / count * moves.T @ moves)


def drive_effect(mean: Floats, weight: Floats, drive: NDArray[np.intp]) -> tuple[float, float] | None:
    """Give how likely it is by chance that means (R,) of rows differ so from drive to drive, and the variance that the
    drives add; None where drives or rows are too few to tell. Analysis of variance, rows by their weight (R,)."""
    rows = weight > 1e-6 * weight.max(initial=0.0)
    mean, weight, drives = mean[rows], weight[rows], drive[rows]
    of, index = by_drive(weight, drives), np.unique(drives, return_inverse=True)[1]
    count, free = len(of), len(mean) - len(of)
    if count < FEWEST or free < count:
        return None
    middle = by_drive(weight * mean, drives) / of
    within = float((weight * (mean - middle[index]) ** 2).sum()) / free
    between = float((of * (middle - np.average(middle, weights=of)) ** 2).sum()) / (count - 1)
    p = float(fisher.sf(between / max(within, 1e-300), count - 1, free))
    return p, max(between - within, 0.0) * (count - 1) / float(of.sum() - (of**2).sum() / of.sum())


def larger(model: Floats, drives: Floats) -> Floats:
    """Give the covariance (P, P) that the model of the errors tells, widened where drives differ by more."""
    wider = np.sqrt(np.maximum(np.diag(drives) / np.diag(model), 1.0))
    return np.asarray(model * wider[:, None] * wider[None, :])


def certain(normal: float, drives: int) -> float:
    """Give how many standard errors from this many drives are as unlikely by chance as `normal` known ones."""
    return float(student.isf(norm.sf(normal), max(drives, FEWEST) - 1))


def quantile(drives: int) -> float:
    """Give the factor of a standard error for 95 %."""
    return float(student.ppf(0.975, max(drives, FEWEST) - 1))


def _inverse(matrix: Floats) -> Floats:
    """Give the inverse of a positive definite matrix; where nothing is left to tell it is large, not infinite."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors / np.maximum(values, 1e-6)) @ vectors.T)
