"""Recordings and re-simulations, assessed: each of GT, SD, rGT, rSD by its JSCEN, ten times a second."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from resim.assess.assessment import Assessment, assess
from resim.assess.criteria import Criteria
from resim.assess.drive import Path as EgoPath
from resim.assess.drive import Plans, drive
from resim.assess.functional import Functioning
from resim.assess.objectifications import Subject, contacts
from resim.assess.risk import DEFAULTS, Parameters
from resim.assess.risk.prediction import Prediction
from resim.assess.unseen import WHOLE, Doubts
from resim.core.errors import InputError
from resim.core.finding import Finding
from resim.core.geometry import Floats
from resim.core.tracks import Strings, Tracks, whole_id
from resim.fidelity import collisions
from resim.ingest import Recording
from resim.ingest.folder import PLAN_COLUMNS
from resim.ingest.tables import read_table
from resim.pipeline.doubts import doubts
from resim.pipeline.model_runs import MODEL, ModelRuns
from resim.pipeline.notes import misfits
from resim.pipeline.recordings import examined, finding_lines
from resim.pipeline.result import Resimulation, finding_of
from resim.pipeline.run import describe_recording, map_name, measured_tracks
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.jscen import read_jscen
from resim.scenario.scenario import Scenario, describe
from resim.sim.run import Run, why_not_whole

RATE = 10.0
"""Scenes a second [Hz] that are assessed, if nothing else is said."""

FINE = 100.0
"""Samples a second [Hz] in which collisions are looked for."""

BLOCKS = ("GT", "SD", "rGT", "rSD")
"""What is assessed, in the order of the tables."""

DELAY = "CLOCK_OFFSET"
"""Code of the finding that says how late SD is."""


@dataclass(frozen=True, eq=False)
class How:
    """How to assess. path: where the EGO's path comes from (its plan where there is one, else its state).

    prediction: how objects may go on (None: as published); road_aware: along their lanes. only: objectifications to
    compute besides those that criteria ask for, None for all. rate: scenes a second [Hz].
    """

    parameters: Parameters = DEFAULTS
    path: EgoPath = "plan"
    prediction: Prediction | None = None
    road_aware: bool = False
    criteria: Criteria | None = None
    only: tuple[str, ...] | None = None
    rate: float = RATE


@dataclass(frozen=True, eq=False)
class Assessed:
    """The assessment of each of GT, SD, rGT, rSD, as far as they are there. run: whether it is of a re-simulation.

    failures: of runs that failed, and why; also of those that have no assessment, as there was nothing to assess.
    findings: what is wrong with the recording, worst first, notes left out. model: the runs with a perception model,
    where there are any, and criteria to judge them by.
    misfits: lines that name objects whose traces, by which they are assessed, are not where they were.
    """

    name: str
    network: RoadNetwork
    run: bool
    blocks: Mapping[str, Assessment]
    criteria: Criteria | None
    failures: Mapping[str, str]
    findings: tuple[str, ...] = ()
    model: ModelRuns | None = None
    misfits: tuple[str, ...] = ()

    def notes(self) -> list[str]:
        """Give what one has to know to compare the blocks and to believe them."""
        kinds = {name: sorted(set(a.drive.path)) for name, a in self.blocks.items()}
        out = []
        if len({tuple(k) for k in kinds.values()}) > 1:
            told = "; ".join(f"{name} by its {' and '.join(k)}" for name, k in kinds.items())
            folder = "RESULTS" if self.run else "RECORDING"
            out.append(
                f"the EGO's path differs: {told}; `resim assess {folder} --path state` makes them alike"
            )
        out += [f"{name}: {why}" for name, why in self.failures.items() if name not in self.blocks]
        out += self.misfits
        return out + [f"{name}: {note}" for name, a in self.blocks.items() for note in a.notes()]

    def bad(self) -> dict[str, str]:
        """Give the verdict of each source that does not pass."""
        out = {name: str(a.verdict) for name, a in self.blocks.items() if a.verdict not in (None, "PASS")}
        if self.model is not None and self.model.verdict != "PASS":
            counts = self.model.counts()
            out[MODEL] = f"{self.model.verdict} ({counts['PASS']} of {sum(counts.values())} seeds pass)"
        return out

    def kpi_frame(self) -> pd.DataFrame:
        """Give the worst of every objectification and the KPI of every criterion, one row each, by source."""
        rows = [{"source": name, **row} for name, a in self.blocks.items() for row in a.kpis()]
        rows += [] if self.model is None else self.model.kpis()
        frame = pd.DataFrame(rows)
        numbers = ["value", "t", "limit", "weight"]
        return frame.assign(**{column: frame[column].astype(float) for column in numbers})

    def to_json(self) -> dict[str, Any]:
        """Give the blocks of a run by name; of a recording the block of GT, with that of SD in `SD`."""
        blocks = {name: a.to_json() for name, a in self.blocks.items()}
        if self.run:
            model = {} if self.model is None else {MODEL: self.model.to_json()}
            return {
                **blocks,
                **model, "failures": dict(self.failures), "findings": list(self.findings), "notes": self.notes(),
            }  # fmt: skip
        gt = blocks.pop("GT")
        return {**gt, **blocks, "findings": list(self.findings), "notes": self.notes()}


@dataclass(frozen=True, eq=False)
class _Block:
    """What one block is assessed from."""

    scenario: Scenario
    plans: Plans
    functioning: Functioning
    collisions: tuple[tuple[float, str], ...]
    flaw: str = ""
    doubts: Doubts = WHOLE


def assess_folder(folder: Path, how: How, accept: Iterable[str] = ()) -> Assessed:
    """Assess a recording (GT, and SD where there is one) or what `resim run` wrote (GT, SD, rGT, rSD).

    accept: codes of findings in a recording in spite of which to go on. Raises InputError for a folder that is neither.
    """
    if (folder / "run.json").is_file():
        return _assess_results(folder, how)
    if (folder / "recording.toml").is_file():
        return assess_recording(examined(folder, accept=tuple(accept)), how)
    problem = "holds neither recording.toml nor run.json"
    raise InputError(folder, problem, "Give a recording, or the folder that `resim run` wrote.")


def assess_recording(recording: Recording, how: How) -> Assessed:
    """Assess what was measured: GT, and SD where there is one."""
    network = load(recording.map)
    described = describe_recording(recording, network)
    measured = measured_tracks(recording)
    plans, sd = _plans(recording.plan), measured.get("SD")
    seen = None if sd is None else sd.to_frame()
    functioning = _measured(seen, plans, {f.code: f.value for f in recording.findings if not f.object})
    blocks = {
        str(basis): _Block(
            scenario, plans, replace(functioning, of_truth=basis == "GT"),
            tuple(collisions(measured[basis], ego=recording.ego)),
            doubts=doubts(recording, basis, measured[basis], scenario, network),
        )
        for basis, scenario in described.items()
    }  # fmt: skip
    found = _assessed(recording.name, network, False, blocks, how, {}, recording.findings)
    scenarios = {str(basis): scenario for basis, scenario in described.items()}
    rows = {str(basis): measured[basis].to_frame() for basis in described}
    return replace(found, misfits=tuple(misfits(scenarios, rows, network).values()))


def assess_resimulation(result: Resimulation, how: How, *, model: bool = False) -> Assessed:
    """Assess a re-simulation: GT, SD, rGT, rSD; with `model` and criteria its runs with a perception model as well."""
    tables = _Tables(result.tracks_frame(), result.answers_frame(), result.plans_frame())
    report = result.report()
    blocks = _run_blocks(result.scenarios(), tables, report)
    failures = _failures(report, blocks)
    found = _assessed(
        result.recording.name, result.network, True, blocks, how, failures, result.recording.findings
    )
    runs = _model_runs(blocks["GT"], tables, report, result.network, how) if model else None
    return replace(found, model=runs, misfits=tuple(result.misfits.values()))


def assess_run(
    run: Run, scenario: Scenario, network: RoadNetwork, how: How, doubts: Doubts = WHOLE
) -> Assessment:
    """Assess one simulation by the scenario that describes it. doubts: of the measurement that its traffic is of."""
    t = np.array([p.t for p in run.perceived])
    hits = tuple((c.t, c.id) for c in run.collisions)
    counts = [len(p.ids) for p in run.perceived]
    ids = np.concatenate([np.empty(0, dtype=str), *(p.ids for p in run.perceived)])
    functioning = _functioning(np.repeat(t, counts), ids, t, t, 0.0)
    flaw = why_not_whole(run.end, run.failure, float(run.truth.t[-1]))
    block = _Block(scenario, run.plans, functioning, hits, flaw, doubts.simulated(scenario.ego.id))
    return _assess(block, network, how)


@dataclass(frozen=True, eq=False)
class _Tables:
    """Tables by `source` that `resim run` writes."""

    tracks: pd.DataFrame
    answers: pd.DataFrame
    plans: pd.DataFrame


def _assess_results(folder: Path, how: How) -> Assessed:
    report = folder / "report.json"
    remedy = "Run it again."
    try:
        written = json.loads(report.read_text(encoding="utf-8"))
        road, name = folder / map_name(Path(str(written["map"]))), str(written["recording"])
    except (OSError, ValueError, KeyError, TypeError) as e:
        raise InputError(report, "is not what `resim run` writes", remedy) from e
    network = load(road)
    files = {name: folder / f"{name}.jscen.json" for name in BLOCKS}
    scenarios = {name: read_jscen(path) for name, path in files.items() if path.is_file()}
    tables = _Tables(
        read_table(
            folder / "tracks.parquet",
            required=("source", "t", "id", "x", "y"),
            text=("source", "id", "kind"),
            optional=("heading", "v", "length", "width", "kind"),
        ),
        _table(folder / "answers.parquet", ("source", "t")),
        _table(folder / "plans.parquet", ("source", *PLAN_COLUMNS)),
    )
    try:
        if lost := [basis for basis in ("GT", *_described(written)) if basis not in scenarios]:
            raise InputError(folder, f"{lost[0]}.jscen.json is missing", remedy)
        blocks = _run_blocks(scenarios, tables, written)
        failures = _failures(written, blocks)
        findings = tuple(map(finding_of, written["findings"]))
        model = _model_runs(blocks["GT"], tables, written, network, how)
    except (ValueError, KeyError, TypeError) as e:
        raise InputError(report, "is not what `resim run` writes", remedy) from e
    found = _assessed(name, network, True, blocks, how, failures, findings)
    rows = {name: tables.tracks[tables.tracks.source == name] for name in scenarios}
    return replace(found, model=model, misfits=tuple(misfits(scenarios, rows, network).values()))


def _described(report: Mapping[str, Any]) -> list[str]:
    """The runs that lasted long enough to be described, as report.json has it."""
    return [
        f"r{basis}" for basis in ("GT", "SD") if report["errors"][f"FIT_r{basis}"]["ego"]["d"] is not None
    ]


def _failures(report: Mapping[str, Any], blocks: Mapping[str, _Block]) -> dict[str, str]:
    """The runs that failed, or ended before there was anything to assess, and why."""
    out = {}
    for name, end in report["end"].items():
        if (why := report["failure"].get(name)) is not None:
            out[name] = str(why)
        elif name not in blocks:
            out[name] = f"ended by {end} before there was anything to assess"
    return out


def _table(path: Path, columns: tuple[str, ...]) -> pd.DataFrame:
    return read_table(path, required=columns, text=("source",), may_be_empty=True)


def _run_blocks(
    scenarios: Mapping[str, Scenario], tables: _Tables, report: Mapping[str, Any]
) -> dict[str, _Block]:
    """The blocks of a run, of its tables and what its report.json says."""
    tracks, answers, plans = tables.tracks, tables.answers, tables.plans
    hits = {
        name: tuple((float(h["t"]), str(h["id"])) for h in found)
        for name, found in report["collisions"].items()
    }
    findings = {f["code"]: f["value"] for f in report["findings"] if not f["object"]}
    recorded = _plans(plans[plans.source == "recorded"])
    seen = tracks[tracks.source == "SD"]
    measured = _measured(seen if len(seen) else None, recorded, findings)
    open_ = {name: Doubts.from_json(found) for name, found in report["doubts"].items()}
    out = {
        name: _Block(
            _simulated(name, scenarios, report), recorded, replace(measured, of_truth=name == "GT"), hits[name],
            doubts=open_[name],
        )
        for name in ("GT", "SD")
        if name in scenarios
    }  # fmt: skip
    for name in ("rGT", "rSD"):
        if name in scenarios:
            t = answers.t[answers.source == name].to_numpy(dtype=float)
            functioning = _listed(tracks[tracks.source == f"perceived_{name}"], t, t, 0.0)
            last = float(tracks.t[tracks.source == name].max())
            flaw = why_not_whole(report["end"][name], report["failure"].get(name) or "", last)
            out[name] = _Block(
                scenarios[name], _plans(plans[plans.source == name]), functioning, hits[name], flaw,
                open_[name[1:]].simulated(scenarios[name].ego.id),
            )  # fmt: skip
    return out


def _model_runs(
    gt: _Block, tables: _Tables, report: Mapping[str, Any], network: RoadNetwork, how: How
) -> ModelRuns | None:
    """The runs with a perception model, judged; None where there are none, or no criteria."""
    told = report["perception"]
    if told is None or how.criteria is None:
        return None
    found: dict[int, Assessment | None] = {}
    for seed in told["seeds"]:
        block = _model_block(gt, tables, seed, network)
        found[seed["seed"]] = None if block is None else _assess(block, network, replace(how, only=()))
    collided = tuple(seed["seed"] for seed in told["seeds"] if seed["collisions"])
    return ModelRuns(told["model"]["name"], how.criteria, found, collided)


def _model_block(gt: _Block, tables: _Tables, seed: Mapping[str, Any], network: RoadNetwork) -> _Block | None:
    """One run with a perception model: the EGO as it drove, the traffic of GT; None where it ended at once."""
    source, ego = f"{MODEL}{seed['seed']}", gt.scenario.ego.id
    rows = tables.tracks[tables.tracks.source == source]
    if len(rows) < 2:
        return None
    driven = describe(Tracks.from_frame(rows), network, ego=ego, map_name=gt.scenario.map)
    t = tables.answers.t[tables.answers.source == source].to_numpy(dtype=float)
    return _Block(
        replace(driven, objects=gt.scenario.objects), _plans(tables.plans[tables.plans.source == source]),
        _listed(tables.tracks[tables.tracks.source == f"perceived_{source}"], t, t, 0.0),
        tuple((float(h["t"]), str(h["id"])) for h in seed["collisions"]),
        why_not_whole(seed["end"], seed["failure"] or "", float(rows.t.max())), gt.doubts.simulated(ego),
    )  # fmt: skip


def _simulated(basis: str, scenarios: Mapping[str, Scenario], report: Mapping[str, Any]) -> Scenario:
    """What was measured, up to the last whole step of a simulation of all of it: both are judged at the same times."""
    again = scenarios.get(f"r{basis}")
    if again is None or report["end"][f"r{basis}"] != "duration":
        return scenarios[basis]
    return replace(scenarios[basis], duration=again.duration)


def _assessed(
    name: str,
    network: RoadNetwork,
    run: bool,
    blocks: Mapping[str, _Block],
    how: How,
    failures: Mapping[str, str],
    findings: Iterable[Finding],
) -> Assessed:
    found = {key: _assess(block, network, how) for key, block in blocks.items()}
    return Assessed(name, network, run, found, how.criteria, failures, finding_lines(findings))


def _assess(block: _Block, network: RoadNetwork, how: How) -> Assessment:
    scenario = block.scenario
    often, seldom = _times(scenario, FINE), _times(scenario, how.rate)
    t = np.union1d(often, seldom)
    every = scenario.tracks(network, t)

    def subject(every: Tracks) -> Subject:
        made = drive(
            every.samples(np.searchsorted(t, seldom)), ego=scenario.ego.id, plans=block.plans, path=how.path,
            parameters=how.parameters, predicted=how.prediction, road=network if how.road_aware else None,
        )  # fmt: skip
        fine = every if len(t) == len(often) else every.samples(np.searchsorted(t, often))
        hits = tuple(sorted([*contacts(fine, scenario.ego.id), *block.collisions]))
        own = () if how.criteria is None else how.criteria.own
        return Subject(made, network, how.parameters, block.functioning, hits, own)

    larger = _larger(every, block.doubts)
    return assess(
        subject(every),
        how.criteria,
        block.flaw,
        how.only,
        block.doubts,
        None if larger is None else subject(larger),
    )


def _larger(tracks: Tracks, doubts: Doubts) -> Tracks | None:
    """The tracks with boxes that hold all that objects and their parts may fill; None where none is in doubt."""
    known = {*doubts.sizes, *doubts.off}
    names = [whole_id(name, known) for name in tracks.ids.tolist()]
    if not known.intersection(names):
        return None
    off = np.array([doubts.off.get(name, 0.0) for name in names])
    sizes = np.array([doubts.sizes.get(name, (0.0, 0.0)) for name in names])
    length, width = (
        np.maximum(own, side) + 2.0 * off
        for own, side in zip((tracks.length, tracks.width), sizes.T, strict=True)
    )
    return replace(tracks, length=length, width=width)


def _times(scenario: Scenario, rate: float) -> Floats:
    """Times [s] of the whole scenario, `rate` a second."""
    return np.round(scenario.ego.spawn_time + np.arange(0.0, scenario.duration + 1e-9, 1.0 / rate), 9)


def _plans(frame: pd.DataFrame | None) -> Plans:
    """The plans in a table of PLAN_COLUMNS, by the time they were made; a planned time counts once."""
    if frame is None or not len(frame):
        return ()
    rows = (
        frame[list(PLAN_COLUMNS)].drop_duplicates(["t", "t_plan"]).sort_values(["t", "t_plan"], kind="stable")
    )
    values = rows.to_numpy(dtype=float)
    made, first = np.unique(values[:, 0], return_index=True)
    return tuple(zip(made.tolist(), np.split(values[:, 1:], first[1:]), strict=True))


def _measured(seen: pd.DataFrame | None, plans: Plans, findings: Mapping[str, float | None]) -> Functioning:
    """What perception and function did in the measured drive, as far as it was recorded."""
    answers = np.array([when for when, _ in plans]) if len(plans) else None
    if seen is None:
        return Functioning(None, np.empty(0, dtype=str), np.empty((0, 0), dtype=bool), np.inf, answers)
    return _listed(seen, np.unique(seen.t.to_numpy(dtype=float)), answers, findings.get(DELAY) or 0.0)


def _listed(seen: pd.DataFrame, lists: Floats, answers: Floats | None, delay: float) -> Functioning:
    """Lists of perceived objects from the rows of a table."""
    return _functioning(seen.t.to_numpy(dtype=float), seen.id.to_numpy(dtype=str), lists, answers, delay)


def _functioning(
    t: Floats, seen: Strings, lists: Floats, answers: Floats | None, delay: float
) -> Functioning:
    """Lists of perceived objects from when [s] who was seen (N,); parts of one object count as that one."""
    names, of = np.unique(seen, return_inverse=True)
    known = set(names.tolist())
    whole = np.array([whole_id(name, known) for name in names.tolist()], dtype=str)
    ids, row = np.unique(whole, return_inverse=True)
    row, at = row[of], np.searchsorted(lists, t)
    table = np.zeros((len(ids), len(lists)), dtype=bool)
    table[row, np.minimum(at, len(lists) - 1)] = True
    gaps = np.concatenate([np.diff(lists[o]) for o in table] or [np.diff(lists)])
    period = float(np.median(gaps)) if len(gaps) else np.inf
    return Functioning(lists, ids, table, period, answers, delay)
