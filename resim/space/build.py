"""A space is built from mined folders, and grows by more of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.geometry import Floats
from resim.space.clustering import BucketClusters, choose_threshold, cluster
from resim.space.copies import first_copy
from resim.space.distance import PairDistances
from resim.space.drives import with_drives
from resim.space.model import COLUMNS, PLACED, BucketLinks, Space, bucket_names
from resim.space.placing import FrozenClusters, cluster_all, place_rows
from resim.space.report import SourceEntry
from resim.space.settings import DEFAULT_SETTINGS, SpaceSettings
from resim.space.sources import MinedSource
from resim.space.traces import Ints, SlotTraces, joined

NEW = "n"
"""Before the number of a cluster that was found after the space was built."""


@dataclass(eq=False)
class _Places:
    """Where scenarios of the space (N,) are put: number of the bucket, cluster, whether medoid, distance to it."""

    number: Ints
    cluster: np.ndarray
    medoid: np.ndarray
    to_medoid: Floats

    def fill(
        self, rows: Ints, names: Sequence[str], found: BucketClusters, pairs: PairDistances, own: Ints
    ) -> None:
        """Put rows (R,) into found clusters with these names. own: their rows in pairs."""
        self.cluster[rows] = np.array(names, dtype=object)[found.label]
        self.medoid[rows] = False
        self.medoid[rows[found.medoid]] = True
        for c in range(found.count):
            members = np.flatnonzero(found.label == c)
            self.to_medoid[rows[members]] = pairs.between(own[members], own[found.medoid[c : c + 1]])[:, 0]


BucketDone = Callable[[str, int, int], None]
"""Hears of each bucket that was clustered: its name, and of how many scenarios and clusters it is."""


def _quietly(bucket: str, scenarios: int, clusters: int) -> None:
    pass


def build_space(
    sources: Sequence[MinedSource],
    settings: SpaceSettings = DEFAULT_SETTINGS,
    workers: int = 1,
    done: BucketDone = _quietly,
) -> Space:
    """Build a space from mined folders; scenarios are clustered in each bucket.

    Raises InputError where no source has a scenario, or a source is given twice.
    """
    rows = pd.DataFrame(columns=list(COLUMNS))
    empty = Space(settings, (), rows, sources[0].traces.take([]), {})
    space = _with_sources(empty, sources, 0)
    if not len(space.rows):
        raise InputError(sources[0].folder, "holds no scenario with its slots", "Mine more recordings.")
    return cluster_buckets(space, workers, done)


def cluster_buckets(space: Space, workers: int = 1, done: BucketDone = _quietly) -> Space:
    """Give a space with the scenarios of each of its buckets clustered anew."""
    places = _places(len(space.rows))
    links: dict[str, BucketLinks] = {}
    for number, (bucket, own) in enumerate(_buckets(space.rows), start=1):
        pairs = PairDistances(space.traces.take(own), space.settings.distance, workers)
        found, links[bucket] = _clustered(pairs, space.settings)
        places.number[own] = number
        names = [f"{number}.{k + 1}" for k in range(found.count)]
        places.fill(own, names, found, pairs, np.arange(len(own)))
        done(bucket, len(own), found.count)
    return _placed(replace(space, links=links), places)


def grow_space(
    space: Space, sources: Sequence[MinedSource], workers: int = 1, done: BucketDone = _quietly
) -> Space:
    """Give the space with more sources. Clusters that it was built with keep their names, members and medoids.

    Who is in which cluster does not depend on the order in which sources come (`resim.space.placing`).
    Raises InputError where a source is in the space already.
    """
    grown = _with_sources(space, sources, 1 + max(one.batch for one in space.sources))
    places = _places(len(grown.rows))
    for name in ("number", "cluster", "medoid", "to_medoid"):
        getattr(places, name)[: len(space.rows)] = space.rows[name].to_numpy()
    numbers = dict(zip(space.rows["bucket"], space.rows["number"], strict=True))
    links = dict(space.links)
    for bucket, own in _buckets(grown.rows):
        number = int(numbers.setdefault(bucket, 1 + max(numbers.values())))
        if bucket not in links:
            links[bucket] = BucketLinks(usual_threshold(space), "as the others", "all pairs", ())
        pairs = PairDistances(grown.traces.take(own), space.settings.distance, workers)
        places.number[own] = number
        _grow_bucket(grown, own, pairs, links[bucket].threshold, places)
        done(bucket, len(own), len(set(places.cluster[own].tolist())))
    return _placed(replace(grown, links=links), places)


def usual_threshold(space: Space) -> float:
    """Give the threshold of a bucket that the space was not built with: the given one, or the median of those
    chosen.
    """
    if not isinstance(space.settings.threshold, str):
        return space.settings.threshold
    built = [part.threshold for part in space.links.values() if part.chosen in ("silhouette", "stability")]
    return float(np.median(built)) if built else float(np.median([p.threshold for p in space.links.values()]))


def _clustered(pairs: PairDistances, settings: SpaceSettings) -> tuple[BucketClusters, BucketLinks]:
    how, seed = settings.linkage, settings.seed
    if pairs.count > settings.largest:
        taken = np.sort(np.random.default_rng(seed).permutation(pairs.count)[: settings.sample])
        part = np.asarray(pairs.between(taken, taken)[np.triu_indices(len(taken), 1)])
        threshold, chosen = _threshold(part, len(taken), settings)
        return _with_links(cluster_all(pairs, how, threshold, settings.sample, seed), chosen, "samples")
    condensed = pairs.condensed()
    threshold, chosen = _threshold(condensed, pairs.count, settings)
    return _with_links(cluster(condensed, how, threshold), chosen, "all pairs")


def _threshold(condensed: Floats, count: int, settings: SpaceSettings) -> tuple[float, str]:
    """The threshold of a bucket, and by what it was chosen."""
    if not isinstance(settings.threshold, str):
        return settings.threshold, "given"
    by = settings.threshold
    return choose_threshold(condensed, count, settings.linkage, by, settings.seed).best, by


def _with_links(found: BucketClusters, chosen: str, method: str) -> tuple[BucketClusters, BucketLinks]:
    links = tuple(map(tuple, found.links.tolist()))
    return found, BucketLinks(found.threshold, chosen, method, links)


def _grow_bucket(space: Space, own: Ints, pairs: PairDistances, threshold: float, places: _Places) -> None:
    """Put the scenarios of a bucket that came after the space was built into its clusters, or new ones."""
    how, batch = space.settings.linkage, space.rows["batch"].to_numpy(int)[own]
    core, later = np.flatnonzero(batch == 0), np.flatnonzero(batch > 0)
    names = np.array(sorted(set(places.cluster[own[core]].tolist()), key=_in_order), dtype=object)
    members = [core[places.cluster[own[core]] == name] for name in names]
    medoid = np.array([m[places.medoid[own[m]]][0] for m in members], dtype=np.intp)
    label, _ = place_rows(pairs, later, FrozenClusters(members, medoid), how, threshold)
    fits = label >= 0
    rows = own[later[fits]]
    places.cluster[rows], places.medoid[rows] = names[label[fits]], False
    for k, row in zip(later[fits].tolist(), rows.tolist(), strict=True):
        places.to_medoid[row] = pairs.between(np.array([k]), medoid[label[later == k]])[0, 0]
    left = later[~fits]
    if not len(left):
        return
    left = left[_unordered(space, own[left])]
    part = PairDistances(space.traces.take(own[left]), space.settings.distance)
    if len(left) > space.settings.largest:
        found = cluster_all(part, how, threshold, space.settings.sample, space.settings.seed)
    else:
        found = cluster(part.condensed(), how, threshold)
    number = int(places.number[own[0]])
    new = [f"{number}.{NEW}{k + 1}" for k in range(found.count)]
    places.fill(own[left], new, found, part, np.arange(len(left)))


def _unordered(space: Space, rows: Ints) -> Ints:
    """Sort scenarios by what does not depend on the order in which their sources came, as their names in the space may:
    by their names in the source, and its content."""
    content = {one.name: one.hash for one in space.sources}
    found = space.rows.iloc[rows]
    hashes = np.array([content[str(name)] for name in found["source"]])
    return np.lexsort((hashes, found["name"].to_numpy(str)))


def _in_order(name: str) -> int:
    return int(name.partition(".")[2])


def _buckets(rows: pd.DataFrame) -> Iterator[tuple[str, Ints]]:
    """Buckets in order of their names, with their rows."""
    names = rows["bucket"].to_numpy(str)
    for bucket in np.unique(names).tolist():
        yield bucket, np.flatnonzero(names == bucket)


def _places(count: int) -> _Places:
    """Places of scenarios that are nowhere yet."""
    return _Places(
        np.zeros(count, dtype=np.intp), np.full(count, "", dtype=object), np.zeros(count, dtype=bool),
        np.full(count, np.nan),
    )  # fmt: skip


def _placed(space: Space, places: _Places) -> Space:
    rows = space.rows.assign(
        number=places.number, cluster=places.cluster.astype(str), medoid=places.medoid.astype(bool),
        to_medoid=places.to_medoid,
    )  # fmt: skip
    return replace(space, rows=typed(rows))


def typed(rows: pd.DataFrame) -> pd.DataFrame:
    """Give rows with the types of their columns, also where there is none."""
    texts = (
        "scenario",
        "source",
        "name",
        "drive",
        "recording",
        "ego",
        "map",
        "road",
        "tag",
        "folder",
        "build",
        "bucket",
        "cluster",
    )
    numbers = ("start", "end", "hours", "kilometres", "to_medoid")
    whole = ("batch", "lanes", "vehicles", "occasion", "number")
    types = dict.fromkeys(texts, "string") | dict.fromkeys(numbers, "float64") | dict.fromkeys(whole, "int64")
    return rows.astype(types | dict.fromkeys(("along_s", "medoid"), "bool") | {"collided": "boolean"})[
        list(COLUMNS)
    ]


def _with_sources(space: Space, sources: Sequence[MinedSource], batch: int) -> Space:
    """The space with the scenarios of sources, which are in no cluster yet."""
    entries, frames = list(space.sources), [space.rows] if len(space.rows) else []
    traces: list[SlotTraces] = [space.traces]
    moments = [space.moments]
    occasions = int(space.rows["occasion"].max()) + 1 if len(space.rows) else 0
    taken = set(space.rows["scenario"])
    for source in sources:
        if source.hash in {one.hash for one in entries}:
            raise InputError(source.folder, "is in the space already", "Name each mined folder once.")
        _refuse_twice(source, entries)
        _refuse_others(source, entries)
        driven = np.array([(one.hours, one.kilometres) for one in entries]).reshape(-1, 2).sum(axis=0)
        entry = _entry(source, _free(source.name, {one.name for one in entries}), batch)
        frames.append(_frame(source, entry, (occasions, driven, taken), space.settings))
        occasions += len(source.rows)
        taken |= set(frames[-1]["scenario"])
        entries.append(entry)
        traces.append(replace(source.traces, names=frames[-1]["scenario"].to_numpy(str)))
        moments.append(source.moments.assign(recording=f"{entry.name}/" + source.moments["recording"]))
    rows = pd.concat(frames, ignore_index=True) if frames else space.rows
    since = len(space.rows)
    whole = replace(
        space, sources=tuple(entries), rows=rows, traces=joined(traces),
        moments=pd.concat(moments, ignore_index=True),
    )  # fmt: skip
    recording = (rows["source"] + "/" + rows["recording"]).astype(str).tolist()
    if found := first_copy(whole.traces, recording, since):
        one, two = (rows["scenario"].iloc[k] for k in found)
        raise InputError(
            sources[-1].folder, f"scenarios {one} and {two}, of two recordings, see the same traffic to the centimetre",
            "A drive counts once, also as another file, cut anew, or around another EGO: mine it once.",
        )  # fmt: skip
    return with_drives(whole, since, {entry.name for entry in entries[len(space.sources) :]})


def _refuse_twice(source: MinedSource, entries: Sequence[SourceEntry]) -> None:
    """Raise InputError where a recording was mined twice: its hours and kinds would count twice."""
    known = {told for one in entries for told in (*one.recordings.values(), *one.traffic.values())}
    for one in source.recordings:
        if {one.tracks, one.traffic} & (known - {""}):
            problem = f"recording {one.name} is in the space already"
            raise InputError(
                source.folder, problem, "A drive counts once: mine each recording into one folder."
            )
        known |= {one.tracks, one.traffic}


def _refuse_others(source: MinedSource, entries: Sequence[SourceEntry]) -> None:
    """Raise InputError where a source was mined for other scenarios than the first one: in its hours nobody looked for
    those of the first, and their rates would be too small."""
    if not entries or (source.trigger, source.rules) == (entries[0].trigger, entries[0].rules):
        return
    first = entries[0]
    what = f"around {', '.join(source.trigger)}, {first.name} around {', '.join(first.trigger)}"
    if source.trigger == first.trigger:
        what = f"with other thresholds than {first.name}"
    raise InputError(
        source.folder, f"was mined {what}: scenarios of one would seem rare in the hours of the other",
        "Mine all of a space with the same thresholds and triggers; `trigger` in the file of thresholds names several.",
    )  # fmt: skip


def _free(name: str, taken: set[str]) -> str:
    found, number = name, 2
    while found in taken:
        found, number = f"{name}.{number}", number + 1
    return found


def _entry(source: MinedSource, name: str, batch: int) -> SourceEntry:
    rows = source.rows
    return SourceEntry(
        name, str(source.folder.resolve()), source.hash, source.mined, batch, source.egos, source.trigger, source.rules,
        sum(one.hours for one in source.recordings), sum(one.kilometres for one in source.recordings), len(rows),
        int(rows["occasion"].nunique()), len(source.left_out),
        float((rows["build"] != "").mean()) if len(rows) else math.nan,
        {one.name: one.tracks for one in source.recordings if one.tracks},
        {one.name: one.traffic for one in source.recordings if one.traffic},
        {one.name: one.content for one in source.recordings if one.content}, source.failed, _accidents(source),
        _driven_by(source), {one.name: (one.hours, one.kilometres) for one in source.recordings}, {},
    )  # fmt: skip


def _accidents(source: MinedSource) -> dict[str, int]:
    """Accidents of test drives that are in no scenario, by build."""
    found = Counter[str]()
    for one in source.recordings:
        found[one.build] += one.accidents
    return {build: count for build, count in sorted(found.items()) if build and count}


def _driven_by(source: MinedSource) -> dict[str, float]:
    """Hours by hash of the build, "" for people, and for all vehicles of a recording together."""
    found: dict[str, float] = {}
    for one in source.recordings:
        build = one.build if source.egos == "own" else ""
        found[build] = found.get(build, 0.0) + one.hours
    return dict(sorted(found.items()))


def _frame(
    source: MinedSource, entry: SourceEntry, before: tuple[int, Floats, set[str]], settings: SpaceSettings
) -> pd.DataFrame:
    """A row per scenario of a source with COLUMNS, which is in no cluster yet.

    before: occasions, hours and kilometres, and names of the space so far.
    """
    occasions, driven, taken = before
    rows = source.rows
    names = rows["scenario"].astype(str)
    own = [f"{entry.name}/{name}" if name in taken else name for name in names]
    folders = [str((source.folder / one).resolve()) if one else "" for one in rows["folder"].astype(str)]
    return rows.assign(
        scenario=own, name=names, source=entry.name, batch=entry.batch, folder=folders,
        drive=f"{entry.name}/" + rows["recording"].astype(str),
        occasion=rows["occasion"] + occasions, hours=rows["hours"] + driven[0],
        kilometres=rows["kilometres"] + driven[1], bucket=bucket_names(rows, settings),
        **{name: None for name in PLACED if name != "bucket"},
    )[list(COLUMNS)]  # fmt: skip
