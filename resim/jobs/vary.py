"""Vary a drive around what was measured: what `resim vary` does."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import pandas as pd

from resim.core.errors import InputError, ResimError
from resim.core.files import file_hash
from resim.core.provenance import versions
from resim.core.sealed import sealed
from resim.core.spec import read_sealed_json, to_json
from resim.execution.child import Failure
from resim.execution.workers import run_all
from resim.jobs.given import path_of
from resim.recordings import Recording
from resim.recordings.checked import load_checked
from resim.recordings.content import content_hash
from resim.recordings.tables import read_parquet
from resim.resimulation import AssessmentOptions, assess_recording
from resim.resimulation.run import prepare
from resim.results import whole_folder, write_json, write_parquet
from resim.results.folders import VARIATIONS
from resim.scenario.jscen import write_jscen
from resim.scenario.scenario import Scenario
from resim.variations.kernels import read_kernels
from resim.variations.origin import NamedManeuver, the_origin, varied_maneuvers
from resim.variations.page.variations import write_variation_page
from resim.variations.report import MARK, VariationInputs, VariationReport
from resim.variations.rows import OriginNames, file_name, rejected_frame, variation_frame
from resim.variations.search import (
    CHUNK,
    FoundVariation,
    VariationPlan,
    VariationTask,
    dimensions,
    look,
    search,
)
from resim.variations.settings import VariationSettings
from resim.variations.trust import UNVERIFIED, Trust, judged_trust
from resim.verification.entries import VerifiedRecording
from resim.verification.folder import read as read_verification
from resim.verification.validity_interval import ValidityInterval
from resim.verification.validity_runs import critical

TRIES = 20
"""Points that are looked at for each variation, at most."""
LIMIT = 600.0
"""s of wall clock for a stretch of points."""
SCENARIOS = "scenarios"
REMEDY = "Vary the recording again."


@dataclass(frozen=True)
class VaryOptions:
    """What is varied, and by how much.

    Attributes:
        objects: Ids of the objects; none for the most critical one.
        labels: Which of their maneuvers; none for all that there is a kernel of.
        settings: By how much, and what no variation may do.
        verified: verification.json of `resim verify --vary`, by which trust is judged.
        accept: Codes of findings to continue despite.
        write: Whether each variation is written as a JSCEN file.
        workers: Processes; all cores, if None.
    """

    objects: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()
    settings: VariationSettings = field(default_factory=VariationSettings)
    verified: str | Path | None = None
    accept: tuple[str, ...] = ()
    write: bool = True
    workers: int | None = None


@dataclass(frozen=True)
class Variations:
    """A folder of variations.

    Attributes:
        folder: Where they are.
        report: What variations.json says.
    """

    folder: Path
    report: VariationReport = field(repr=False)

    @cached_property
    def table(self) -> pd.DataFrame:
        """A row a variation, as `resim.variations.rows.VARIATION_COLUMNS` says."""
        return read_parquet(self.folder / "variations.parquet")


def vary(
    recording: str | Path,
    kernels: str | Path,
    out: str | Path,
    *,
    count: int,
    options: VaryOptions = VaryOptions(),
    progress: Callable[[int], None] = lambda kept: None,
) -> Variations:
    """Make variations of a drive that a human could have driven, near it.

    Args:
        recording: Its folder.
        kernels: File that `resim vary train` wrote.
        out: Folder for variations.parquet, the scenarios and the page.
        count: How many; the first ones are the same for any count.
        options: What is varied, and by how much.
        progress: Hears how many there are so far.

    Returns:
        The variations.

    Raises:
        InputError: An input is wrong, there is nothing to vary, or too many points are rejected.
    """
    folder, target = path_of(recording), path_of(out)
    if count < 1:
        raise InputError("--count", f"expected 1 or more, found {count}")
    given = [folder, path_of(kernels)] + ([] if options.verified is None else [path_of(options.verified)])
    with whole_folder(target, VARIATIONS, given) as beside:
        measured = load_checked(folder, accept=options.accept)
        plan = make_plan(measured, folder, path_of(kernels), options)
        found = _found(plan, count, options.workers, progress)
        report = _write(beside, measured, plan, found, path_of(kernels), options)
    return Variations(target, report)


def read_variations(folder: str | Path) -> Variations:
    """Read what `resim vary` wrote.

    Args:
        folder: Its folder.

    Returns:
        The variations.

    Raises:
        InputError: It is none, or was changed.
    """
    where = path_of(folder)
    return Variations(where, read_sealed_json(where / MARK, VariationReport, "resim vary", REMEDY))


def make_plan(recording: Recording, folder: Path, kernels: Path, options: VaryOptions) -> VariationPlan:
    """Say what is varied, before anything is.

    Args:
        recording: The drive.
        folder: Where it was read.
        kernels: File of kernels.
        options: What is asked for.

    Returns:
        The plan, by which any process makes the same variations.

    Raises:
        InputError: There is nothing to vary.
    """
    known = read_kernels(kernels)
    prepared = prepare(recording, (), options.accept)
    scenario = prepared.described["GT"]
    every = varied_maneuvers(recording, known, scenario)
    objects = options.objects or (_critical(recording),)
    wanted = tuple(
        one for one in every if one.object in objects and (not options.labels or one.label in options.labels)
    )
    if not wanted:
        _refuse(folder, scenario, objects, every, options)
    the_origin(scenario, prepared.network, known, wanted)
    return VariationPlan(
        folder,
        content_hash(folder),
        options.accept,
        scenario,
        known,
        file_hash(kernels),
        wanted,
        options.settings,
    )


def _critical(recording: Recording) -> str:
    """The object of the largest risk: that which `resim verify --vary` varies."""
    return critical(assess_recording(recording, AssessmentOptions()).blocks["GT"])


def _refuse(
    folder: Path,
    scenario: Scenario,
    objects: Sequence[str],
    every: Sequence[NamedManeuver],
    options: VaryOptions,
) -> None:
    """Say why there is nothing to vary. Raises InputError."""
    ids = {one.id for one in scenario.objects}
    if strange := [name for name in objects if name not in ids]:
        raise InputError(folder, f"has no traffic object {strange[0]!r}", f"It has {', '.join(sorted(ids))}.")
    told = ", ".join(str(one) for one in every[:8]) or "none"
    what = " or ".join(options.labels) or "maneuver that there is a kernel of"
    raise InputError(folder, f"object {', '.join(objects)} has no {what}", f"There are kernels for: {told}.")


def _found(
    plan: VariationPlan, count: int, workers: int | None, progress: Callable[[int], None]
) -> list[FoundVariation]:
    """All points in order until `count` are kept. Raises InputError where too many are rejected."""
    most, found, kept = TRIES * count + 100, list[FoundVariation](), 0
    processes = min(workers or os.cpu_count() or 1, max(count // CHUNK, 1))
    for one in search(plan, count, lambda tasks: _ordered(tasks, processes), most):
        found.append(one)
        kept += not one.rejected
        progress(kept)
    if kept < count:
        why = ", ".join(f"{n} {reason}" for reason, n in Counter(one.rejected for one in found).most_common())
        problem = f"of {len(found)} points {kept} are kept: {why}"
        raise InputError(plan.folder, problem, "Take a smaller box, or allow what is rejected.")
    return found


def _ordered(tasks: Sequence[VariationTask], workers: int) -> Iterator[list[FoundVariation]]:
    """Results in the tasks' order. Raises ResimError for what a process could not do."""
    if workers == 1:
        yield from map(look, tasks)
        return
    waiting: dict[int, list[FoundVariation]] = {}
    following = 0
    for place, one in run_all(look, tasks, workers=workers, time_limit=LIMIT):
        if isinstance(one, Failure):
            raise ResimError(one.reason)
        waiting[place] = one
        while following in waiting:
            yield waiting.pop(following)
            following += 1


def verified_ranges(file: Path, digest: str) -> tuple[ValidityInterval, ...]:
    """Give what `resim verify --vary` found for a recording.

    Args:
        file: Its verification.json.
        digest: Hash of the recording's content.

    Returns:
        The ranges; none where the recording is not verified there.

    Raises:
        InputError: The file is none.
    """
    report = read_verification(file)
    for one in report.recordings:
        if isinstance(one, VerifiedRecording) and one.hash == digest and one.verdict == "verified":
            return one.validity
    return ()


def _trust(plan: VariationPlan, found: Sequence[FoundVariation], options: VaryOptions) -> list[Trust]:
    kept = [one.drive for one in found if not one.rejected and one.drive is not None]
    if options.verified is None:
        return [UNVERIFIED] * len(kept)
    ranges = verified_ranges(path_of(options.verified), plan.hash)
    if not ranges:
        return [Trust("unknown", "the verification has no range of this recording")] * len(kept)
    from resim.road.opendrive import load

    measured = load_checked(plan.folder, accept=plan.accept)
    origin = the_origin(plan.scenario, load(measured.map), plan.kernels, plan.maneuvers)
    return [judged_trust(origin.motions, one.motions, ranges) for one in kept]


def _write(
    folder: Path, measured: Recording, plan: VariationPlan, found: list[FoundVariation], kernels: Path,
    options: VaryOptions,
) -> VariationReport:  # fmt: skip
    """Write tables, scenarios, page and report into an empty folder."""
    trust = _trust(plan, found, options)
    names = OriginNames(measured.name, plan.hash, plan.varied, tuple(str(one) for one in plan.maneuvers))
    frame = variation_frame(found, trust, names, SCENARIOS if options.write else "")
    write_parquet(frame, folder / "variations.parquet")
    write_parquet(rejected_frame(found), folder / "rejected.parquet")
    if options.write:
        _write_scenarios(folder / SCENARIOS, measured.map, plan.scenario, found)
    counts, discrete = dimensions(plan)
    inputs = VariationInputs(
        measured.name, plan.hash, kernels.name, plan.kernels_hash, plan.kernels.data, names.maneuvers,
        tuple(plan.kernels.kernels[one.label].count for one in plan.maneuvers), plan.settings.box,
        plan.settings.model_dump(mode="json"),
        "" if options.verified is None else file_hash(path_of(options.verified)),
    )  # fmt: skip
    write_variation_page(folder / "variations.html", inputs, plan, found, frame)
    files = {
        path.relative_to(folder).as_posix(): file_hash(path)
        for path in sorted(folder.rglob("*")) if path.is_file()
    }  # fmt: skip
    report = VariationReport(
        "resim-variations-1", versions(), inputs, len(frame), len(found),
        dict(Counter(one.rejected for one in found if one.rejected).most_common()),
        dict(Counter(one.level for one in trust).most_common()), tuple(_notes(plan, counts + discrete)), files,
    )  # fmt: skip
    write_json(sealed(to_json(report)), folder / MARK)
    return report


def _notes(plan: VariationPlan, dimensions: int) -> Iterator[str]:
    if plan.kernels.data != "real":
        yield "the kernels come from synthetic drives: nothing is claimed of how humans drive"
    yield f"{dimensions} dimensions are varied together"


def _write_scenarios(folder: Path, road: Path, origin: Scenario, found: Sequence[FoundVariation]) -> None:
    """Write the origin and its variations as JSCEN files beside a copy of the map."""
    folder.mkdir()
    shutil.copyfile(road, folder / road.name)
    write_jscen(replace(origin, map=road.name), folder / "origin.jscen.json")
    kept = [one.drive for one in found if not one.rejected and one.drive is not None]
    for number, drive in enumerate(kept, start=1):
        write_jscen(replace(drive.scenario, map=road.name), folder / file_name(number))
