"""Hierarchical agglomerative clustering of one bucket (Wagner 2021, 6.2.4 and B.4), with scipy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

from resim.core.geometry import Floats
from resim.space.agreement import adjusted_rand
from resim.space.traces import Ints

Linkage = Literal["single", "complete", "average", "weighted"]
"""Those that take any distance; Ward, centroid and median want a Euclidean one (B.4.2)."""
Choice = Literal["silhouette", "stability"]
PUBLISHED_THRESHOLD = 0.7
"""Of the published bucket, with complete linkage (6.2.4.3)."""
CANDIDATES = 25
"""Thresholds that are tried, from 0.2 to 3 (our choice): 0.14 is told alike and 2.0 unlike (6.2.3.4)."""
DRAWS, SHARE = 10, 0.8
"""Samples without replacement by which stability is judged, and their share of the scenarios (our choice)."""


@dataclass(frozen=True, eq=False)
class BucketClusters:
    """The clusters of N scenarios. Clusters are counted from 0 in the order of their first members.

    Attributes:
        label: (N,) cluster of each.
        medoid: (C,) row of the member that is nearest to all others in the mean, the first of several.
        radius: (C,) largest distance of a member to the medoid.
        links: (N - 1, 4) the dendrogram, as scipy has it; (0, 4) where there is none.
        threshold: Up to and with which links are accepted.
    """

    label: Ints
    medoid: Ints
    radius: Floats
    links: Floats
    threshold: float

    @property
    def count(self) -> int:
        """How many clusters there are."""
        return len(self.medoid)

    @property
    def sizes(self) -> Ints:
        """How many members (C,) each has."""
        return np.bincount(self.label, minlength=self.count)


@dataclass(frozen=True, eq=False)
class ThresholdChoice:
    """How a threshold was chosen: the criterion's value (T,) at the thresholds (T,) tried, and the best."""

    criterion: str
    thresholds: Floats
    values: Floats
    best: float


def dendrogram(condensed: Floats, how: Linkage) -> Floats:
    """Give the links (N - 1, 4) of scenarios with these distances (N (N - 1) / 2,)."""
    return np.zeros((0, 4)) if not len(condensed) else np.asarray(linkage(condensed, how))


def cut(links: Floats, threshold: float) -> Ints:
    """Give the cluster (N,) of each scenario, links up to and with the threshold accepted."""
    if not len(links):
        return np.zeros(1, dtype=np.intp)
    return _in_order(np.asarray(fcluster(links, threshold, "distance"), dtype=np.intp))


def _in_order(label: Ints) -> Ints:
    """Labels counted from 0 in the order of the first members."""
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.intp)
    rank[np.argsort(first)] = np.arange(len(first))
    return np.asarray(rank[inverse], dtype=np.intp)


def cluster(
    condensed: Floats, how: Linkage = "complete", threshold: float = PUBLISHED_THRESHOLD
) -> BucketClusters:
    """Give the clusters of scenarios with these distances (N (N - 1) / 2,)."""
    links = dendrogram(condensed, how)
    return described(condensed, cut(links, threshold), links, threshold)


def described(condensed: Floats, label: Ints, links: Floats, threshold: float) -> BucketClusters:
    """Give clusters with their medoids and radii."""
    # compiled: numba is imported where it is used only
    from resim.space import kernel

    n = len(label)
    order = np.argsort(label, kind="stable")
    start = np.searchsorted(label[order], np.arange(label.max(initial=-1) + 2))
    total, _ = kernel.sums(condensed, n, order, start)
    medoid, radius = np.empty(len(start) - 1, np.intp), np.zeros(len(start) - 1)
    for c in range(len(start) - 1):
        members = order[start[c] : start[c + 1]]
        medoid[c] = members[int(np.argmin(total[start[c] : start[c + 1]]))]
        others = members[members != medoid[c]]
        radius[c] = condensed[place(n, others, medoid[c])].max(initial=0.0)
    return BucketClusters(label, medoid, radius, links, threshold)


def place(count: int, one: Ints, two: Ints | np.intp) -> Ints:
    """Give where in a condensed matrix the pairs of different rows one (P,) and two stand."""
    low, high = np.minimum(one, two), np.maximum(one, two)
    return np.asarray(low * count - low * (low + 1) // 2 + high - low - 1, dtype=np.intp)


def silhouette(condensed: Floats, label: Ints) -> float:
    """Give the mean silhouette width (Rousseeuw 1987), 0 for who is alone; NaN for one cluster or none but lone
    ones.
    """
    # compiled: numba is imported where it is used only
    from resim.space import kernel

    clusters = int(label.max(initial=-1)) + 1
    if not 1 < clusters < len(label):
        return np.nan
    sizes = np.bincount(label)
    sums = kernel.mean_to_clusters(condensed, len(label), label, clusters)
    rows = np.arange(len(label))
    own = sums[rows, label] / np.maximum(sizes[label] - 1, 1)
    other = sums / sizes
    other[rows, label] = np.inf
    nearest = other.min(axis=1)
    width = (nearest - own) / np.maximum(np.maximum(own, nearest), 1e-300)
    return float(np.where(sizes[label] > 1, width, 0.0).mean())


def stability(condensed: Floats, count: int, how: Linkage, thresholds: Floats, seed: int) -> Floats:
    """Give how alike (T,) the clusters of DRAWS samples are to those of all, as the mean adjusted Rand index; NaN where
    all are one cluster, or all alone.
    """
    rng = np.random.default_rng(seed)
    whole = dendrogram(condensed, how)
    labels = [cut(whole, float(t)) for t in thresholds]
    found = np.zeros((DRAWS, len(thresholds)))
    for draw in range(DRAWS):
        rows = np.sort(rng.permutation(count)[: max(int(SHARE * count), 2)])
        one, two = np.triu_indices(len(rows), 1)
        links = dendrogram(condensed[place(count, rows[one], rows[two])], how)
        for k, t in enumerate(thresholds.tolist()):
            found[draw, k] = adjusted_rand(labels[k][rows], cut(links, t))
    trivial = [not 1 < int(label.max()) + 1 < count for label in labels]
    return np.where(trivial, np.nan, found.mean(axis=0))


def choose_threshold(
    condensed: Floats, count: int, how: Linkage, by: Choice, seed: int = 0
) -> ThresholdChoice:
    """Give the threshold at which a criterion is best, the lowest of several; the published one where none tells.

    silhouette: the mean silhouette width. stability: the mean adjusted Rand index between the clusters of all and of
    samples of them.
    """
    thresholds = np.linspace(0.2, 3.0, CANDIDATES)
    if by == "silhouette":
        links = dendrogram(condensed, how)
        values = np.array([silhouette(condensed, cut(links, float(t))) for t in thresholds])
    else:
        values = stability(condensed, count, how, thresholds, seed)
    best = PUBLISHED_THRESHOLD if np.isnan(values).all() else float(thresholds[np.nanargmax(values)])
    return ThresholdChoice(by, thresholds, values, best)
