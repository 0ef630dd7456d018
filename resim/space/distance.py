"""How far apart two scenarios are: the slot distance of the eight-vehicle model (Wagner 2021, 6.2.3).

As published: in each slot |difference of the metres ahead| / 95 m where both scenes hold it, 1.5 where one alone
does, 0 where none does; summed over the eight slots; the mean over the common time at 5 Hz. It is in [0, 12],
symmetric, and 0 of a scenario to itself. What the options add is on top of that, and each is 0 as published.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from resim.core.geometry import Floats
from resim.core.spec import Strict
from resim.space.traces import RATE, Ints, SlotTraces

LONGEST = 95.0
"""m: the longest distance within a slot, 100 m ahead less 5 m beside."""
VACANT = 1.5
FULL_SPEED = 10.0
"""m/s of difference that count in full (our choice): more than 95 % of speeds relative to the EGO in traffic of
`resim traffic` are within."""
FULL_BEND = 0.01
"""1/m of difference that count in full (our choice): a curve of 100 m against a straight road."""
ROWS = 64
"""Rows of the matrix that are one piece of work."""

Weight = Annotated[float, Field(strict=True, ge=0.0, le=1e6)]


class DistanceOptions(Strict):
    """What counts beside the published distance, all 0 as published.

    Attributes:
        unequal: What a difference in length costs: times the share of time that the longer one has alone.
        warp: s by which scenes may be aligned in time (dynamic time warping), -1 for none.
        speed: What a difference of FULL_SPEED in speed relative to the EGO costs, in each slot that both hold.
        lane: What it costs that the EGO is on another lane, counted from the right.
        bend: What a difference of FULL_BEND in the curvature of the lane costs.
    """

    unequal: Weight = 0.0
    warp: Annotated[float, Field(strict=True, ge=-1.0)] = -1.0
    speed: Weight = 0.0
    lane: Weight = 0.0
    bend: Weight = 0.0

    @property
    def longest(self) -> float:
        """The largest distance that there can be."""
        return 8.0 * max(VACANT, 1.0 + self.speed) + self.lane + self.bend + self.unequal


PUBLISHED = DistanceOptions()


class PairDistances:
    """Distances between scenarios, computed when they are asked for. The result is the same for any number of workers.

    traces: the scenarios, each with a scene at least.
    """

    def __init__(self, traces: SlotTraces, options: DistanceOptions = PUBLISHED, workers: int = 1) -> None:
        # compiled: numba is imported where it is used only
        from resim.space import kernel

        self.count = len(traces)
        self._kernel, self._workers = kernel, max(workers, 1)
        held = np.isfinite(traces.offset)
        self._samples = kernel.SlotSamples(
            traces.first, np.where(held, traces.offset, kernel.AWAY), np.where(held, traces.speed, 0.0), traces.lane,
            traces.bend,
        )  # fmt: skip
        more = options.speed + options.lane + options.bend > 0.0
        weights = kernel.SceneWeights(
            LONGEST, VACANT, more, options.speed, FULL_SPEED, options.lane, options.bend, FULL_BEND
        )
        window = options.warp * RATE if options.warp >= 0.0 else -1.0
        self._how = kernel.PairMeasure(weights, window, options.unequal)

    def condensed(self) -> Floats:
        """Give the distances of all pairs (N (N - 1) / 2,), row by row of the upper triangle, as scipy has them."""
        n = self.count
        out = np.empty(n * (n - 1) // 2)

        def fill(low: int) -> None:
            high = min(low + ROWS, n)
            begin, end = (a * n - a * (a + 1) // 2 for a in (low, high))
            self._kernel.triangle(self._samples, self._how, (low, high), out[begin:end])

        self._each(fill, range(0, n, ROWS))
        return out

    def between(self, ones: Ints, others: Ints) -> Floats:
        """Give the distances (A, B) of scenarios ones (A,) to others (B,), both rows."""
        ones, others = np.asarray(ones, np.intp), np.asarray(others, np.intp)
        out = np.empty((len(ones), len(others)))

        def fill(low: int) -> None:
            part = slice(low, low + ROWS)
            self._kernel.between(self._samples, ones[part], others, self._how, out[part])

        self._each(fill, range(0, len(ones), ROWS))
        return out

    def _each(self, fill: Any, lows: range) -> None:
        if self._workers == 1 or len(lows) < 2:
            for low in lows:
                fill(low)
            return
        with ThreadPoolExecutor(self._workers) as pool:
            list(pool.map(fill, lows))


def pair_rows(count: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Give the rows (P,), (P,) of the pairs of a condensed matrix."""
    one, two = np.triu_indices(count, 1)
    return one.astype(np.int32), two.astype(np.int32)
