"""New scenarios in an existing space, and spaces too large for all distances: who belongs to which cluster.

A scenario belongs to the cluster with the nearest medoid whose members, as they were when the space was built, it could
be linked to at the threshold: all of them within it for complete linkage, one for single, their mean for average and
weighted. Who belongs to none is clustered with all others that do not. Neither depends on the order in which scenarios
come: the first looks at what was built alone, the second is made anew of all of them in an order of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Floats
from resim.space.clustering import BucketClusters, Linkage, cluster, cut, dendrogram
from resim.space.distance import PairDistances
from resim.space.traces import Ints

CHUNK = 500
"""Scenarios that are placed at once: their distances to all members are in memory."""


@dataclass(frozen=True, eq=False)
class FrozenClusters:
    """Clusters as they were built: rows of their members, and of their medoids (C,)."""

    members: Sequence[Ints]
    medoid: Ints


def place_rows(
    pairs: PairDistances, rows: Ints, frozen: FrozenClusters, how: Linkage, threshold: float
) -> tuple[Ints, Floats]:
    """Give the cluster of each row (R,), -1 for none, and its distance to the nearest medoid (inf without any)."""
    label, nearest = np.full(len(rows), -1, dtype=np.intp), np.full(len(rows), np.inf)
    if not len(frozen.medoid):
        return label, nearest
    for low in range(0, len(rows), CHUNK):
        part = slice(low, low + CHUNK)
        label[part], nearest[part] = _placed(pairs, rows[part], frozen, how, threshold)
    return label, nearest


def _placed(
    pairs: PairDistances, rows: Ints, frozen: FrozenClusters, how: Linkage, threshold: float
) -> tuple[Ints, Floats]:
    to_medoid = pairs.between(rows, frozen.medoid)
    order = np.argsort(to_medoid, axis=1, kind="stable")
    label = np.full(len(rows), -1, dtype=np.intp)
    for rank in range(len(frozen.medoid)):
        open_rows = np.flatnonzero(label < 0)
        near = open_rows[_may(to_medoid[open_rows, order[open_rows, rank]], how, threshold)]
        if not len(near):
            if how == "complete":  # no medoid further away can be of a cluster that fits
                break
            continue
        for c in np.unique(order[near, rank]).tolist():
            tried = near[order[near, rank] == c]
            fits = _links(pairs.between(rows[tried], frozen.members[c]), how) <= threshold
            label[tried[fits]] = c
    return label, to_medoid.min(axis=1)


def _may(distance: Floats, how: Linkage, threshold: float) -> np.ndarray:
    """Whether a cluster with its medoid this far away can fit: for complete linkage the medoid is one of all
    members.
    """
    return distance <= threshold if how == "complete" else np.ones(len(distance), dtype=bool)


def _links(distance: Floats, how: Linkage) -> Floats:
    """The distance (R,) at which scenarios would be linked to the members (R, M) of a cluster."""
    if how == "single":
        return np.asarray(distance.min(axis=1))
    return np.asarray(distance.max(axis=1) if how == "complete" else distance.mean(axis=1))


def cluster_all(
    pairs: PairDistances, how: Linkage, threshold: float, sample: int, seed: int
) -> BucketClusters:
    """Give clusters without the distances of all pairs: of a sample, in which all others are placed; of a sample of
    those that belong to none, and so on, until all are placed.

    pairs: of the scenarios of one bucket. seed: of the samples. Links are those of the first sample.
    """
    rng = np.random.default_rng(seed)
    label = np.full(pairs.count, -1, dtype=np.intp)
    links: Floats = np.zeros((0, 4))
    left, used = np.arange(pairs.count), 0
    while len(left):
        taken = np.sort(rng.permutation(left)[:sample])
        found = cluster(_condensed(pairs, taken), how, threshold)
        if not used:
            links = found.links
        members = [taken[found.label == c] for c in range(found.count)]
        frozen = FrozenClusters(members, taken[found.medoid])
        label[taken] = used + found.label
        left = np.setdiff1d(left, taken, assume_unique=True)
        own, _ = place_rows(pairs, left, frozen, how, threshold)
        label[left[own >= 0]] = used + own[own >= 0]
        left, used = left[own < 0], used + found.count
    return _with_medoids(pairs, label, links, threshold)


def _condensed(pairs: PairDistances, rows: Ints) -> Floats:
    return np.asarray(pairs.between(rows, rows)[np.triu_indices(len(rows), 1)])


def _with_medoids(pairs: PairDistances, label: Ints, links: Floats, threshold: float) -> BucketClusters:
    """Clusters counted in the order of their first members, with medoids and radii, of at most CHUNK members each."""
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.intp)
    rank[np.argsort(first)] = np.arange(len(first))
    label = np.asarray(rank[inverse], dtype=np.intp)
    medoid, radius = np.empty(len(first), np.intp), np.zeros(len(first))
    for c in range(len(first)):
        members = np.flatnonzero(label == c)
        some = members[np.unique(np.linspace(0, len(members) - 1, CHUNK).astype(np.intp))]
        medoid[c] = some[int(np.argmin(pairs.between(some, some).sum(axis=1)))]
        radius[c] = pairs.between(members, medoid[c : c + 1]).max(initial=0.0)
    return BucketClusters(label, medoid, radius, links, threshold)


def leftovers(pairs: PairDistances, rows: Ints, how: Linkage, threshold: float) -> Ints:
    """Give the clusters (R,) of rows that belong to none that was built, counted from 0."""
    if len(rows) < 2:
        return np.zeros(len(rows), dtype=np.intp)
    return cut(dendrogram(_condensed(pairs, rows), how), threshold)
