"""Simulated drives as members of clusters, and whether they count (Wagner 2021, 6.3.1: locally verified).

A simulated member counts where, for its build and perception, a test drive that this build drove is verified; where its
origin, or the medoid of its cluster, lies within a stated slot distance of that drive, where time that the drive did
not last for counts as far apart as can be; and where what was varied of it lies within what `resim verify --vary`
found there (`trust` of `resim vary`). All others stay in the table, with the reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from resim.core.geometry import Floats
from resim.space.build import NEW
from resim.space.distance import PairDistances
from resim.space.draws import recording_draws
from resim.space.model import Space
from resim.space.placing import FrozenClusters, place_rows
from resim.space.traces import Ints, SlotTraces, joined

MEMBER_COLUMNS = (
    "member",
    "origin",
    "draw",
    "cluster",
    "drive",
    "drive_distance",
    "risk",
    "collided",
    "counts",
    "why",
    "repeat",
)
"""Of members.parquet: member: of the simulated run; origin: recording; draw: what it is one draw with: all that
follows from its drive (`resim.space.draws`); cluster: "" for none; drive: nearest verified
test drive, drive_distance to it, NaN for none; risk: largest accident risk, NaN where it is not known; collided:
whether the EGO did, NULL where it is not known; counts: whether it is legitimised; why not; repeat: command."""
INSIDE = "inside"
OFF_LANE = "its EGO leaves the lanes: who was around it is not known"
"""Why a recording is of no cluster: without a lane slots are empty, as on a free road."""


@dataclass(frozen=True)
class SimulatedRun:
    """One simulated drive of the function.

    Attributes:
        name: Of the run.
        recording: Key of the recording that it simulates.
        build: Hash of the build.
        perception: Hash of the perception model, "" without one.
        risk: Largest accident risk, NaN where it is not known.
        collided: Whether the EGO collided, None where it is not known.
        changed: What of build and perception differs from what was verified, "" for nothing.
        trust: `inside`, `outside` or `unknown` of a variation, `inside` of what was not varied.
        varied: Whether it is a variation: trust is then by ranges that were found at its recording.
        repeat: Command that repeats it.
        same: What tells it from other runs, by whatever command they were done; "" where nobody says. Runs that share
            it are one: no evidence of each other.
    """

    name: str
    recording: str
    build: str
    perception: str
    risk: float
    collided: bool | None
    changed: str = ""
    trust: str = INSIDE
    varied: bool = False
    repeat: str = ""
    same: str = ""


@dataclass(frozen=True)
class TestDrive:
    """A drive that was verified, or was to be.

    Attributes:
        recording: Key of the recording.
        name: Its name.
        build: Hash of the build under test.
        perception: Hash of the perception model, "" without one.
        verdict: Of its verification.
        own: Whether the build under test drove it; people's drives are no test drives.
    """

    __test__ = False

    recording: str
    name: str
    build: str
    perception: str
    verdict: str
    own: bool


@dataclass(frozen=True, eq=False)
class DrivenTraces:
    """Recordings that are simulated: their slots by key (names of the traces), buckets, and scenarios of the space.

    Attributes:
        traces: Of recordings, named by their keys.
        bucket: Bucket of each, by key.
        scenario: Scenario of the space that each is, by key; "" for none.
        drive: Key of the drive that each was cut out of, by key, which copies of it share; its own, if it is not there.
    """

    traces: SlotTraces
    bucket: Mapping[str, str]
    scenario: Mapping[str, str]
    drive: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Legitimacy:
    """Why the members of a recording count or do not: nearest drive and distance, or the reason against."""

    drive: str
    distance: float
    why: str


def judged_members(
    space: Space,
    runs: Sequence[SimulatedRun],
    drives: Sequence[TestDrive],
    known: DrivenTraces,
    within: float,
) -> pd.DataFrame:
    """Give a row per simulated run with MEMBER_COLUMNS. within: slot distance to a verified drive, at most."""
    cluster = clusters_of(space, known)
    draws = recording_draws(space, known.scenario, known.drive)
    legitimate: dict[tuple[str, str, str], Legitimacy] = {}
    rows, first = [], dict[str, str]()
    for run in runs:
        key = run.recording, run.build, run.perception
        if key not in legitimate:
            legitimate[key] = _legitimacy(space, key, cluster.get(run.recording, ""), (drives, known, within))
        found = legitimate[key]
        why = (
            _twin(run, first)
            or found.why
            or _own_reason(run, drives)
            or ("" if cluster.get(run.recording) else "is in no cluster")
        )
        rows.append(
            (run.name, known.scenario.get(run.recording) or run.recording, draws.get(run.recording, run.recording),
             cluster.get(run.recording, ""), found.drive, found.distance, run.risk, run.collided, not why, why,
             run.repeat)
        )  # fmt: skip
    frame = pd.DataFrame(rows, columns=list(MEMBER_COLUMNS))
    texts = ("member", "origin", "draw", "cluster", "drive", "why", "repeat")
    types = dict.fromkeys(texts, "string") | {"drive_distance": "float64", "risk": "float64"}
    return frame.astype({**types, "collided": "boolean", "counts": "bool"})


def _twin(run: SimulatedRun, first: dict[str, str]) -> str:
    """The reason against a run that is there already. first: name of the first run of each kind, which is filled."""
    if not run.same:
        return ""
    if (before := first.get(run.same)) is None:
        first[run.same] = run.name
        return ""
    return f"it is the same run as {before}"


def _own_reason(run: SimulatedRun, drives: Sequence[TestDrive]) -> str:
    if run.varied and {one.verdict for one in drives if one.recording == run.recording} != {"verified"}:
        return "it is a variation within ranges of its recording, which is not verified itself"
    if run.changed:
        return f"it is not what was verified: {run.changed}"
    if run.trust != INSIDE:
        return f"its variation lies {run.trust} of what was verified" if run.trust == "outside" else (
            "it is unknown whether its variation lies within what was verified"
        )  # fmt: skip
    return ""


def _legitimacy(
    space: Space, key: tuple[str, str, str], cluster: str,
    given: tuple[Sequence[TestDrive], DrivenTraces, float],
) -> Legitimacy:  # fmt: skip
    drives, known, within = given
    recording, build, perception = key
    own = [one for one in drives if (one.build, one.perception) == (build, perception)]
    if not own:
        return Legitimacy("", math.nan, "no drive was verified with this build and perception")
    driven = [one for one in own if one.own]
    if not driven:
        return Legitimacy(
            "", math.nan, "no verified drive was driven by this build: people's drives are no test drives"
        )
    contradicted = {one.recording for one in driven if one.verdict != "verified"}
    good = [
        one
        for one in driven
        if one.recording not in contradicted and (known.traces.rows_of([one.recording]) >= 0)[0]
    ]
    if not good:
        return Legitimacy("", math.nan, "no test drive of this build is verified")
    from_rows = _origins(space, recording, cluster, known)
    if not len(from_rows):
        return Legitimacy("", math.nan, "its slots are not known")
    off = set(known.traces.names[known.traces.off_lane].tolist())
    if recording in off:
        return Legitimacy("", math.nan, OFF_LANE)
    good = [one for one in good if one.recording not in off]
    if not good:
        return Legitimacy("", math.nan, "in all verified test drives of this build the EGO leaves the lanes")
    (own_row,) = known.traces.rows_of([recording])
    lasts = np.maximum(from_rows.scenes, known.traces.scenes[own_row])
    driven_by = known.traces.take(known.traces.rows_of([one.recording for one in good]))
    nearest = _apart_at_most(space, from_rows, lasts, driven_by).min(axis=0)
    k = int(np.argmin(nearest))
    distance = float(nearest[k])
    why = (
        ""
        if distance <= within
        else f"the nearest verified test drive is {distance:.2f} away, at most {within:g} counts (time that it did not "
        "last for counts as far as can be)"
    )
    return Legitimacy(good[k].name, distance, why)


def _apart_at_most(space: Space, ones: SlotTraces, lasts: Ints, drives: SlotTraces) -> Floats:
    """How far scenarios (A,) and drives (B,) are apart at most: (A, B), whatever a drive would have met had it gone on.

    The published distance is of the common time alone, by which a drive or a medoid of a second would be near to all
    that begins as it does. lasts: scenes (A,) that both have to last for.
    """
    count, options = len(ones), space.settings.distance
    both = PairDistances(joined([ones, drives]), options)
    apart = both.between(np.arange(count), np.arange(count, count + len(drives)))
    common = np.minimum(drives.scenes[None, :], ones.scenes[:, None])
    shared = np.minimum(common / lasts[:, None], 1.0)
    return shared * apart + (1.0 - shared) * options.longest


def not_mined(space: Space, accidents: Iterable[str], known: DrivenTraces) -> int:
    """Count accidents of test drives, by key of the recording, of which the space holds neither drive nor scenario."""
    left = set(accidents).difference(*(one.recordings.values() for one in space.sources))
    return sum(not known.scenario.get(recording) for recording in left)


def _origins(space: Space, recording: str, cluster: str, known: DrivenTraces) -> SlotTraces:
    """The slots of a recording, and of the medoid of its cluster unless that one leaves the lanes."""
    own = known.traces.take(_there(known.traces.rows_of([recording])))
    if not cluster:
        return own
    is_medoid = (space.rows["cluster"] == cluster) & space.rows["medoid"] & ~space.traces.off_lane
    medoid = space.rows["scenario"][is_medoid]
    return joined([own, space.traces.take(_there(space.traces.rows_of(medoid.astype(str).tolist())))])


def _there(rows: Ints) -> Ints:
    return rows[rows >= 0]


def clusters_of(space: Space, known: DrivenTraces) -> dict[str, str]:
    """Give the cluster of each recording by key, "" for none: that of the scenario that it is, else of where it is
    placed. Nothing is placed whose EGO leaves the lanes."""
    by_scenario = dict(zip(space.rows["scenario"], space.rows["cluster"], strict=True))
    out = {key: str(by_scenario.get(name, "")) for key, name in known.scenario.items() if name}
    off = known.traces.off_lane
    left = [str(name) for name in known.traces.names[~off] if str(name) not in out]
    for bucket in sorted({known.bucket[key] for key in left}):
        mine = [key for key in left if known.bucket[key] == bucket]
        out |= dict(
            zip(mine, _placed(space, bucket, known.traces.take(known.traces.rows_of(mine))), strict=True)
        )
    return out


def _placed(space: Space, bucket: str, traces: SlotTraces) -> list[str]:
    """Clusters of recordings of a bucket, "" for none, as for who lasts less than all scenarios of a cluster: over its
    first second every cut-out is following, and harmless."""
    own = np.flatnonzero(space.rows["bucket"].to_numpy(str) == bucket)
    if not len(own):
        return [""] * len(traces)
    label = space.rows["cluster"].to_numpy(str)[own]
    names = np.array(sorted(set(label.tolist()), key=lambda name: (NEW in name, name)), dtype=object)
    members = [np.flatnonzero(label == name) for name in names]
    is_medoid = space.rows["medoid"].to_numpy(bool)[own]
    medoid = np.array([rows[is_medoid[rows]][0] for rows in members], dtype=np.intp)
    pairs = PairDistances(joined([space.traces.take(own), traces]), space.settings.distance)
    rows = np.arange(len(own), len(own) + len(traces))
    threshold = space.links[bucket].threshold
    found, _ = place_rows(pairs, rows, FrozenClusters(members, medoid), space.settings.linkage, threshold)
    scenes = space.traces.scenes[own]
    shortest = [int(scenes[rows].min()) for rows in members]
    placed = zip(found.tolist(), traces.scenes.tolist(), strict=True)
    return [str(names[k]) if k >= 0 and lasts >= shortest[k] else "" for k, lasts in placed]
