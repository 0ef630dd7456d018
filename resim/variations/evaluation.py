"""How good kernels are, on the traces of vehicles that they were not trained on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from resim.core.correlation import (
    RANKS,
    independent_nonlinear,
    nonlinear,
    pearson,
    uncorrelated_pearson,
)
from resim.core.geometry import Floats
from resim.variations.kernels import KernelFile, ManeuverKernel
from resim.variations.swept import BOX

ENOUGH = 500
"""Held-out traces of a maneuver below which nothing is shown."""
UNCORRELATED = 0.15
"""Largest correlation of two components, beyond the bias of the measure."""
RECONSTRUCTED = 1e-3
"""Largest mean relative reconstruction error: the published one."""


@dataclass(frozen=True)
class KernelEvaluation:
    """What held-out traces say of a kernel.

    Attributes:
        label: The maneuver.
        held_out: How many traces.
        missing: How many more it takes until anything is shown.
        linear: Largest absolute Pearson coefficient of two components, less `linear_bias`; NaN for fewer than two
            traces.
        linear_bias: What components that are uncorrelated in truth would have on average.
        nonlinear: Largest nonlinear coefficient of two components, less `bias`; NaN where there are too few traces.
        bias: What independent components would have on average.
        reconstruction: Mean relative error.
    """

    label: str
    held_out: int
    missing: int
    linear: float
    linear_bias: float
    nonlinear: float
    bias: float
    reconstruction: float

    @property
    def shown(self) -> bool:
        """Whether there are enough traces."""
        return self.missing == 0

    @property
    def uncorrelated(self) -> bool | None:
        """Whether both measures are small; None where that is not shown."""
        return max(self.linear, self.nonlinear) < UNCORRELATED if self.shown else None

    @property
    def reconstructed(self) -> bool | None:
        """Whether the error is that published, or less; None where that is not shown."""
        return self.reconstruction < RECONSTRUCTED if self.shown else None


def evaluate(kernel: ManeuverKernel, held_out: Floats) -> KernelEvaluation:
    """Evaluate a kernel on held-out features (M, F)."""
    count = len(held_out)
    scores = kernel.components(held_out)
    linear, expected = np.nan, np.nan
    if count > 1:
        expected = uncorrelated_pearson(kernel.traces, count, kernel.count)
        linear = _largest(pearson(scores)) - expected
    more, bias = np.nan, np.nan
    if count >= RANKS:
        bias = independent_nonlinear(count)
        more = _largest(nonlinear(scores)) - bias
    return KernelEvaluation(
        kernel.label,
        count,
        max(ENOUGH - count, 0),
        linear,
        expected,
        more,
        bias,
        kernel.reconstruction_held_out,
    )


def not_shown(kernel: ManeuverKernel) -> str:
    """Say how many held-out traces are missing for anything to be shown of a kernel, "" where there are enough."""
    missing = ENOUGH - kernel.held_out
    return (
        f"not shown: {kernel.held_out} of {ENOUGH} held-out traces, {missing} are missing"
        if missing > 0
        else ""
    )


def of_humans(kernels: KernelFile, labels: Iterable[str]) -> Iterator[str]:
    """Say what may be claimed of variations of these maneuvers: whether they are as humans drive.

    Of real drives with enough held-out traces, what was found is in the report of `resim vary train` alone.
    """
    if kernels.data != "real":
        yield "the kernels come from synthetic drives: nothing is claimed of how humans drive"
        return
    for label in dict.fromkeys(labels):
        told = not_shown(kernels.kernels[label])
        told = told or f"see the report of `resim vary train`, which looks at a box of {BOX:g}"
        yield f"whether variations of {label} are as humans drive: {told}"


def _largest(matrix: Floats) -> float:
    """The largest absolute element off the diagonal, 0 of a single one."""
    off = np.abs(matrix[~np.eye(len(matrix), dtype=bool)])
    return float(off.max(initial=0.0))
