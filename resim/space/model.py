"""The space in memory: its scenarios, who is in which cluster, and what it was made of."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.space.report import SourceEntry
from resim.space.settings import SpaceSettings
from resim.space.shared_traffic import no_moments
from resim.space.sources import ROWS
from resim.space.traces import Ints, SlotTraces

PLACED = ("bucket", "number", "cluster", "medoid", "to_medoid")
"""Columns that clustering fills: name and number of the bucket, name of the cluster, whether it is its medoid, distance
to the medoid."""
COLUMNS = ("scenario", "source", "batch", "name", "drive", *ROWS[1:], *PLACED)
"""Of scenarios.parquet; scenario: its name in the space, name: in its source; drive: source and
recording of the first one that it is one drive with; occasion, hours and kilometres count over
all sources."""
CLUSTERS = ("scenario", "source", "batch", "bucket", "cluster", "medoid", "to_medoid")
"""Of clusters.parquet."""


SHORT = 0.5
"""Share of its medoid's time that a scenario has to last for to be of its kind (our choice)."""


@dataclass(frozen=True, eq=False)
class BucketLinks:
    """How a bucket was clustered when it was first seen: threshold, by what it was chosen, method, links (N - 1, 4)."""

    threshold: float
    chosen: str
    method: str
    links: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, eq=False)
class Space:
    """A scenario space.

    Attributes:
        settings: How it is built.
        sources: What it is made of.
        rows: A row per scenario with COLUMNS, in the order in which they were added.
        traces: Their slots, in the same order.
        links: By the name of the bucket.
        moments: When vehicles of its recordings were where (`resim.space.shared_traffic`).
    """

    settings: SpaceSettings
    sources: tuple[SourceEntry, ...]
    rows: pd.DataFrame
    traces: SlotTraces
    links: dict[str, BucketLinks]
    moments: pd.DataFrame = field(default_factory=no_moments)

    @property
    def driven(self) -> tuple[float, float]:
        """Hours and kilometres that were driven, NaN where a source does not say. What is one drive counts once."""
        whole = [
            sum(told) for told in zip(*((one.hours, one.kilometres) for one in self.sources), strict=True)
        ]
        hours, kilometres = (float(told) for told in np.array(whole or [0.0, 0.0]) - self._repeated)
        return hours, kilometres

    @cached_property
    def _repeated(self) -> Floats:
        """Hours and kilometres (2,) of recordings that are a drive again: of each drive, all but the longest."""
        every = [(one.drives[name], *length) for one in self.sources for name, length in one.lengths.items()]
        found = pd.DataFrame(every, columns=["drive", "hours", "kilometres"])
        again = found[found["drive"].duplicated(keep=False)].groupby("drive")[["hours", "kilometres"]]
        return np.asarray((again.sum() - again.max()).sum(), dtype=float)

    @cached_property
    def unsure(self) -> NDArray[np.bool_]:
        """Say of each scenario (N,) whether its kind is not known.

        Its EGO leaves the lanes, so that its slots are empty as on a free road, or it lasts for less than SHORT of its
        cluster's medoid: in its first seconds every cut-out is following.
        """
        scenes, medoid = self.traces.scenes, self.rows["medoid"].to_numpy(bool)
        cluster = self.rows["cluster"].to_numpy(str)
        whole = dict(zip(cluster[medoid].tolist(), scenes[medoid].tolist(), strict=True))
        return self.traces.off_lane | (
            scenes < SHORT * np.array([whole.get(name, 0) for name in cluster.tolist()])
        )

    def by_bucket(self) -> Iterator[tuple[str, Ints]]:
        """Give the buckets by number, with the rows of their scenarios."""
        buckets = self.rows["bucket"].to_numpy(str)
        numbers = self.rows["number"].to_numpy(int)
        for number in np.unique(numbers).tolist():
            rows = np.flatnonzero(numbers == number)
            yield str(buckets[rows[0]]), rows


def bucket_names(rows: pd.DataFrame, settings: SpaceSettings) -> list[str]:
    """Give the name of each scenario's bucket."""
    if settings.bucket == "vehicles":
        return [f"{n} vehicles" for n in rows["vehicles"]]
    if settings.bucket == "lanes":
        return [
            f"{lanes} lanes, {n} vehicles" for lanes, n in zip(rows["lanes"], rows["vehicles"], strict=True)
        ]
    parts = zip(rows["map"], rows["road"], rows["along_s"], rows["lanes"], rows["vehicles"], strict=True)
    return [
        f"{place or 'unknown map'}, road {road or 'none'} {'+' if along else '-'}, {lanes} lanes, {n} vehicles"
        for place, road, along, lanes, n in parts
    ]
