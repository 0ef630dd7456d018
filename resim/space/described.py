"""The report of a space: its buckets and clusters, how often each comes, and how much was seen."""

from __future__ import annotations

import numpy as np
import pandas as pd

from resim.core.provenance import versions
from resim.core.spelling import counted
from resim.space.coverage import SeenScenarios, coverage
from resim.space.draws import Driven, drive_lengths, drive_numbers, driven_in
from resim.space.model import SHORT, Space
from resim.space.report import BucketEntry, ClusterEntry, SpaceReport
from resim.space.statistics.rates import LEAST_ALIKE, LEAST_DRIVES, worth
from resim.space.traces import Ints

LONE = 0.5
"""Share of clusters with one member from which on it is said."""


def report(space: Space, files: dict[str, str]) -> SpaceReport:
    """Give what space.json says. files: hashes of the tables."""
    rows, driven = space.rows, driven_in(space)
    nothing_lost = not any(one.left_out or one.failed for one in space.sources)
    buckets = tuple(
        _bucket(space, bucket, own, driven, whole=nothing_lost) for bucket, own in space.by_bucket()
    )
    whole = coverage(seen(space, np.arange(len(rows)), driven), whole=nothing_lost)
    return SpaceReport(
        versions(), files, space.settings, space.sources, len(rows), *driven.whole, buckets, whole,
        tuple(_notes(space, buckets)),
    )  # fmt: skip


def seen(space: Space, own: Ints, driven: Driven) -> SeenScenarios:
    """Give scenarios of a space in the order in which they were driven.

    Each whose kind is not known (`Space.unsure`) is of one of its own.
    """
    rows = space.rows.iloc[own]
    order = np.lexsort((np.arange(len(rows)), rows["hours"].to_numpy(float)))
    rows = rows.iloc[order]
    names, kind = np.unique(rows["cluster"].to_numpy(str), return_inverse=True)
    kind = np.where(space.unsure[own][order], len(names) + np.arange(len(kind)), kind)
    return SeenScenarios(
        kind, rows["occasion"].to_numpy(np.intp), rows["to_medoid"].to_numpy(float),
        rows["hours"].to_numpy(float), rows["kilometres"].to_numpy(float), driven,
        drive_numbers(space.rows)[own][order],
    )  # fmt: skip


def _bucket(space: Space, bucket: str, own: Ints, driven: Driven, *, whole: bool) -> BucketEntry:
    rows, how = space.rows.iloc[own], space.links[bucket]
    names, drive = rows["cluster"].to_numpy(str), drive_numbers(space.rows)[own]
    clusters = sorted(set(names.tolist()), key=in_order)
    return BucketEntry(
        bucket, int(rows["number"].iloc[0]), len(own), how.threshold, how.chosen, how.method, how.links,
        tuple(_cluster(rows[names == name], drive[names == name], driven) for name in clusters),
        coverage(seen(space, own, driven), whole=whole),
    )  # fmt: skip


def in_order(name: str) -> tuple[int, bool, int]:
    """Give what sorts names of clusters: by bucket, those that the space was built with first, by number."""
    number, _, own = name.partition(".")
    return int(number), own.startswith("n"), int(own.lstrip("n"))


def _cluster(rows: pd.DataFrame, drive: Ints, driven: Driven) -> ClusterEntry:
    hours, kilometres = driven.rates(drive)
    return ClusterEntry(
        str(rows["cluster"].iloc[0]), str(rows["scenario"][rows["medoid"]].iloc[0]), len(rows),
        int(rows["occasion"].nunique()), float(rows["to_medoid"].max()), hours, kilometres,
    )  # fmt: skip


def _notes(space: Space, buckets: tuple[BucketEntry, ...]) -> list[str]:
    """What is to be known to believe a space."""
    out = []
    for one in space.sources:
        if one.left_out:
            out.append(
                f"{one.name}: {one.left_out} scenarios have no slots and are left out: nothing is converged"
            )
        if one.failed:
            told = f"{counted(len(one.failed), 'recording')} could not be mined ({one.failed[0]})"
            out.append(f"{one.name}: {told}: what happened in them is not known, and nothing is converged")
        if np.isnan(one.hours):
            out.append(f"{one.name}: nobody says how long was driven: there are no rates")
    clusters = [cluster for bucket in buckets for cluster in bucket.clusters]
    lone = sum(cluster.members == 1 for cluster in clusters)
    if lone > LONE * len(clusters):
        out.append(
            f"{lone} of {len(clusters)} clusters have one member: there is not enough data for this space"
        )
    short = int((space.unsure & ~space.traces.off_lane).sum())
    if short:
        out.append(
            f"{short} scenarios last for less than {SHORT:.0%} of the medoid of their cluster: how much was seen "
            "counts each as a kind of its own"
        )
    off = int((space.traces.lane < 0).sum())
    if off:
        out.append(
            f"in {off} of {len(space.traces.lane)} scenes the EGO is on no lane: all of its slots are empty, and "
            "how much was seen counts each such scenario as a kind of its own"
        )
    drives = space.rows["drive"].nunique()
    if drives < LEAST_DRIVES:
        out.append(
            f"all is of {counted(drives, 'drive')}: how often scenarios come at most is not known of fewer "
            f"than {LEAST_DRIVES}, as few drives may have most of what comes"
        )
    alike = worth(drive_lengths(space)[:, 0])
    if drives >= LEAST_DRIVES and alike < LEAST_ALIKE:
        out.append(
            f"few drives have most of the time, so that all are worth {alike:.3g} of like length: how often scenarios "
            f"come at most is not known of fewer than {LEAST_ALIKE:g}"
        )
    if len({one.egos for one in space.sources}) > 1:
        out.append("sources with every vehicle as EGO are mixed with test drives: rates are of both together")
    return out
