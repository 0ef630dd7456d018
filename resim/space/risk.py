"""Risk of each cluster over its measured and simulated members."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from resim.core.geometry import Floats
from resim.core.spec import EXACT, NumberOrNan
from resim.space.calibration import ReliabilityReport, reliability
from resim.space.draws import scenario_draws
from resim.space.members import INSIDE, SimulatedRun, TestDrive
from resim.space.model import Space
from resim.space.sources import UNKNOWN_BUILD
from resim.space.statistics.rates import IntervalEstimate, share

WORST = 5
"""Members of a cluster that are named as its worst."""
MARK = "cover.json"


@dataclass(frozen=True)
class WorstMember:
    """A member with its risk, and the command that repeats it."""

    member: str
    risk: NumberOrNan
    collided: bool | None
    repeat: str


@dataclass(frozen=True)
class DrawRisk:
    """Risk of one draw of what traffic does, of which a cluster may have several members (`resim.space.draws`).

    Attributes:
        risk: Mean of its simulated members that count, where what is not known is an accident; 1 where it collided on
            the road; NaN where nothing of it counts.
        least: Least risk, whatever of the members that do not count did, if nothing unknown were an accident.
        most: Largest risk likewise, if all of it were.
    """

    risk: NumberOrNan
    least: float
    most: float


@dataclass(frozen=True)
class ClusterRisk:
    """The risk of a cluster.

    Drives of a build without a hash, and those whose kind is not known, may make it worse, never better.

    Attributes:
        cluster: Its name.
        measured: Members that this build drove on the road, whose kind is known.
        measured_collided: How many of them collided, or may have.
        counted: Simulated members that count.
        not_counted: Simulated members that do not.
        unknown: Of both, how many have no known risk or end: they count as accidents.
        collided: Of those that count, how many collided.
        missing: Draws of its scenarios of which there is no member at all, and that are not held out: nobody tried
            whether the function collides in them, so that they may be accidents.
        risk: Expected accidents a scenario: mean over draws of which a measured or simulated member counts; NaN of
            none. The interval is that of as many scenarios as there are draws.
        draws: Risk of each draw of its scenarios, the largest first, then those of which nothing counts, and of other
            recordings: these may make it worse, never better.
        worst: The worst members of all.
        why: Reasons for which members do not count, with how many.
    """

    cluster: str
    measured: int
    measured_collided: int
    counted: int
    not_counted: int
    unknown: int
    collided: int
    missing: int
    risk: IntervalEstimate
    draws: tuple[DrawRisk, ...]
    worst: tuple[WorstMember, ...]
    why: Mapping[str, int]

    @property
    def scenarios(self) -> int:
        """Of how many draws a member counts."""
        return sum(not np.isnan(one.risk) for one in self.draws)


@dataclass(frozen=True)
class GivenFolder:
    """A folder of simulated drives that was given.

    Attributes:
        runs: How many there are.
        hash: SHA-256 of verification.json, or of a sweep's manifest.json, which name all that they hold by its hash.
    """

    runs: int
    hash: str


@dataclass(frozen=True)
class CoverReport:
    """What simulation makes of a space, as cover.json says it.

    Attributes:
        versions: Of resim and what it depends on.
        files: Hashes of members.parquet, and of traffic.toml where there is one.
        space: Hash of space.json.
        build: Hash of the build.
        label: Its name and version.
        perception: Hash of the perception model, "" without one.
        within: Slot distance to a verified test drive up to which members count.
        given: Each folder that was given, by its path: of simulated drives in any other one nothing is known.
        held_out: Each folder that was held out.
        drives: How many test drives are verified.
        accidents: How many of this build's test drives collide or break off and are not in the space.
        clusters: Risk of each cluster.
        calibration: Of predicted risk; None without held-out drives.
        notes: What is to be known to believe it.
    """

    __pydantic_config__ = EXACT

    versions: Mapping[str, str]
    files: Mapping[str, str]
    space: str
    build: str
    label: str
    perception: str
    within: float
    given: Mapping[str, GivenFolder]
    held_out: Mapping[str, GivenFolder]
    drives: int
    accidents: int
    clusters: tuple[ClusterRisk, ...]
    calibration: ReliabilityReport | None
    notes: tuple[str, ...]


def cluster_risks(
    space: Space, members: pd.DataFrame, build: str, held: Set[str] = frozenset()
) -> tuple[ClusterRisk, ...]:
    """Give the risk of every cluster.

    members: as of members.parquet; build: its hash; held: scenarios of the space that are held out, so that nothing of
    them is missing.
    """
    of_unknown = (space.rows["build"] == UNKNOWN_BUILD).to_numpy(bool)
    rows = space.rows.assign(doubtful=space.unsure | of_unknown, draw=scenario_draws(space.rows))
    excused = set(rows["draw"][rows["scenario"].isin(held)])
    own = rows[((rows["build"] == build) | of_unknown) & (build != "")]
    driven, simulated = dict(tuple(own.groupby("cluster"))), dict(tuple(members.groupby("cluster")))
    return tuple(
        _cluster_risk(
            str(name),
            driven.get(name, own.iloc[:0]),
            simulated.get(name, members.iloc[:0]),
            set(draws),
            excused,
        )
        for name, draws in rows.groupby("cluster", sort=False)["draw"]
    )


def predicted_risks(
    space: Space, members: pd.DataFrame, build: str, held: Set[str]
) -> tuple[ClusterRisk, ...]:
    """Give the risk of every cluster without drives that are held out: they say nothing of how they end themselves.

    held: scenarios of the space that are held out.
    """
    rows = space.rows
    driven_by = rows["build"].where(~rows["scenario"].isin(held), "")
    return cluster_risks(replace(space, rows=rows.assign(build=driven_by)), members, build, held)


def member_risks(members: pd.DataFrame) -> Floats:
    """Give what each simulated member (K,) counts as: its risk, 1 where it collided or either is not known."""
    risk = members["risk"].to_numpy(float)
    collided = members["collided"].to_numpy(float, na_value=np.nan)
    return np.where(np.isnan(risk) | (collided != 0.0), 1.0, np.clip(np.nan_to_num(risk), 0.0, 1.0))


def _cluster_risk(
    name: str, driven: pd.DataFrame, members: pd.DataFrame, draws: Set[str], excused: Set[str]
) -> ClusterRisk:
    """The risk of a cluster whose scenarios are of such draws, of which those that are held out are excused."""
    outside = members["counts"] & ~members["draw"].isin(draws)
    members = members.assign(
        counts=members["counts"] & ~outside,
        why=members["why"].where(~outside, "its recording is no scenario of the space"),
    )
    counts = members["counts"].to_numpy(bool)
    sure = driven[~driven["doubtful"].to_numpy(bool)]
    hit = sure["collided"].fillna(True).to_numpy(bool)
    of_known = members["risk"].notna() & members["collided"].notna()
    reasons = members["why"][~counts].astype(str).value_counts()
    missing = len(draws - excused - set(members["draw"]) - set(driven["draw"]))
    found = _draws(driven, members) + (DrawRisk(np.nan, 0.0, 1.0),) * missing
    known = [one.risk for one in found if not np.isnan(one.risk)]
    return ClusterRisk(
        name, len(sure), int(hit.sum()), int(counts.sum()), int((~counts).sum()),
        int((~of_known)[counts].sum()) + int(sure["collided"].isna().sum()),
        int(members[counts]["collided"].fillna(False).sum()), missing, share(float(sum(known)), float(len(known))),
        found, _worst(members), {str(why): int(count) for why, count in sorted(reasons.items())},
    )  # fmt: skip


def _draws(driven: pd.DataFrame, members: pd.DataFrame) -> tuple[DrawRisk, ...]:
    """The risk of each draw of a cluster of which there is a member."""
    unknown = (members["risk"].isna() | members["collided"].isna()).to_numpy(bool)
    values, ended = member_risks(members), driven["collided"]
    n = len(members)
    names = np.concatenate([members["draw"].to_numpy(str), driven["draw"].to_numpy(str)])
    counts = np.concatenate([members["counts"].to_numpy(bool), ~driven["doubtful"].to_numpy(bool)])
    most = np.concatenate([values, ended.fillna(True).to_numpy(float)])
    least = np.concatenate([np.where(unknown, 0.0, values), ended.fillna(False).to_numpy(float)])
    of = np.unique(names, return_inverse=True)[1]
    order = np.argsort(of, kind="stable")
    found = [
        _draw(counts[rows], rows >= n, most[rows], least[rows])
        for rows in np.split(order, np.flatnonzero(np.diff(of[order])) + 1) if len(rows)
    ]  # fmt: skip
    return tuple(sorted(found, key=lambda one: (np.isnan(one.risk), -np.nan_to_num(one.risk), -one.most)))


def _draw(counts: np.ndarray, road: np.ndarray, most: Floats, least: Floats) -> DrawRisk:
    """The risk of members (K,) of one draw: of simulated ones the mean, but 1 where it collided on the road."""
    if not counts.any():
        return DrawRisk(np.nan, float(least.min()), float(most.max()))
    known, beside, driven = counts & ~road, ~counts, counts & road
    high, low = (float(part[driven].max(initial=0.0)) for part in (most, least))
    if not known.any():
        return DrawRisk(high, low, float(most[beside].max(initial=high)))
    told, largest = float(most[known].mean()), _means(most[known], -np.sort(-most[beside])).max()
    smallest = _means(least[known], np.sort(least[beside])).min()
    return DrawRisk(max(told, high), max(float(smallest), low), max(float(largest), high))


def _means(known: Floats, others: Floats) -> Floats:
    """Means of what is known and none, one, ... of others."""
    sums = known.sum() + np.concatenate([[0.0], np.cumsum(others)])
    return np.asarray(sums / (len(known) + np.arange(len(sums), dtype=float)))


def _worst(members: pd.DataFrame) -> tuple[WorstMember, ...]:
    order = np.lexsort((members["member"].astype(str), -member_risks(members)))[:WORST]
    told = members.iloc[order]
    risk, collided = told["risk"].to_numpy(float), told["collided"].to_numpy(float, na_value=np.nan)
    names = zip(
        told["member"].astype(str), risk.tolist(), collided.tolist(), told["repeat"].astype(str), strict=True
    )
    return tuple(
        WorstMember(name, value, None if np.isnan(hit) else bool(hit), repeat)
        for name, value, hit, repeat in names
    )


def calibrated(
    risks: Sequence[ClusterRisk], held: Sequence[SimulatedRun], cluster: Mapping[str, str],
    draw: Mapping[str, str] | None = None,
) -> ReliabilityReport:  # fmt: skip
    """Compare the risk of clusters, by their members that count, with the collisions of drives that were held out.

    risks: without what is held out (`predicted_risks`). cluster: of recordings, by key. A held-out drive of no cluster,
    of one without a risk, or that is not what was verified has no prediction. draw: what several recordings are one
    draw of, by key (`DrivenTraces`).
    """
    by_name = {one.cluster: one.risk.value for one in risks}
    of = ["" if run.changed or run.trust != INSIDE else cluster.get(run.recording, "") for run in held]
    predicted = np.array([by_name.get(name, np.nan) for name in of], dtype=float)
    collided = np.array([np.nan if run.collided is None else float(run.collided) for run in held])
    return reliability(predicted, collided, [(draw or {}).get(run.recording, run.recording) for run in held])


def cover_notes(members: pd.DataFrame, drives: Sequence[TestDrive]) -> list[str]:
    """Give what is to be known to believe what covers a space."""
    out = []
    if not any(one.own and one.verdict == "verified" for one in drives):
        out.append("no test drive that this build drove is verified: no simulated member counts")
    counts = members["counts"].to_numpy(bool)
    if len(counts) and not counts.all():
        why = members["why"][~counts].astype(str).value_counts()
        out.append(
            f"{int((~counts).sum())} of {len(counts)} simulated members do not count, most since: {why.index[0]}"
        )
    unknown = int((members["risk"].isna() | members["collided"].isna())[counts].sum())
    if unknown:
        out.append(f"{unknown} members that count have no known risk or end: they count as accidents")
    return out
