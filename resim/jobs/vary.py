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
from resim.core.files import check_hashes, file_hash
from resim.core.provenance import versions
from resim.core.sealed import sealed
from resim.core.spec import read_sealed_json, to_json
from resim.execution.child import Failure
from resim.execution.workers import run_all
from resim.jobs.given import path_of
from resim.recordings import Recording
from resim.recordings.checked import load_checked
from resim.recordings.tables import read_parquet
from resim.results import whole_folder, write_json, write_parquet
from resim.results.folders import VARIATIONS
from resim.road.opendrive import load
from resim.scenario.jscen import write_jscen
from resim.scenario.scenario import Scenario
from resim.variations.evaluation import of_humans
from resim.variations.origin import the_origin
from resim.variations.page.variations import write_variation_page
from resim.variations.plan import make_plan, verified_for, verified_ranges
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
from resim.variations.settings import VariationSettings, WhatVaries
from resim.variations.trust import UNVERIFIED, Trust, judged_trust

TRIES = 20
"""Points that are looked at for each variation, at most."""
LIMIT = 600.0
"""s of wall clock for a stretch of points."""
SCENARIOS, ORIGIN = "scenarios", "origin.jscen.json"
REMEDY = "Vary the recording again."


@dataclass(frozen=True)
class VaryOptions:
    """What is varied, and by how much.

    Attributes:
        what: Which objects, and which of their maneuvers.
        settings: By how much, and what no variation may do.
        verified: verification.json of `resim verify --vary`, by which trust is judged.
        write: Whether each variation is written as a JSCEN file.
        workers: Processes; all cores, if None.
    """

    what: WhatVaries = field(default_factory=WhatVaries)
    settings: VariationSettings = field(default_factory=VariationSettings)
    verified: str | Path | None = None
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
        measured = load_checked(folder, accept=options.what.accept)
        plan = make_plan(measured, path_of(kernels), options.what, options.settings)
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
    report = read_sealed_json(where / MARK, VariationReport, "resim vary", REMEDY)
    check_hashes(where, report.files, REMEDY)
    return Variations(where, report)


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
        counts = Counter(one.rejected for one in found if one.rejected)
        why = ", ".join(f"{n} {reason}" for reason, n in counts.most_common())
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


def _trust(
    plan: VariationPlan, found: Sequence[FoundVariation], measured: Recording, options: VaryOptions
) -> list[Trust]:
    kept = [(one.drive, _other(one)) for one in found if not one.rejected and one.drive is not None]
    if options.verified is None:
        return [UNVERIFIED] * len(kept)
    ranges = verified_ranges(path_of(options.verified), plan.hash)
    if not ranges:
        return [Trust("unknown", "the verification has no range of this recording")] * len(kept)
    origin = the_origin(plan.scenario, load(measured.map), plan.kernels, plan.maneuvers)
    return [judged_trust(origin.motions, one.motions, ranges, other) for one, other in kept]


def _other(one: FoundVariation) -> str:
    """What is not as in the origin beside how objects move, "" for nothing."""
    sizes = [f"object {name} is a {kind} of {length:g} m" for name, kind, length, _ in one.sizes]
    return "; ".join([*sizes, *(["its weather is another one"] if one.environment else [])])


def _write(
    folder: Path, measured: Recording, plan: VariationPlan, found: list[FoundVariation], kernels: Path,
    options: VaryOptions,
) -> VariationReport:  # fmt: skip
    """Write tables, scenarios, page and report into an empty folder."""
    trust = _trust(plan, found, measured, options)
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
        dict(Counter(one.level for one in trust).most_common()), tuple(_notes(plan, counts + discrete, options)), files,
    )  # fmt: skip
    write_json(sealed(to_json(report)), folder / MARK)
    return report


def _notes(plan: VariationPlan, dimensions: int, options: VaryOptions) -> Iterator[str]:
    yield from of_humans(plan.kernels, [one.label for one in plan.maneuvers])
    yield f"{dimensions} dimensions are varied together"
    if options.verified is not None:
        yield f"trust holds for {verified_for(path_of(options.verified))} alone"


def _write_scenarios(folder: Path, road: Path, origin: Scenario, found: Sequence[FoundVariation]) -> None:
    """Write the origin and its variations as JSCEN files beside a copy of the map."""
    folder.mkdir()
    shutil.copyfile(road, folder / road.name)
    write_jscen(replace(origin, map=road.name), folder / ORIGIN)
    kept = [one.drive for one in found if not one.rejected and one.drive is not None]
    for number, drive in enumerate(kept, start=1):
        write_jscen(replace(drive.scenario, map=road.name), folder / file_name(number))
