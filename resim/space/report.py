"""What space.json says, as dataclasses: their fields are those of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from resim.core.spec import EXACT, NumberOrNan
from resim.space.settings import SpaceSettings
from resim.space.statistics.rates import IntervalEstimate
from resim.space.statistics.unseen import HeldOutCheck, KindsBound

MARK = "space.json"


@dataclass(frozen=True)
class SourceEntry:
    """A mined folder in the space.

    Attributes:
        name: Of the folder, with a number where it is a duplicate.
        folder: Where it was read; in space.json seen from the space's folder.
        hash: Of its tables.
        mined: SHA-256 of its mined.json, by which the lake knows it.
        batch: 0 for those that the space was built from, then 1, 2, ... with each `resim space grow`.
        egos: `every` vehicle once, or each recording's `own` EGO.
        trigger: What its scenarios were cut out for.
        rules: Hash of the thresholds that it was mined with, "" for those that ship.
        hours: h that EGOs drove on lanes, without those in which they stand; NaN where nobody says.
        kilometres: km likewise.
        scenarios: How many are in the space.
        occasions: How many there are if those that see the same maneuvers are one.
        left_out: Scenarios without slots.
        build_share: Share of its scenarios whose EGO a build drove.
        recordings: Hash of GT, EGO and map of each of its recordings, by name: copies under other names are one.
        traffic: Hash of who was where in each of its recordings, by name: copies of other bytes are one.
        contents: Hash of all that each of its recordings is, by name, by which the lake knows it.
        failed: Recordings that could not be mined: what happened in them is not known.
        accidents: By hash of the build, collisions and early ends of its test drives that are in no scenario.
        driven_by: By hash of the build, h that its test drives lasted; "" for all others.
        lengths: h and km of each of its recordings, by name.
        drives: Which drive each of its recordings is, by name: source and name of the first one that it is again.
    """

    name: str
    folder: str
    hash: str
    mined: str
    batch: int
    egos: str
    trigger: tuple[str, ...]
    rules: str
    hours: NumberOrNan
    kilometres: NumberOrNan
    scenarios: int
    occasions: int
    left_out: int
    build_share: NumberOrNan
    recordings: Mapping[str, str]
    traffic: Mapping[str, str]
    contents: Mapping[str, str]
    failed: tuple[str, ...]
    accidents: Mapping[str, int]
    driven_by: Mapping[str, NumberOrNan]
    lengths: Mapping[str, tuple[NumberOrNan, NumberOrNan]]
    drives: Mapping[str, str]


@dataclass(frozen=True)
class ClusterEntry:
    """A cluster: a kind of scenario.

    Attributes:
        cluster: Its name: number of the bucket, then its own; with n if it was found after the space was built.
        medoid: The scenario nearest to all members: its test case.
        members: How many scenarios.
        occasions: How many if those that see the same maneuvers are one.
        radius: Largest distance of a member to the medoid.
        per_hour: Rate [1/h] for an EGO; without an upper end where there are too few drives.
        per_kilometre: Rate [1/km] for an EGO.
    """

    cluster: str
    medoid: str
    members: int
    occasions: int
    radius: float
    per_hour: IntervalEstimate
    per_kilometre: IntervalEstimate


@dataclass(frozen=True)
class ConvergenceEntry:
    """Whether discovery and expansion have stopped.

    Attributes:
        converged: Whether the upper ends of both shares are at most the limit, and nothing was left out.
        limit: Of both shares.
        unseen: Probability that the next scenario is of a kind not seen.
        expanding: Share of the later half of scenarios that are of a new kind, or enlarge theirs by over TOLERANCE.
        missing: Scenarios that are missing, about, until it can be told, NaN where nobody can say.
        missing_hours: h in which so many come, at the rate so far.
    """

    converged: bool
    limit: float
    unseen: IntervalEstimate
    expanding: IntervalEstimate
    missing: NumberOrNan
    missing_hours: NumberOrNan


@dataclass(frozen=True)
class DiscoveryCurve:
    """What was found with what was driven, at points that are as many scenarios apart.

    Attributes:
        scenarios: How many were there.
        hours: Driven [h], NaN where nobody says.
        kilometres: Driven [km].
        clusters: Kinds found until then.
        radius: Mean radius of the kinds with two members or more, NaN where there are none.
        unseen: Estimated probability that the next one, of another drive, is new.
    """

    scenarios: tuple[int, ...]
    hours: tuple[NumberOrNan, ...]
    kilometres: tuple[NumberOrNan, ...]
    clusters: tuple[int, ...]
    radius: tuple[NumberOrNan, ...]
    unseen: tuple[NumberOrNan, ...]


@dataclass(frozen=True)
class CoverageEntry:
    """How much was seen, of a bucket or of all.

    Attributes:
        kinds: How many kinds there are at least.
        discovery_per_hour: New kinds an hour in the later half of what was driven.
        discovery_per_kilometre: New kinds a kilometre likewise.
        convergence: Whether nothing new comes any more.
        held_out: The unseen share that one half predicts, against the other; None for fewer than four scenarios.
        curve: What was found, over what was driven.
    """

    kinds: KindsBound
    discovery_per_hour: IntervalEstimate
    discovery_per_kilometre: IntervalEstimate
    convergence: ConvergenceEntry
    held_out: HeldOutCheck | None
    curve: DiscoveryCurve


@dataclass(frozen=True)
class BucketEntry:
    """Scenarios that are compared with each other.

    Attributes:
        bucket: Its name: map, road, direction (+ along s), lanes, vehicles, as far as the settings tell them apart.
        number: Its number in names of clusters.
        scenarios: How many.
        threshold: Up to and with which clusters were merged.
        chosen: By what it was chosen: `given`, `silhouette` or `stability`.
        method: `all pairs`, or `samples` where there are too many.
        links: Dendrogram (N - 1, 4) of those that it was built from, as scipy has it; empty for one scenario.
        clusters: The kinds.
        coverage: How much of it was seen.
    """

    bucket: str
    number: int
    scenarios: int
    threshold: float
    chosen: str
    method: str
    links: tuple[tuple[float, ...], ...]
    clusters: tuple[ClusterEntry, ...]
    coverage: CoverageEntry


@dataclass(frozen=True)
class SpaceReport:
    """The scenario space, as space.json says it.

    Attributes:
        versions: Of resim and what it depends on.
        files: Hashes of the tables beside it.
        settings: How it was built.
        sources: What it was made of.
        scenarios: How many there are.
        hours: h driven; NaN where a source does not say.
        kilometres: km likewise.
        buckets: The buckets, in order of their numbers.
        coverage: How much was seen, all buckets together.
        notes: What is to be known to believe it.
    """

    __pydantic_config__ = EXACT

    versions: Mapping[str, str]
    files: Mapping[str, str]
    settings: SpaceSettings
    sources: tuple[SourceEntry, ...]
    scenarios: int
    hours: NumberOrNan
    kilometres: NumberOrNan
    buckets: tuple[BucketEntry, ...]
    coverage: CoverageEntry
    notes: tuple[str, ...]

    def clusters(self) -> dict[str, ClusterEntry]:
        """Give all clusters by name."""
        return {one.cluster: one for bucket in self.buckets for one in bucket.clusters}
