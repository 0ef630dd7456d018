"""Clusters of scenarios of known kinds; links as the text has them."""

from __future__ import annotations

import numpy as np
import pytest
from space.families import FAMILIES, drawn

from resim.space.agreement import adjusted_rand
from resim.space.clustering import choose_threshold, cluster, cut, dendrogram, silhouette
from resim.space.distance import PairDistances
from resim.space.placing import FrozenClusters, cluster_all, place_rows
from resim.space.traces import SlotTraces, joined


def families(each: int, seed: int) -> tuple[SlotTraces, np.ndarray]:
    rng = np.random.default_rng(seed)
    traces, kind = [], []
    for number, name in enumerate(FAMILIES):
        for k in range(each):
            traces.append(drawn(name, f"{name} {k}", rng))
            kind.append(number)
    return joined(traces), np.array(kind)


def primitive(distance: np.ndarray, how: str, threshold: float) -> np.ndarray:
    """Algorithm B.2 with the formulas of Table B.1, up to and with the threshold."""
    d = {(a, b): distance[a, b] for a in range(len(distance)) for b in range(len(distance)) if a != b}
    parts = {n: {n} for n in range(len(distance))}
    new = len(distance)
    while len(parts) > 1:
        a, b = min(((x, y) for x in parts for y in parts if x < y), key=lambda pair: d[pair])
        if d[a, b] > threshold:
            break
        one, two = len(parts[a]), len(parts[b])
        for x in parts:
            if x in (a, b):
                continue
            link = {
                "single": min(d[a, x], d[b, x]), "complete": max(d[a, x], d[b, x]),
                "average": (one * d[a, x] + two * d[b, x]) / (one + two), "weighted": (d[a, x] + d[b, x]) / 2.0,
            }[how]  # fmt: skip
            d[x, new] = d[new, x] = link
        parts[new] = parts.pop(a) | parts.pop(b)
        new += 1
    label = np.empty(len(distance), dtype=int)
    for number, members in enumerate(parts.values()):
        label[list(members)] = number
    return label


@pytest.mark.parametrize("how", ["single", "complete", "average", "weighted"])
def test_links_are_those_of_the_appendix(how: str) -> None:
    rng = np.random.default_rng(5)
    x = rng.normal(size=(25, 2)) + rng.integers(0, 3, (25, 1)) * 3.0
    distance = np.linalg.norm(x[:, None] - x[None], axis=2)
    found = cut(dendrogram(distance[np.triu_indices(25, 1)], how), 1.5)  # type: ignore[arg-type]
    assert adjusted_rand(found, primitive(distance, how, 1.5)) == 1.0


def test_a_link_at_the_threshold_is_accepted() -> None:
    assert cut(dendrogram(np.array([0.7]), "complete"), 0.7).tolist() == [0, 0]
    assert cut(dendrogram(np.array([0.7]), "complete"), 0.69).tolist() == [0, 1]


def test_families_of_known_membership_are_found() -> None:
    traces, kind = families(20, 1)
    assert len(FAMILIES) >= 12
    found = cluster(PairDistances(traces).condensed())
    assert adjusted_rand(found.label, kind) >= 0.95


def test_following_near_and_far_is_one_kind_at_the_published_threshold() -> None:
    # a limit of the method: within one slot at most 95 m apart, a distance of 1, of which 0.7 is 66 m
    near, far = (np.full((30, 8), np.nan) for _ in range(2))
    near[:, 4], far[:, 4] = 30.0, 85.0
    offset = np.concatenate([near, far])
    traces = SlotTraces(
        np.array(["near", "far"]), np.array([0, 30, 60], np.intp), offset, np.where(np.isfinite(offset), 0.0, np.nan),
        np.zeros(60, np.intp), np.zeros(60),
    )  # fmt: skip
    assert cluster(PairDistances(traces).condensed()).count == 1


@pytest.mark.parametrize("by", ["silhouette", "stability"])
def test_a_chosen_threshold_finds_them_as_well(by: str) -> None:
    traces, kind = families(8, 2)
    condensed = PairDistances(traces).condensed()
    choice = choose_threshold(condensed, len(kind), "complete", by)  # type: ignore[arg-type]
    assert adjusted_rand(cut(dendrogram(condensed, "complete"), choice.best), kind) >= 0.95


def test_medoids_and_radii() -> None:
    x = np.array([0.0, 0.1, 0.3, 5.0, 5.2])
    distance = np.abs(x[:, None] - x[None])[np.triu_indices(5, 1)]
    found = cluster(distance, "complete", 1.0)
    assert found.label.tolist() == [0, 0, 0, 1, 1]
    assert found.medoid.tolist() == [1, 3]
    assert found.radius == pytest.approx([0.2, 0.2])


def test_silhouette_of_a_worked_example() -> None:
    # a at 0 and 1, b at 10: widths 1 - 1/10, 1 - 1/9, and 0 for the lone one
    assert silhouette(np.array([1.0, 10.0, 9.0]), np.array([0, 0, 1])) == pytest.approx((0.9 + 8 / 9) / 3)
    assert np.isnan(silhouette(np.array([1.0, 10.0, 9.0]), np.array([0, 0, 0])))


def test_adjusted_rand_of_a_worked_example() -> None:
    # Hubert and Arabie: pairs together in both 2, in one 4 (sum of pairs), in the other 4, of 15
    one, two = np.array([0, 0, 0, 1, 1, 1]), np.array([0, 0, 1, 1, 2, 2])
    assert adjusted_rand(one, two) == pytest.approx((2 - 6 * 3 / 15) / (4.5 - 6 * 3 / 15))
    assert adjusted_rand(one, one[::-1]) == 1.0


def test_without_all_distances_the_clusters_are_nearly_the_same() -> None:
    traces, kind = families(30, 4)
    pairs = PairDistances(traces)
    exact = cluster(pairs.condensed())
    found = cluster_all(pairs, "complete", 0.7, sample=80, seed=0)
    assert adjusted_rand(found.label, kind) >= 0.95
    assert adjusted_rand(found.label, exact.label) >= 0.95
    again = cluster_all(pairs, "complete", 0.7, sample=80, seed=0)
    assert (again.label == found.label).all()
    members = [np.flatnonzero(found.label == c) for c in range(found.count)]
    assert all(found.medoid[c] in members[c] for c in range(found.count))


@pytest.mark.parametrize("how", ["single", "complete", "average", "weighted"])
def test_who_is_placed_could_be_linked(how: str) -> None:
    traces, _ = families(12, 6)
    pairs = PairDistances(traces)
    rows = np.random.default_rng(0).permutation(len(traces))
    core, later = np.sort(rows[:100]), np.sort(rows[100:])
    part = PairDistances(traces.take(core))
    found = cluster(part.condensed(), how, 0.7)  # type: ignore[arg-type]
    members = [core[found.label == c] for c in range(found.count)]
    label, _ = place_rows(pairs, later, FrozenClusters(members, core[found.medoid]), how, 0.7)  # type: ignore[arg-type]
    link = {"single": np.min, "complete": np.max}.get(how, np.mean)
    for row, c in zip(later.tolist(), label.tolist(), strict=True):
        to = [float(link(pairs.between(np.array([row]), one))) for one in members]
        if c < 0:
            assert min(to) > 0.7
        else:
            assert to[c] <= 0.7
