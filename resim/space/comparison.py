"""Two spaces beside each other (Wagner 2021, 6.3.2 and Fig. 6.21): what is in one only, and how far shares are apart.

The scenarios of both are clustered together, so that neither is the measure of the other.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.intervals import CONFIDENCE
from resim.core.provenance import versions
from resim.core.spec import EXACT
from resim.core.spelling import counted
from resim.space.build import cluster_buckets
from resim.space.draws import drive_numbers
from resim.space.model import Space
from resim.space.statistics.rates import IntervalEstimate, share, spread_by
from resim.space.statistics.unseen import unseen_share
from resim.space.traces import Ints, joined

MARK = "comparison.json"


@dataclass(frozen=True)
class KindComparison:
    """A kind of scenario in both spaces.

    Attributes:
        kind: Its number in the comparison.
        bucket: Of it.
        medoid: Its test case.
        one: Occasions in the first space.
        other: Occasions in the second.
        one_share: Its share there.
        other_share: Its share in the second.
        difference: Share in the first less share in the second.
    """

    kind: int
    bucket: str
    medoid: str
    one: int
    other: int
    one_share: IntervalEstimate
    other_share: IntervalEstimate
    difference: IntervalEstimate


@dataclass(frozen=True)
class SpaceComparison:
    """Two spaces compared, as comparison.json says it.

    Attributes:
        versions: Of resim and what it depends on.
        files: None.
        one: Folder of the first space.
        other: Folder of the second.
        hashes: Of both files space.json.
        kinds: All kinds, those with the largest difference first.
        only_one: Kinds that the second space does not have.
        only_other: Kinds that the first does not have.
        only_one_share: Share of the first space that is of such kinds.
        only_other_share: Share of the second likewise.
        apart: Half the sum of the differences of all shares (total variation): 0 alike, 1 nothing in common.
        notes: What is to be known to believe it.
    """

    __pydantic_config__ = EXACT

    versions: Mapping[str, str]
    files: Mapping[str, str]
    one: str
    other: str
    hashes: tuple[str, str]
    kinds: tuple[KindComparison, ...]
    only_one: int
    only_other: int
    only_one_share: IntervalEstimate
    only_other_share: IntervalEstimate
    apart: IntervalEstimate
    notes: tuple[str, ...]


def together(one: Space, other: Space, workers: int = 1) -> Space:
    """Give both spaces as one, clustered anew.

    Raises InputError where they are built in different ways, or by roads of different maps: nothing could be alike.
    """
    for name in ("distance", "bucket", "linkage", "threshold"):
        mine, theirs = getattr(one.settings, name), getattr(other.settings, name)
        if mine != theirs:
            problem = f"its {name} is {theirs!s}, that of the other space is {mine!s}"
            raise InputError("the second space", problem, "Build both spaces with the same settings.")
    if (one.sources[0].trigger, one.sources[0].rules) != (other.sources[0].trigger, other.sources[0].rules):
        problem = "its scenarios were mined with other thresholds or triggers than those of the other space"
        raise InputError("the second space", problem, "Mine both with the same thresholds and triggers.")
    maps, others = ({str(name) or "unknown" for name in space.rows["map"]} for space in (one, other))
    if one.settings.bucket == "road" and maps.isdisjoint(others):
        problem = f"its maps ({', '.join(sorted(others))}) are none of the other space's ({', '.join(sorted(maps))})"
        remedy = 'Scenarios are compared on one road: build both spaces with bucket = "lanes" or "vehicles".'
        raise InputError("the second space", problem, remedy)
    rows = other.rows.assign(occasion=other.rows["occasion"] + one.rows["occasion"].max() + 1)
    both = pd.concat([one.rows.assign(space=0), rows.assign(space=1)], ignore_index=True)
    names = [
        "one/" + name if k == 0 else "other/" + name
        for k, name in zip(both["space"], both["scenario"], strict=True)
    ]
    whole = replace(
        one,
        rows=both.assign(
            scenario=pd.array(names, dtype="string"), batch=both["space"],
            drive=both["space"].astype(str) + "/" + both["drive"],
        ),
        traces=joined([one.traces, other.traces]), links={},
    )  # fmt: skip
    return cluster_buckets(whole, workers)


def compare_spaces(both: Space, names: tuple[str, str], hashes: tuple[str, str]) -> SpaceComparison:
    """Compare two spaces that were put together. names, hashes: of their folders and files."""
    rows = both.rows
    label, kind = np.unique(rows["cluster"].to_numpy(str), return_inverse=True)
    space, occasion = rows["batch"].to_numpy(int), rows["occasion"].to_numpy(np.intp)
    counts = np.stack([_occasions(kind[space == k], occasion[space == k], len(label)) for k in (0, 1)])
    total = counts.sum(axis=1)
    drive = drive_numbers(rows)
    spread = tuple(_spread(kind[space == k], occasion[space == k], drive[space == k]) for k in (0, 1))
    shares = [[share(c / spread[k], total[k] / spread[k]) for c in counts[k].tolist()] for k in (0, 1)]
    medoids, buckets = (_of_cluster(rows, column, label) for column in ("scenario", "bucket"))
    kinds = [
        KindComparison(
            k + 1, buckets[k], medoids[k], int(counts[0, k]), int(counts[1, k]), shares[0][k], shares[1][k],
            difference(shares[0][k], shares[1][k]),
        )
        for k in range(len(label))
    ]  # fmt: skip
    lone = counts == 0
    only = [share(float(counts[k][lone[1 - k]].sum()) / spread[k], total[k] / spread[k]) for k in (0, 1)]
    words = ("first", "second")
    notes = [f"the {word} space: {_driven_by(rows['build'][space == k])}" for k, word in enumerate(words)]
    notes += [
        f"the {word} space has {counted(n, 'occasion')} in {counted(drives, 'drive')}: what is only in one may be only "
        "not seen in the other, and each drive may have kinds of its own"
        for word, n, drives in zip(words, total.tolist(), (len(set(drive[space == k])) for k in (0, 1)), strict=True)
        if n < 1000 or drives < 100
    ]  # fmt: skip
    notes += _elsewhere(rows, space) if both.settings.bucket == "road" else []
    return SpaceComparison(
        versions(), {}, *names, hashes, tuple(sorted(kinds, key=lambda one: (-abs(one.difference.value), one.kind))),
        int(lone[1].sum()), int(lone[0].sum()), only[0], only[1], variation(counts, spread), tuple(notes),
    )  # fmt: skip


def _driven_by(build: pd.Series[str]) -> str:
    """Who drove the EGOs of a space's scenarios."""
    counts = sorted(Counter(build.astype(str).tolist()).items())
    told = [
        f"{n} scenarios {f'driven by build {name[:12]}' if name else 'of people, or where nobody says who drove'}"
        for name, n in counts
    ]
    return ", ".join(told)


def _elsewhere(rows: pd.DataFrame, space: Ints) -> Iterator[str]:
    """How much of each space is on maps that the other does not have."""
    maps = [set(rows["map"][space == k]) for k in (0, 1)]
    for k, word in enumerate(("first", "second")):
        lone = rows["map"][space == k].isin(maps[k] - maps[1 - k])
        if lone.any():
            yield (
                f"{int(lone.sum())} of {len(lone)} scenarios of the {word} space are on maps that the other does not "
                "have, and can be of no kind of it: buckets by lanes or vehicles compare them"
            )


def difference(one: IntervalEstimate, other: IntervalEstimate) -> IntervalEstimate:
    """Give the difference of two shares, its interval from theirs.

    R. Newcombe, Interval estimation for the difference between independent proportions (Statistics in Medicine 17,
    1998), method 10, with exact limits in place of Wilson's.
    """
    value = one.value - other.value
    low = value - np.hypot(one.value - one.low, other.high - other.value)
    high = value + np.hypot(one.high - one.value, other.value - other.low)
    return IntervalEstimate(value, float(max(low, -1.0)), float(min(high, 1.0)))


def variation(counts: Ints, spread: tuple[float, ...], confidence: float = CONFIDENCE) -> IntervalEstimate:
    """Give the total variation of two distributions over kinds, from counts (2, C), with an interval on the safe side.

    The lower end takes the kinds that have the larger share in a drawn half of each sample (always the same draw), and
    compares the shares of these together in the other halves. The upper end is the estimate with the mean
    error of C shares (at most half the root of C / n), its scatter (McDiarmid), and all that was not seen of either.
    """
    n = counts.sum(axis=1) / np.array(spread)
    if (n == 0.0).any():
        return IntervalEstimate(np.nan, 0.0, 1.0, confidence)
    shares = counts / counts.sum(axis=1, keepdims=True)
    value = float(0.5 * np.abs(shares[0] - shares[1]).sum())
    first = np.random.default_rng(0).binomial(counts, 0.5)
    low = _held_out_gap(first, counts - first, spread, confidence)
    wide = 0.5 * np.sqrt(counts.shape[1] / n).sum() + np.sqrt(
        0.5 * np.log(4.0 / (1.0 - confidence)) * (1.0 / n).sum()
    )
    unseen = sum(unseen_share(c[c > 0], s, confidence).high for c, s in zip(counts, spread, strict=True))
    return IntervalEstimate(value, min(low, value), float(min(value + wide + unseen, 1.0)), confidence)


def _held_out_gap(first: Ints, second: Ints, spread: tuple[float, ...], confidence: float) -> float:
    """Lower limit of by how much more of one distribution lies in the kinds that a first half names."""
    whole = np.maximum(first.sum(axis=1, keepdims=True), 1)
    mine = (first / whole)[0] > (first / whole)[1]
    held = second.sum(axis=1)
    if (held == 0).any():
        return 0.0
    one, other = (
        share(float(second[k][mine].sum()) / spread[k], float(held[k]) / spread[k], confidence)
        for k in (0, 1)
    )
    return max(difference(one, other).low, 0.0)


def _occasions(kind: Ints, occasion: Ints, clusters: int) -> Ints:
    if not len(kind):
        return np.zeros(clusters, dtype=np.intp)
    return np.bincount(np.unique(np.stack([kind, occasion]), axis=1)[0], minlength=clusters)


def _spread(kind: Ints, occasion: Ints, drive: Ints) -> float:
    """How many occasions of kinds come in one drive: drives of one population may have kinds of their own, so that two
    sets of few drives are apart, and show nothing of two populations."""
    if not len(kind):
        return 1.0
    _, first = np.unique(np.stack([kind, occasion]), axis=1, return_index=True)
    return spread_by(drive[first])


def _of_cluster(rows: pd.DataFrame, column: str, label: np.ndarray) -> list[str]:
    """A column at the medoid of each cluster."""
    medoids = rows[rows["medoid"]]
    by_name = dict(zip(medoids["cluster"].astype(str), medoids[column].astype(str), strict=True))
    return [by_name[name] for name in label.tolist()]
