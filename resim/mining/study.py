"""The study: recordings one after the other, each mined, its tables and scenarios written, and then forgotten.

The folder: `parts/<recording>/` with the tables of each and `part.json`, by which a recording that was mined before is
known; `recordings/`, `maps/<map>/` with the map and the JSCEN files; and of all together maneuvers.parquet and
scenarios.parquet.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.errors import InputError, ResimError
from resim.core.files import file_hash
from resim.core.spec import read_json, to_json
from resim.mining.cutting import cut, write_cut, write_described
from resim.mining.extraction import ExtractedScenario, extract
from resim.mining.features import Features, features
from resim.mining.find import find_maneuvers
from resim.mining.maneuver import LabelledManeuver
from resim.mining.own_labels import MiningRules
from resim.mining.rows import maneuver_frame, scenario_frame
from resim.mining.samples import VEHICLES
from resim.mining.slots import map_folder, slot_frame, slot_traces
from resim.mining.surroundings import SlotReach
from resim.recordings import Recording
from resim.recordings.checked import finding_lines, load_checked
from resim.recordings.content import content_hash
from resim.results import write_json, write_parquet
from resim.road.opendrive import RoadNetwork, load

PART = "part.json"
WRITTEN_BY, REMEDY = "resim mine", "Mine the recording again."
SCENARIOS = Callable[[Recording, Features, Sequence[LabelledManeuver]], list[ExtractedScenario]]


@dataclass(frozen=True)
class MinedPart:
    """What was found in one recording.

    Attributes:
        recording: Its name.
        folder: Where it was read.
        hash: Of its content, and of the rules.
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
        ego_hours: Hours [h] on lanes of the recording's own EGO.
        ego_kilometres: Its kilometres [km] on lanes.
        ego: Its id.
        build: The build that drove it, None where a person did or nobody says.
        build_hash: Hash of that build.
        map: Name of the map, with the beginning of its hash.
    """

    recording: str
    folder: str
    hash: str
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
    ego_hours: float | None = None
    ego_kilometres: float | None = None
    ego: str | None = None
    build: str | None = None
    build_hash: str | None = None
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
    out = []
    for one in scenarios:
        count[one.ego] += 1
        ego = "".join(c if c.isalnum() or c in "-_." else "_" for c in str(recording.gt.ids[one.ego]))
        out.append(f"{recording.name}_{ego}_{count[one.ego]}")
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
        told = [self.rules.hash, self.write, self.fit, "" if self.scenarios is None else self.scenarios[0]]
        told += ["slots, own drive, map", sorted(self.accept), self.rules.settings.model_dump(mode="json")]
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

    Raises InputError and other ResimErrors for a recording that cannot be mined.
    """
    digest = hashlib.sha256(f"{content_hash(folder)} {options.key()}".encode()).hexdigest()
    part = out / "parts" / name
    if (part / PART).is_file():
        before = read_json(part / PART, MinedPart, WRITTEN_BY, REMEDY)
        if before.hash == digest:
            return before
    for old in (part, *(out / "recordings").glob(f"{name}_*_*")):
        if old.is_dir() and (old == part or _is_of(old, name)):
            shutil.rmtree(old)
    recording = load_checked(folder, accept=options.accept)
    mined = mine_recording(
        replace(recording, name=name), options.rules, options.scenarios and options.scenarios[1]
    )
    frame = scenario_frame(name, mined.features, mined.scenarios, mined.names)
    if options.write:
        frame = _write_scenarios(mined, frame, out, fit=options.fit)
    part.mkdir(parents=True, exist_ok=True)
    write_parquet(maneuver_frame(name, mined.features, mined.maneuvers), part / "maneuvers.parquet")
    write_parquet(frame, part / "scenarios.parquet")
    slots = slot_frame(mined.names, slot_traces(mined.features, mined.scenarios))
    write_parquet(slots, part / "slots.parquet")
    told = summary(mined, name, folder, digest)
    write_json(to_json(told), part / f".{PART}")
    (part / f".{PART}").replace(part / PART)
    return told


def _is_of(folder: Path, name: str) -> bool:
    """Whether a scenario's folder was cut out of a recording of this name."""
    settings = folder / "recording.toml"
    return settings.is_file() and f'mined_from = "{name}"' in settings.read_text("utf-8")


def _write_scenarios(mined: MinedRecording, frame: pd.DataFrame, out: Path, *, fit: bool) -> pd.DataFrame:
    """Write all scenarios as recordings, and fitted ones; gives the table with where they are."""
    road = map_beside(mined.recording.map, out)
    folders, files, notes = [], [], []
    for one, name in zip(mined.scenarios, mined.names, strict=True):
        labels = ", ".join(dict.fromkeys(m.label for m in one.triggers))
        note, described = "", ""
        try:
            scenario = cut(mined.recording, one, name, labels)
            target = out / "recordings" / name
            if not target.is_dir():
                write_cut(scenario, target, road)
            folders.append(f"recordings/{name}")
        except ResimError as e:
            folders.append("")
            note = str(e)
        else:
            if fit:
                described, note = _described(scenario, mined.network, road)
        files.append(described)
        notes.append(note or _partial(one))
    return frame.assign(folder=folders, jscen=files, note=notes).astype(
        dict.fromkeys(("folder", "jscen", "note"), "string")
    )


def _described(scenario: Recording, network: RoadNetwork, road: Path) -> tuple[str, str]:
    """Where the JSCEN file of a scenario is, and "" or why there is none."""
    file = road.parent / f"{scenario.name}.jscen.json"
    try:
        if not file.is_file():
            write_described(scenario, network, file)
    except ResimError as e:
        return "", str(e)
    return f"maps/{road.parent.name}/{file.name}", ""


def _partial(one: ExtractedScenario) -> str:
    """What is to be said of a window in which the EGO is not all the time."""
    if (one.start, one.end) == (one.ego_start, one.ego_end):
        return ""
    return "the window is longer than the EGO's life: the recording is the part with the EGO"


def map_beside(road: Path, out: Path) -> Path:
    """Give the study's copy of a map, made at need: maps of one name and other content are told apart."""
    digest = file_hash(road)
    folder = out / "maps" / f"{road.stem}-{digest[:8]}"
    copy = folder / road.name
    if not copy.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(road, folder / f".{road.name}")
        (folder / f".{road.name}").replace(copy)
    return copy


def summary(mined: MinedRecording, name: str, folder: Path, digest: str) -> MinedPart:
    """Give what was found in a recording, in numbers."""
    samples, found = mined.features.samples, mined.features
    on = (found.row >= 0) & samples.kinds(VEHICLES)
    same = np.diff(samples.piece_of) == 0
    dt = np.where(same & on[1:], np.diff(samples.t), 0.0)
    way = np.where(same & on[1:], np.hypot(np.diff(samples.x), np.diff(samples.y)), 0.0)
    vehicles = samples.kinds(VEHICLES)
    own = samples.owner[:-1] == samples.tracks.index(mined.recording.ego)
    per_ego = Counter(one.ego for one in mined.scenarios)
    drives = np.isin(samples.tracks.kind, list(VEHICLES)) & samples.tracks.valid.any(axis=1)
    counts = Counter(per_ego.get(int(row), 0) for row in np.flatnonzero(drives))
    first, last = samples.tracks.span()
    return MinedPart(
        recording=name, folder=str(folder.resolve()), hash=digest, objects=len(samples.tracks),
        hours=float(dt.sum()) / 3600.0, kilometres=float(way.sum()) / 1000.0,
        labels=dict(sorted(Counter(m.label for m in mined.maneuvers).items())), scenarios=len(mined.scenarios),
        off_lane=float((found.row[vehicles] < 0).mean()) if vehicles.any() else 0.0, notes=mined.notes,
        vehicles_per_ego=_others(first[drives], last[drives]) if drives.any() else None,
        egos=tuple(counts.get(k, 0) for k in range(max(counts, default=-1) + 1)),
        lifetime=float((last - first)[drives].mean()) if drives.any() else None,
        ego_hours=float(dt[own].sum()) / 3600.0, ego_kilometres=float(way[own].sum()) / 1000.0,
        ego=mined.recording.ego, build=mined.recording.build, build_hash=mined.recording.build_hash,
        map=map_folder(mined.recording.map),
    )  # fmt: skip


def _others(first: np.ndarray, last: np.ndarray) -> float:
    """Mean number of others whose life (first to last [s]) shares time with that of each."""
    begun = np.searchsorted(np.sort(first), last, side="right")
    gone = np.searchsorted(np.sort(last), first, side="left")
    return float((begun - gone - 1).mean())
