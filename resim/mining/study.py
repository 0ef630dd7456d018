"""The study: recordings one after the other, each mined, its tables and scenarios written, and then forgotten.

The folder: `parts/<recording>/` with the tables of each and `part.json`, by which a recording that was mined before is
known (`cut.json` while its scenarios are being fitted); `pages/` with a page of each; `recordings/`, `maps/<map>/` with
the map and the JSCEN files; and of all together maneuvers.parquet and scenarios.parquet.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from resim.core.errors import InputError
from resim.core.files import check_hashes, file_hash, relative
from resim.core.provenance import versions
from resim.core.sealed import sealed
from resim.core.spec import read_sealed_json, to_json
from resim.core.tracks import Tracks
from resim.mining.cutting import AROUND, NEAR, CutSource
from resim.mining.extraction import ExtractedScenario, extract
from resim.mining.features import Features, features
from resim.mining.find import find_maneuvers
from resim.mining.labels.speed import STANDING
from resim.mining.maneuver import LabelledManeuver
from resim.mining.overview import overview_frame
from resim.mining.own_labels import MiningRules
from resim.mining.page import PAGES, write_recording_page
from resim.mining.rows import maneuver_frame, scenario_frame
from resim.mining.samples import VEHICLES
from resim.mining.scenario_files import (
    JOINT,
    FitTask,
    fit_tasks,
    forget_scenarios,
    with_fits,
    write_scenarios,
)
from resim.mining.slots import map_folder, slot_frame, slot_traces
from resim.mining.surroundings import SlotReach
from resim.recordings import Recording, read_tables
from resim.recordings.checked import finding_lines, load_checked
from resim.recordings.content import content_hash, tracks_hash
from resim.recordings.tables import read_parquet
from resim.resimulation import AssessmentOptions, assess_recording
from resim.results import write_json, write_parquet
from resim.road.opendrive import RoadNetwork, load

PART, CUT = "part.json", "cut.json"
"""What says of a part that it is finished, and that its scenarios are cut out but not yet all fitted."""
PART_TABLES = ("maneuvers", "scenarios", "overview", "slots")
WRITTEN_BY, REMEDY = "resim mine", "Mine the recording again."
SCENARIOS = Callable[[Recording, Features, Sequence[LabelledManeuver]], list[ExtractedScenario]]


@dataclass(frozen=True)
class MinedPart:
    """What was found in one recording.

    Attributes:
        recording: Its name.
        folder: Where it was read, seen from the study's folder.
        content: Hash of what it holds.
        tracks: Hash of its GT, EGO and map, which copies under other names share.
        traffic: Hash of who was where, which copies of other bytes share.
        key: Of thresholds and options.
        objects: How many there are.
        hours: Vehicle hours [h] on lanes.
        kilometres: Vehicle kilometres [km] on lanes.
        labels: How many of each label.
        scenarios: How many.
        off_lane: Share of samples of vehicles that are on no driven lane.
        notes: What is to be known to believe it.
        vehicles_per_ego: Mean number of others that are there during an EGO's life, NaN without an EGO.
        egos: How many EGOs have 0, 1, 2, ... scenarios.
        lifetime: Mean life [s] of an EGO.
        files: SHA-256 of its files, by their paths in the study's folder; in `part.json` alone.
        ego_hours: Hours [h] on lanes of the recording's own EGO.
        ego_kilometres: Its kilometres [km] on lanes.
        standing_hours: Of `hours`, those [h] in which vehicles stand.
        ego_standing_hours: Of `ego_hours` likewise.
        ego: Its id.
        build: The build that drove it, None where a person did or nobody says.
        build_hash: Hash of that build.
        ended: When [s] its EGO's drive broke off (a collision, the road's edge, the function), None where it did not.
        collided: Whether its EGO did, of a drive of a build; None of others, and where somebody may have been hit
            unseen.
        map: Name of the map, with the beginning of its hash.
    """

    recording: str
    folder: str
    content: str
    tracks: str
    traffic: str
    key: str
    objects: int
    hours: float
    kilometres: float
    labels: Mapping[str, int]
    scenarios: int
    off_lane: float
    notes: tuple[str, ...] = ()
    vehicles_per_ego: float | None = None
    egos: tuple[int, ...] = ()
    lifetime: float | None = None
    files: Mapping[str, str] = field(default_factory=dict)
    ego_hours: float | None = None
    ego_kilometres: float | None = None
    standing_hours: float | None = None
    ego_standing_hours: float | None = None
    ego: str | None = None
    build: str | None = None
    build_hash: str | None = None
    ended: float | None = None
    collided: bool | None = None
    map: str | None = None


@dataclass(frozen=True, eq=False)
class MinedRecording:
    """A recording with all that was found in it.

    Attributes:
        recording: The recording.
        network: Its map.
        features: Of all samples.
        maneuvers: All that were found.
        scenarios: All that were cut out.
        names: Of the scenarios.
        notes: What is to be known to believe them.
    """

    recording: Recording
    network: RoadNetwork
    features: Features
    maneuvers: list[LabelledManeuver]
    scenarios: list[ExtractedScenario]
    names: list[str]
    notes: tuple[str, ...] = field(default=())


def mine_recording(
    recording: Recording, rules: MiningRules, scenarios: SCENARIOS | None = None
) -> MinedRecording:
    """Find the maneuvers of a recording and its scenarios, in memory.

    scenarios: gives them in place of extraction. Raises InputError where nobody is on the map.
    """
    network = load(recording.map)
    cutting = rules.settings.extraction
    reach = SlotReach(cutting.beside, cutting.ahead, cutting.behind)
    found = features(recording.gt, network, reach)
    notes = _placed(recording, found)
    maneuvers = find_maneuvers(found, rules.settings, rules.own)
    made = (scenarios or _extracted(rules))(recording, found, maneuvers)
    notes = (*notes, *finding_lines(recording.findings))
    return MinedRecording(recording, network, found, maneuvers, made, _names(recording, made), notes)


def _extracted(rules: MiningRules) -> SCENARIOS:
    return lambda recording, found, maneuvers: extract(found, maneuvers, rules.settings.extraction)


def _placed(recording: Recording, found: Features) -> tuple[str, ...]:
    """What is wrong with where objects are. Raises InputError where no vehicle is on any lane."""
    vehicles = found.samples.kinds(VEHICLES)
    where = recording.folder or recording.name
    off = float((found.row[vehicles] < 0).mean()) if vehicles.any() else 0.0
    if not (found.row >= 0).any():
        problem = f"no object is ever on a driven lane of {recording.map.name}"
        raise InputError(where, problem, "Give the map of this place, in the frame of the recording.")
    if off > 0.5:
        return (f"{100.0 * off:.0f} % of the samples of vehicles are on no driven lane of {recording.map.name}: "
                "another frame, or another map?",)  # fmt: skip
    if len(recording.gt) < 2:
        return ("it has one object: nothing can be around it",)
    return ()


def _names(recording: Recording, scenarios: Sequence[ExtractedScenario]) -> list[str]:
    """Names of scenarios: recording, EGO, and which of the EGO's it is."""
    count: Counter[int] = Counter()
    known: dict[str, int] = {}
    out = []
    for one in scenarios:
        count[one.ego] += 1
        ego = base = "".join(c if c.isalnum() or c in "-_." else "_" for c in str(recording.gt.ids[one.ego]))
        number = 2
        while known.setdefault(ego, one.ego) != one.ego:  # another one's id that is written alike
            ego, number = f"{base}.{number}", number + 1
        out.append(f"{recording.name}{JOINT}{ego}{JOINT}{count[one.ego]}")
    return out


@dataclass(frozen=True)
class StudyOptions:
    """How to mine.

    Attributes:
        rules: Thresholds and own labels.
        accept: Codes of findings to continue despite.
        write: Whether scenarios are written as recordings.
        fit: Whether they are fitted, and written as JSCEN.
        scenarios: What gives scenarios in place of extraction, and what names it.
    """

    rules: MiningRules = field(default_factory=MiningRules)
    accept: tuple[str, ...] = ()
    write: bool = True
    fit: bool = True
    scenarios: tuple[str, SCENARIOS] | None = None

    def key(self) -> str:
        """Give what a part must have been mined with to be taken as it is."""
        told: list[object] = [
            versions(),
            self.rules.hash,
            self.write,
            self.fit,
            "" if self.scenarios is None else self.scenarios[0],
        ]
        told += [sorted(self.accept), self.rules.settings.model_dump(mode="json")]
        return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def own_extraction(rules: MiningRules) -> SCENARIOS:
    """Give what extracts the scenarios of each recording's own EGO."""

    def find(
        recording: Recording, found: Features, maneuvers: Sequence[LabelledManeuver]
    ) -> list[ExtractedScenario]:
        row = recording.gt.index(recording.ego)
        return [one for one in extract(found, maneuvers, rules.settings.extraction) if one.ego == row]

    return find


def mine_into(folder: Path, name: str, out: Path, options: StudyOptions) -> MinedPart:
    """Mine a recording folder under this name into the study's folder, or take what was mined before.

    Scenarios that are to be fitted are not yet: `pending_fits` gives what is left to do, `finish_part` ends it.
    Raises InputError and other ResimErrors for a recording that cannot be mined.
    """
    content, tracks, key = content_hash(folder), tracks_hash(folder), options.key()
    part = out / "parts" / name
    if (before := _kept(part, out, content, key)) is not None:
        return replace(before, folder=seen_from(out, folder))  # of the same content, wherever it lies now
    forget_scenarios(out, name)
    shutil.rmtree(part, ignore_errors=True)
    recording = load_checked(folder, accept=options.accept)
    mined = mine_recording(
        replace(recording, name=name), options.rules, options.scenarios and options.scenarios[1]
    )
    frame = scenario_frame(name, mined.features, mined.scenarios, mined.names)
    if options.write:
        reach = NEAR if options.scenarios is None else AROUND
        source = CutSource(mined.recording, read_tables(folder), tracks, reach)
        frame = write_scenarios(source, mined.scenarios, frame, out, fit=options.fit)
    part.mkdir(parents=True, exist_ok=True)
    frames = maneuver_frame(name, mined.features, mined.maneuvers), frame, overview_frame(mined.features)
    slots = slot_frame(mined.names, slot_traces(mined.features, mined.scenarios))
    for table, rows in zip(PART_TABLES, (*frames, slots), strict=True):
        write_parquet(rows, part / f"{table}.parquet")
    write_recording_page(mined, name, frames, out)
    follows_from = content, tracks, key
    return _write_mark(summary(mined, name, seen_from(out, folder), follows_from), part / CUT, out)


def _kept(part: Path, out: Path, content: str, key: str) -> MinedPart | None:
    """What was mined before, where it follows from the same and all of it is as it was; its fits may be left to do."""
    for mark in (PART, CUT):
        try:
            before = read_sealed_json(part / mark, MinedPart, WRITTEN_BY, REMEDY)
            if (before.content, before.key) == (content, key):
                check_hashes(out, before.files, REMEDY)
                return before
        except InputError:
            continue
    return None


def pending_fits(out: Path, name: str) -> list[FitTask]:
    """Give the scenarios of a part that are still to be fitted: none of one that is finished."""
    part = out / "parts" / name
    if not (part / CUT).is_file():
        return []
    return fit_tasks(read_parquet(part / "scenarios.parquet"), out)


def finish_part(out: Path, told: MinedPart, failed: dict[str, str]) -> MinedPart:
    """End a part whose fits are done, and give it as it is then: its table says where JSCEN files are.

    failed: why there is none, by the file's name.
    """
    part = out / "parts" / told.recording
    if not (part / CUT).is_file():
        return told
    whole = with_fits(read_parquet(part / "scenarios.parquet"), out, failed)
    write_parquet(whole, part / ".scenarios.parquet")
    (part / ".scenarios.parquet").replace(part / "scenarios.parquet")
    finished = _write_mark(told, part / PART, out)
    (part / CUT).unlink()
    return finished


def _write_mark(told: MinedPart, file: Path, out: Path) -> MinedPart:
    """Write what is told of a part with the hashes of all its files; gives it with them."""
    whole = replace(told, files={name: file_hash(out / name) for name in _files(told.recording, out)})
    beside = file.with_name(f".{file.name}")
    write_json(sealed(to_json(whole)), beside)
    beside.replace(file)
    return whole


def _files(recording: str, out: Path) -> Iterator[str]:
    """The files of a part, seen from the study's folder: tables, page, scenarios, and JSCEN files that there are."""
    yield f"{PAGES}/{recording}.html"
    yield from (f"parts/{recording}/{table}.parquet" for table in PART_TABLES)
    rows = read_parquet(out / "parts" / recording / "scenarios.parquet")
    for folder, file in zip(rows["folder"].fillna(""), rows["jscen"].fillna(""), strict=True):
        if folder:
            yield from (f"{folder}/{path.name}" for path in sorted((out / folder).iterdir()))
        if file and (out / file).is_file():
            yield file


def seen_from(out: Path, folder: Path) -> str:
    """Give the path of a recording as seen from a study's folder: both may be moved together."""
    return relative(folder.resolve(), out.resolve())


def summary(mined: MinedRecording, name: str, folder: str, follows_from: tuple[str, str, str]) -> MinedPart:
    """Give what was found in a recording, in numbers.

    follows_from: hash of its content, of its GT, EGO and map, and key of the options.
    """
    samples, found = mined.features.samples, mined.features
    on = (found.row >= 0) & samples.kinds(VEHICLES)
    same = np.diff(samples.piece_of) == 0
    dt = np.where(same & on[1:], np.diff(samples.t), 0.0)
    way = np.where(same & on[1:], np.hypot(np.diff(samples.x), np.diff(samples.y)), 0.0)
    stands = np.zeros(len(dt))
    for one in mined.maneuvers:
        if one.label == STANDING:
            stands[one.start : one.end] = dt[one.start : one.end]
    vehicles = samples.kinds(VEHICLES)
    own = samples.owner[:-1] == samples.tracks.index(mined.recording.ego)
    per_ego = Counter(one.ego for one in mined.scenarios)
    drives = np.isin(samples.tracks.kind, list(VEHICLES)) & samples.tracks.valid.any(axis=1)
    counts = Counter(per_ego.get(int(row), 0) for row in np.flatnonzero(drives))
    first, last = samples.tracks.span()
    return MinedPart(
        recording=name, folder=folder, content=follows_from[0], tracks=follows_from[1],
        traffic=_traffic_hash(samples.tracks),
        key=follows_from[2],
        objects=len(samples.tracks),
        hours=float(dt.sum()) / 3600.0, kilometres=float(way.sum()) / 1000.0,
        labels=dict(sorted(Counter(m.label for m in mined.maneuvers).items())), scenarios=len(mined.scenarios),
        off_lane=float((found.row[vehicles] < 0).mean()) if vehicles.any() else 0.0, notes=mined.notes,
        vehicles_per_ego=_others(first[drives], last[drives]) if drives.any() else None,
        egos=tuple(counts.get(k, 0) for k in range(max(counts, default=-1) + 1)),
        lifetime=float((last - first)[drives].mean()) if drives.any() else None,
        ego_hours=float(dt[own].sum()) / 3600.0, ego_kilometres=float(way[own].sum()) / 1000.0,
        standing_hours=float(stands.sum()) / 3600.0, ego_standing_hours=float(stands[own].sum()) / 3600.0,
        ego=mined.recording.ego, build=mined.recording.build, build_hash=mined.recording.build_hash,
        ended=_broke_off(mined.recording), collided=_collided(mined.recording), map=map_folder(mined.recording.map),
    )  # fmt: skip


def _traffic_hash(tracks: Tracks) -> str:
    """The SHA-256 of who was where, to the millimetre: of one drive in files of different bytes it is the same."""
    order = np.argsort(tracks.ids)
    told = hashlib.sha256("\n".join(tracks.ids[order].tolist()).encode())
    told.update(np.round(tracks.t - tracks.t[0], 4).tobytes())
    for values in (tracks.x, tracks.y):
        told.update((np.round(np.nan_to_num(values[order], nan=1e9), 3) + 0.0).tobytes())
    return told.hexdigest()


def _broke_off(recording: Recording) -> float | None:
    """When the drive of a function ended early, as whoever made the recording says; None where it did not."""
    if not recording.provenance.get("ended"):
        return None
    gt = recording.gt
    return float(gt.t[gt.valid[gt.index(recording.ego)]][-1])


def _collided(recording: Recording) -> bool | None:
    """Whether the EGO of a build's drive collides, also with whoever is missing at that time: labels see rows alone."""
    if recording.build is None:
        return None
    found = assess_recording(recording, AssessmentOptions(only=("collision",))).blocks["GT"]
    return True if found.contacts else False if found.clear else None


def _others(first: np.ndarray, last: np.ndarray) -> float:
    """Mean number of others whose life (first to last [s]) shares time with that of each."""
    begun = np.searchsorted(np.sort(first), last, side="right")
    gone = np.searchsorted(np.sort(last), first, side="left")
    return float((begun - gone - 1).mean())
