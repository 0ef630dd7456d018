"""What a job is given: an object, or the path of the file or folder that says it."""

from __future__ import annotations

import contextlib
from collections.abc import Collection
from pathlib import Path

from resim.core.errors import InputError
from resim.core.plugins.frozen import FrozenFile
from resim.metrics.criteria import Criteria, read_criteria
from resim.perception.model import PerceptionModel, freeze_model, read_model
from resim.recordings import Recording
from resim.resimulation import PerceptionSetup, load_checked
from resim.simulation.function.interface import Build, load_build

File = str | Path | FrozenFile
"""A file of the user's, or the frozen copy of one."""
SEEDS = 20
"""Runs with a perception model, if nothing else is said."""


def path_of(file: str | Path) -> Path:
    """Give a path.

    Args:
        file: A path.

    Returns:
        The same as a `Path`.
    """
    return file if isinstance(file, Path) else Path(file)


def the_recording(given: str | Path | Recording, accept: Collection[str]) -> Recording:
    """Give a recording, checked if it is read here.

    Args:
        given: A recording, or its folder.
        accept: Codes of findings to continue despite.

    Returns:
        The recording.

    Raises:
        InputError: It has errors that are not accepted.
    """
    return given if isinstance(given, Recording) else load_checked(path_of(given), accept=accept)


def the_build(given: File | Build) -> Build:
    """Give a build, loaded in the folder where the job began.

    Args:
        given: A build, or its file.

    Returns:
        The build.

    Raises:
        InputError: It cannot be loaded.
    """
    if isinstance(given, Build):
        return given
    with contextlib.chdir("."):
        return load_build(given if isinstance(given, FrozenFile) else path_of(given))


def the_criteria(given: File | Criteria | None) -> Criteria | None:
    """Give criteria, if any.

    Args:
        given: Criteria, or their file.

    Returns:
        The criteria.

    Raises:
        InputError: They cannot be read.
    """
    if given is None or isinstance(given, Criteria):
        return given
    with contextlib.chdir("."):
        return read_criteria(given if isinstance(given, FrozenFile) else path_of(given))


def the_perception(
    given: File | PerceptionModel | PerceptionSetup | None, first: int
) -> PerceptionSetup | None:
    """Give a perception model with its seeds, if any.

    Args:
        given: A model, its file, or a model with its seeds.
        first: First of the SEEDS seeds, where none are given.

    Returns:
        The model with its seeds.

    Raises:
        InputError: The model cannot be read.
    """
    seeds = tuple(range(first, first + SEEDS))
    if given is None or isinstance(given, PerceptionSetup):
        return given
    if isinstance(given, PerceptionModel):
        return PerceptionSetup(given, seeds)
    frozen = given if isinstance(given, FrozenFile) else freeze_model(path_of(given))
    return PerceptionSetup(read_model(frozen), seeds, hash=frozen.hash)


def refuse_without_sd(recording: Recording, bases: Collection[str]) -> None:
    """Refuse a recording without sensor data where only these are asked for.

    Args:
        recording: The recording.
        bases: What is to be re-simulated.

    Raises:
        InputError: It has no sensor data.
    """
    if "GT" not in bases and recording.sd is None:
        raise InputError(
            recording.folder or recording.name, "has no sensor data (sd.csv or sd.parquet)", "Re-simulate GT."
        )
