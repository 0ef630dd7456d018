"""Learn a perception model: what `resim perception train` does."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from resim.core.errors import InputError
from resim.jobs.given import path_of, the_recording
from resim.perception.model import PerceptionModel, write_model
from resim.perception.training.train import train as train_model
from resim.perception.validation import cross_validate
from resim.recordings import Recording
from resim.report.perception import write_perception_page
from resim.results import MODEL, whole_file


def train(
    recordings: Sequence[str | Path | Recording],
    out: str | Path | None = None,
    *,
    report: str | Path | None = None,
    accept: Collection[str] = (),
    progress: Callable[[str], None] = lambda stage: None,
) -> PerceptionModel:
    """Learn a perception model from drives that were measured twice.

    Args:
        recordings: Recordings with GT and SD, or their folders.
        out: File (.json) for the model, whose name names it; None writes none.
        report: Page (.html) of how well it does on drives that it was not trained on; None writes none.
        accept: Codes of findings to continue despite.
        progress: Is told each stage as it begins: each recording, the training, each fold of the validation.

    Returns:
        The model, with confidence intervals and tests of its fit.

    Raises:
        InputError: A recording or a file to write cannot be used, or there are too few drives.
    """
    if report is not None and out is not None and path_of(report).absolute() == path_of(out).absolute():
        raise InputError("--report", "is the file of --out", "Give each its own.")
    if report is not None and len(recordings) < 2:
        raise InputError(
            "--report", "one drive cannot both train and validate a model", "Give two drives or more."
        )
    if out is not None and path_of(out).suffix != ".json":
        raise InputError(path_of(out), "is not a .json file", "Name a file that ends in .json with --out.")
    measured = []
    for number, one in enumerate(recordings, start=1):
        progress(f"read {number} of {len(recordings)}")
        measured.append(the_recording(one, accept))
    with contextlib.ExitStack() as files:
        file = None if out is None else files.enter_context(whole_file(path_of(out), MODEL))
        page = None if report is None else files.enter_context(whole_file(path_of(report)))
        progress("train")
        model = train_model(measured, name="model" if out is None else path_of(out).stem)
        if page is not None:
            write_perception_page(model, cross_validate(measured, progress=progress), page)
        if file is not None:
            write_model(model, file)
    return model
