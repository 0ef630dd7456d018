"""Risk of each cluster over its measured and simulated members."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from resim.core.geometry import Floats
from resim.core.spec import EXACT, NumberOrNan
from resim.space.calibration import ReliabilityReport
from resim.space.draws import scenario_draws
from resim.space.members import TestDrive
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
    """Risk of the scenarios of one drive in a cluster (`resim.space.draws`).

    Attributes:
        counting: Scenarios of which a measured or simulated member counts.
        risk: Their mean: of each the mean of its simulated members that count, where what is not known is an accident,
            and 1 where the drive collided in it; NaN of none.
        surely: Their least mean, whatever of their other members counted, if nothing unknown were an accident.
        possibly: Their largest mean likewise, if all of it were.
        others: Scenarios of which no member counts, or nobody simulated one.
        most: Their mean, if all that is not known were an accident; 0 of none.
        least: The same, if nothing of it were.
    """

    counting: int
    risk: NumberOrNan
    surely: float
    possibly: float
    others: int
    most: float
    least: float


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
        missing: Scenarios of which there is no member at all, and that are not held out: nobody tried whether the
            function collides in them, so that they may be accidents.
        risk: Expected accidents a scenario: mean over those of which a measured or simulated member counts; NaN of
            none. The interval is that of as many scenarios as there are drives, fewer where some have most of them.
        draws: Risk in each drive, the largest first; what does not count may make it worse, never better.
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
    def drives(self) -> int:
        """In how many drives a member counts."""
        return sum(one.counting > 0 for one in self.draws)

    def means(self, *, largest: bool) -> tuple[Floats, Floats]:
        """Give means (K,) of what counts with none, some and all of the others, and of how many drives they are.

        largest: whether the others with the largest risk come first, at most; else those with the least, at least. The
        number of drives is Kish's: as many as would have the same weight (Survey Sampling, 1965).
        """
        count, others = (
            np.array([getattr(one, name) for one in self.draws], float) for name in ("counting", "others")
        )
        known = np.array([one.possibly if largest else one.surely for one in self.draws])
        beside = np.array([one.most if largest else one.least for one in self.draws])
        order = np.argsort(-beside if largest else beside, kind="stable")
        order = order[others[order] > 0.0]

        def growing(first: Floats, more: Floats) -> Floats:
            return np.asarray(first.sum() + np.concatenate([[0.0], np.cumsum(more[order])]))

        weight, squares = growing(count, others), growing(count**2, (count + others) ** 2 - count**2)
        return np.asarray(growing(count * known, others * beside) / weight), np.asarray(weight**2 / squares)


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
    own = rows[((rows["build"] == build) | of_unknown) & (build != "")]
    driven, simulated = dict(tuple(own.groupby("cluster"))), dict(tuple(members.groupby("cluster")))
    return tuple(
        _cluster_risk(
            str(name), driven.get(name, own.iloc[:0]), simulated.get(name, members.iloc[:0]), part, held
        )
        for name, part in rows.groupby("cluster", sort=False)
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
    name: str, driven: pd.DataFrame, members: pd.DataFrame, scenarios: pd.DataFrame, held: Set[str]
) -> ClusterRisk:
    """The risk of a cluster of such scenarios, of which some are held out."""
    outside = members["counts"] & ~members["draw"].isin(scenarios["draw"])
    members = members.assign(
        counts=members["counts"] & ~outside,
        why=members["why"].where(~outside, "its recording is no scenario of the space"),
    )
    counts = members["counts"].to_numpy(bool)
    sure = driven[~driven["doubtful"].to_numpy(bool)]
    hit = sure["collided"].fillna(True).to_numpy(bool)
    of_known = members["risk"].notna() & members["collided"].notna()
    reasons = members["why"][~counts].astype(str).value_counts()
    missing = _missing(driven, members, scenarios, held)
    found = _draws(driven, members, missing)
    mean, drives = _counting(found)
    return ClusterRisk(
        name, len(sure), int(hit.sum()), int(counts.sum()), int((~counts).sum()),
        int((~of_known)[counts].sum()) + int(sure["collided"].isna().sum()),
        int(members[counts]["collided"].fillna(False).sum()), len(missing), share(mean * drives, drives), found,
        _worst(members), {str(why): int(count) for why, count in sorted(reasons.items())},
    )  # fmt: skip


def _counting(draws: Sequence[DrawRisk]) -> tuple[float, float]:
    """The mean over scenarios of which a member counts, and of how many drives of the same weight they are."""
    known = [one for one in draws if one.counting]
    count = sum(one.counting for one in known)
    if not count:
        return 0.0, 0.0
    mean = sum(one.counting * one.risk for one in known) / count
    return mean, count**2 / sum(one.counting**2 for one in known)


def _missing(
    driven: pd.DataFrame, members: pd.DataFrame, scenarios: pd.DataFrame, held: Set[str]
) -> pd.DataFrame:
    """The scenarios without a member, that are not held out. A run of a whole drive is one of all of its."""
    whole = members["draw"][~members["origin"].isin(scenarios["scenario"])]
    told = [*members["origin"], *driven["scenario"], *held]
    return scenarios[~scenarios["scenario"].isin(told) & ~scenarios["draw"].isin(whole)]


def _draws(driven: pd.DataFrame, members: pd.DataFrame, missing: pd.DataFrame) -> tuple[DrawRisk, ...]:
    """The risk in each drive of a cluster. missing: scenarios without a member, which may be accidents."""
    unknown = (members["risk"].isna() | members["collided"].isna()).to_numpy(bool)
    values, ended, none = member_risks(members), driven["collided"], np.zeros(len(missing))
    table = pd.DataFrame(
        {
            "draw": np.concatenate([one["draw"].to_numpy(str) for one in (members, driven, missing)]),
            "scenario": np.concatenate(
                [members["origin"].to_numpy(str), *(one["scenario"].to_numpy(str) for one in (driven, missing))]
            ),
            "counts": np.concatenate(
                [members["counts"].to_numpy(bool), ~driven["doubtful"].to_numpy(bool), none > 0.0]
            ),
            "road": np.repeat([False, True, False], [len(members), len(driven), len(missing)]),
            "most": np.concatenate([values, ended.fillna(True).to_numpy(float), none + 1.0]),
            "least": np.concatenate(
                [np.where(unknown, 0.0, values), ended.fillna(False).to_numpy(float), none]
            ),
        }
    )  # fmt: skip
    found = [_draw(part) for _, part in _by_scenario(table).groupby("draw", sort=True)]
    return tuple(sorted(found, key=lambda one: (not one.counting, -np.nan_to_num(one.risk), -one.most)))


def _by_scenario(table: pd.DataFrame) -> pd.DataFrame:
    """A row per scenario of each drive: draw, counts (whether a member does), risk, surely, possibly.

    What counts is told by the mean of its simulated members that count, but not below what happened on the road; its
    others may make it more or less. What does not by the largest, and the least, of its members.
    """
    own = ["draw", "scenario"]
    counts = table["counts"]
    means = table[counts & ~table["road"]].groupby(own, sort=False)[["most", "least"]].mean()
    road = table[counts & table["road"]].groupby(own, sort=False)[["most", "least"]].max()
    known = pd.concat([means, road]).groupby(level=own, sort=False).max()
    beside = table[~counts].groupby(own, sort=False)
    others = pd.DataFrame({"possibly": beside["most"].max(), "surely": beside["least"].min()})
    found = known.rename(columns={"most": "risk", "least": "surely"}).assign(
        possibly=known["most"], counts=True
    )
    alone = others[~others.index.isin(found.index)].assign(risk=np.nan, counts=False)
    both = found.index[found.index.isin(others.index) & found.index.isin(means.index)]
    parts = dict(tuple(table[~table["road"]].groupby(own, sort=False))) if len(both) else {}
    for key in both:
        some, told = parts[key], parts[key]["counts"]
        high = _means(some["most"][told].to_numpy(), -np.sort(-some["most"][~told].to_numpy())).max()
        low = _means(some["least"][told].to_numpy(), np.sort(some["least"][~told].to_numpy())).min()
        below = float(road["least"].get(key, 0.0))
        found.loc[key, ["surely", "possibly"]] = max(low, below), max(high, found.loc[key, "possibly"])
    driven = found.index[found.index.isin(others.index) & ~found.index.isin(means.index)]
    found.loc[driven, "possibly"] = np.maximum(found.loc[driven, "possibly"], others.loc[driven, "possibly"])
    return pd.concat([one for one in (found, alone) if len(one)] or [found]).reset_index()


def _means(known: Floats, others: Floats) -> Floats:
    """Means of what is known and none, one, ... of others."""
    sums = known.sum() + np.concatenate([[0.0], np.cumsum(others)])
    return np.asarray(sums / (len(known) + np.arange(len(sums), dtype=float)))


def _draw(scenarios: pd.DataFrame) -> DrawRisk:
    """The risk in one drive."""
    counts = scenarios["counts"].to_numpy(bool)
    risk, surely, possibly = (scenarios[name].to_numpy(float) for name in ("risk", "surely", "possibly"))
    count, others = int(counts.sum()), int((~counts).sum())

    def mean(values: Floats, nothing: float) -> float:
        return float(values.mean()) if len(values) else nothing

    return DrawRisk(
        count, mean(risk[counts], np.nan), mean(surely[counts], 0.0), mean(possibly[counts], 0.0), others,
        mean(possibly[~counts], 0.0), mean(surely[~counts], 0.0),
    )  # fmt: skip


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
    lost = int(
        (members["cluster"] == "").to_numpy(bool)[members["collided"].fillna(True).to_numpy(bool)].sum()
    )
    if lost:
        out.append(
            f"{lost} simulated members of no cluster collide, or may: how often such scenarios come is not known"
        )
    unknown = int((members["risk"].isna() | members["collided"].isna())[counts].sum())
    if unknown:
        out.append(f"{unknown} members that count have no known risk or end: they count as accidents")
    return out
