"""Train maneuver kernels: what `resim vary train` does."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from resim import __version__
from resim.core.errors import InputError, ResimError
from resim.core.files import joined
from resim.core.geometry import Floats
from resim.core.spelling import counted
from resim.execution.child import Failure
from resim.execution.workers import run_all
from resim.jobs.given import path_of
from resim.jobs.mine import MiningResult, read_mined
from resim.mining.report import MARK
from resim.results import whole_file
from resim.results.folders import KERNELS
from resim.variations.evaluation import ENOUGH
from resim.variations.features import POINTS
from resim.variations.kernels import (
    COMPONENTS,
    KernelFile,
    KernelSource,
    ManeuverKernel,
    fit_kernel,
    write_kernels,
)
from resim.variations.likeness import Likeness, tell_apart, varied_traces, with_noise
from resim.variations.page.kernels import write_kernel_page
from resim.variations.swept import BOX
from resim.variations.training import (
    LONGEST,
    MOST,
    CuttingTask,
    RecordingTraces,
    chosen_maneuvers,
    pooled,
    traces_of,
    wanted_maneuvers,
)

LIMIT = 3600.0
"""s of wall clock for one recording."""


@dataclass(frozen=True)
class TrainOptions:
    """How kernels are trained.

    Attributes:
        components: How many of each kernel; fewer where there are not as many traces.
        error: Mean relative reconstruction error that decides about their number instead, None for `components`.
        least: Traces from which on there is a kernel of a maneuver.
        most: Traces of a maneuver that are taken at most, chosen evenly.
        longest: s; longer stretches of a lane are cut into equal parts.
        real: Whether you vouch that people drove in these recordings.
        workers: Processes; all cores, if None.
    """

    components: int = COMPONENTS
    error: float | None = None
    least: int = 30
    most: int = MOST
    longest: float = LONGEST
    real: bool = False
    workers: int | None = None


def train_kernels(
    mined: str | Path,
    out: str | Path,
    options: TrainOptions = TrainOptions(),
    *,
    report: str | Path | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> KernelFile:
    """Train a kernel for every maneuver of which there are enough traces.

    Args:
        mined: Folder that `resim mine` wrote; its recordings are read where they were.
        out: File (.json) for the kernels.
        options: How many components and traces.
        report: Page (.html) of the figures that show how good they are; None writes none.
        progress: Is told the name of each recording when it is read.

    Returns:
        The kernels.

    Raises:
        InputError: A recording cannot be read, there are too few traces of every maneuver, or `real` is claimed of a
            recording that resim made.
    """
    if path_of(out).suffix != ".json":
        raise InputError(path_of(out), "is not a .json file", "Name a file that ends in .json with --out.")
    study = read_mined(path_of(mined))
    found = []
    for one in maneuver_traces(study, options):
        progress(one.recording)
        if options.real and one.made:
            raise InputError(
                "--real", f"{one.recording} was made by a program ({one.source})", "Mine real drives alone."
            )
        found.append(one)
    kernels = fitted_kernels(found, options)
    if not kernels.kernels:
        told = (
            "; ".join(f"{name}: {why}" for name, why in kernels.not_made.items()) or "no maneuver was found"
        )
        raise InputError(path_of(mined), f"no kernel can be trained: {told}", "Mine more, or lower --least.")
    with whole_file(path_of(out), KERNELS) as beside:
        write_kernels(kernels, beside)
    if report is not None:
        with whole_file(path_of(report)) as beside:
            held = pooled(found)
            write_kernel_page(kernels, held, kernel_likeness(kernels, held), beside)
    return kernels


def kernel_likeness(
    kernels: KernelFile, found: Mapping[str, tuple[Floats, Floats]], box: float = BOX
) -> dict[str, tuple[Likeness, Likeness]]:
    """Try to tell variations of held-out traces from these, where there are enough.

    Args:
        kernels: The kernels.
        found: By maneuver the features that a kernel was trained on, and those held out.
        box: Share of each component's range by which each is varied, to either side.

    Returns:
        By maneuver how well variations are told, and how well planted noise is.
    """
    out = {}
    for name, kernel in kernels.kernels.items():
        held_out = found[name][1]
        if len(held_out) >= ENOUGH:
            measured, varied = varied_traces(kernel, held_out, box)
            noisy = with_noise(measured, np.random.default_rng(0))
            out[name] = tell_apart(measured, varied), tell_apart(measured, noisy)
    return out


def maneuver_traces(study: MiningResult, options: TrainOptions) -> Iterator[RecordingTraces]:
    """Give the traces of all recordings that were mined, in their order.

    Args:
        study: What `resim mine` wrote.
        options: How many traces, and how long.

    Returns:
        Recording by recording.

    Raises:
        ResimError: A recording cannot be read.
    """
    table: pd.DataFrame = study.maneuvers
    wanted = {part.recording: wanted_maneuvers(table, part.recording) for part in study.report.parts}
    taken = chosen_maneuvers(wanted, options.longest, options.most)
    where = Path(os.path.realpath(study.folder)) / MARK
    folders = {part.recording: joined(where, part.folder) for part in study.report.parts}
    tasks = [CuttingTask(folder, name, taken[name], options.longest) for name, folder in folders.items()]
    workers = min(options.workers or os.cpu_count() or 1, len(tasks))
    waiting: dict[int, RecordingTraces] = {}
    following = 0
    for place, one in run_all(traces_of, tasks, workers=workers, time_limit=LIMIT):
        if isinstance(one, Failure):
            raise ResimError(f"{tasks[place].name}: {one.reason}")
        waiting[place] = one
        while following in waiting:
            yield waiting.pop(following)
            following += 1


def fitted_kernels(found: Sequence[RecordingTraces], options: TrainOptions) -> KernelFile:
    """Fit a kernel for every maneuver of which there are enough traces.

    Args:
        found: The traces, by recording.
        options: How many components, and traces at least.

    Returns:
        The kernels.
    """
    kernels: dict[str, ManeuverKernel] = {}
    not_made: dict[str, str] = {}
    for label, (train, held_out) in pooled(found).items():
        if len(train) < options.least:
            not_made[label] = f"{counted(len(train), 'trace')} to train on, {options.least} are needed"
            continue
        kernels[label] = fit_kernel(
            label, train, held_out, components=options.components, error=options.error
        )
    sources = tuple(
        KernelSource(
            one.recording, one.hash, one.source, dict(sorted(Counter(one.label).items())), one.left_out
        )
        for one in found
    )
    return KernelFile(
        "resim-kernels-1", __version__, "real" if options.real else "synthetic", POINTS, options.longest, sources,
        kernels, not_made,
    )  # fmt: skip
