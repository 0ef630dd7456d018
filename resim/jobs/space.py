"""The scenario space: what `resim space` does."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import pandas as pd

from resim.core.errors import InputError
from resim.core.spec import read_strict
from resim.jobs.given import path_of
from resim.recordings.tables import read_parquet
from resim.report.markup import Markup
from resim.report.notebook import notebook_html
from resim.results import SPACE, whole_folder
from resim.space.build import build_space, grow_space
from resim.space.folder import read_report, read_space, write_space
from resim.space.model import Space
from resim.space.page import write_space_page
from resim.space.report import SpaceReport
from resim.space.settings import DEFAULT_SETTINGS, SpaceSettings
from resim.space.sources import read_mined

EXAMPLE = "See docs/guides/space.md."


@dataclass(frozen=True)
class SpaceResult:
    """A scenario space. Shows itself in a notebook.

    Attributes:
        folder: Where it is.
        report: What space.json says.
    """

    folder: Path
    report: SpaceReport = field(repr=False)

    @cached_property
    def clusters(self) -> pd.DataFrame:
        """A row per scenario: bucket, cluster, whether it is its medoid, distance to the medoid."""
        return read_parquet(self.folder / "clusters.parquet")

    @cached_property
    def distances(self) -> pd.DataFrame:
        """A row per pair of scenarios of a bucket: bucket, one, two, distance."""
        return read_parquet(self.folder / "distances.parquet")

    def _repr_html_(self) -> str:
        told = f"{self.report.scenarios} scenarios in {len(self.report.clusters())} clusters"
        return notebook_html(told, Markup(), {"clusters": self.clusters})


def read_space_settings(file: str | Path) -> SpaceSettings:
    """Read how a space is built from a TOML file.

    Args:
        file: Its path.

    Returns:
        The settings; what the file does not say is as published.

    Raises:
        InputError: It is wrong.
    """
    return read_strict(path_of(file), SpaceSettings, EXAMPLE)


def build(
    mined: Sequence[str | Path],
    out: str | Path,
    settings: SpaceSettings = DEFAULT_SETTINGS,
    *,
    workers: int | None = None,
) -> SpaceResult:
    """Build a scenario space from what `resim mine` wrote.

    Args:
        mined: Folders that `resim mine` wrote.
        out: Folder to write; an earlier space there is replaced.
        settings: How scenarios are compared and clustered.
        workers: Threads; all cores, if None.

    Returns:
        The space.

    Raises:
        InputError: A folder is none of `resim mine`, or there is no scenario.
    """
    folders = [path_of(one) for one in mined]
    if not folders:
        raise InputError("MINED", "no folder is given", "Name a folder that `resim mine` wrote.")
    count = workers or os.cpu_count() or 1
    space = build_space([read_mined(one) for one in folders], settings, count)
    return _write(space, path_of(out), folders, count)


def grow(
    space: str | Path,
    mined: Sequence[str | Path],
    out: str | Path | None = None,
    *,
    workers: int | None = None,
) -> SpaceResult:
    """Put more drives into a space. Its clusters keep their names and medoids; the order of drives does not matter.

    Args:
        space: Folder of the space.
        mined: Folders that `resim mine` wrote.
        out: Folder to write; the space's own, if None.
        workers: Threads; all cores, if None.

    Returns:
        The grown space.

    Raises:
        InputError: A folder is none of `resim mine`, or is in the space already.
    """
    folders = [path_of(one) for one in mined]
    count = workers or os.cpu_count() or 1
    found, _ = read_space(path_of(space))
    grown = grow_space(found, [read_mined(one) for one in folders], count)
    return _write(grown, path_of(space if out is None else out), folders, count)


def read_result(folder: str | Path) -> SpaceResult:
    """Read a space.

    Args:
        folder: Its folder.

    Returns:
        The space.

    Raises:
        InputError: It is none, or was changed.
    """
    return SpaceResult(path_of(folder), read_report(path_of(folder)))


def _write(space: Space, out: Path, inputs: Sequence[Path], workers: int) -> SpaceResult:
    with whole_folder(out, SPACE, inputs) as beside:
        told = write_space(space, beside, workers)
        write_space_page(space, told, beside)
    return SpaceResult(out, told)
