"""A suite: the recordings that a build is verified on, by what, and how exactly; a TOML file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator

from resim.core import remedies
from resim.core.errors import InputError
from resim.core.files import joined, relative
from resim.core.spec import Strict, read_strict
from resim.core.spelling import did_you_mean
from resim.recordings.content import content_hash
from resim.recordings.listed import RecordingEntry, found_folders
from resim.scenario.varied import VARIED
from resim.simulation.reactive.settings import WithTraffic
from resim.verification.limits import RegressionLimits
from resim.verification.tolerance import Tolerances

EXAMPLE = remedies.SUITE


class SuiteFile(WithTraffic):
    """What a suite's file says; paths from the folder of the file.

    bases: what is re-simulated; seeds, seed: how many runs with the perception model at most, and the first one's seed.
    agreement: more than this share of the seeds must agree, as `SequentialTest` tells it. vary: parameters of which the
    range is searched in which the verdicts hold. accept: codes of findings to continue despite. driven_by: other
    builds whose recordings are taken. reports: of how many recordings that are not good there is a re-simulation
    report, the worst first. traffic, reactive: how traffic moves.
    """

    name: str = Field(min_length=1)
    recording: tuple[RecordingEntry, ...] = Field(min_length=1)
    criteria: str = Field(min_length=1)
    bases: tuple[Literal["GT", "SD"], ...] = Field(default=("GT", "SD"), min_length=1)
    perception: str | None = None
    seeds: int = Field(strict=True, default=200, ge=1, le=5000)
    seed: int = Field(strict=True, default=0, ge=0)
    agreement: float = Field(strict=True, default=0.9, ge=0.5, le=0.99)
    vary: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()
    driven_by: tuple[str, ...] = ()
    tolerances: Tolerances = Tolerances()
    limits: RegressionLimits = RegressionLimits()
    reports: int = Field(strict=True, default=10, ge=0)

    @field_validator("bases", "vary", "accept", "driven_by")
    @classmethod
    def _once(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"{twice[0]!r} is a duplicate")
        return names


class Suite(Strict):
    """A suite, with its recordings found: folders by name, and the hashes that they must have."""

    path: Path
    file: SuiteFile
    folders: dict[str, Path]
    hashes: dict[str, str]

    def beside(self, name: str) -> Path:
        """Give the path of what the file names."""
        return joined(self.path, name)


def read_suite(path: Path) -> Suite:
    """Read a suite and find its recordings. Raises InputError naming every fault."""
    file = read_strict(path, SuiteFile, EXAMPLE)
    _check_varied(path, "vary: ", file.vary)
    folders, hashes = found_folders(path, file.recording)
    return Suite(path=path, file=file, folders=folders, hashes=hashes)


def _check_varied(source: str | Path, field: str, names: Sequence[str]) -> None:
    if strange := [name for name in names if name not in VARIED]:
        problem = f"{field}there is no {strange[0]!r}{did_you_mean(strange[0], VARIED)}"
        raise InputError(source, problem, f"There are: {', '.join(VARIED)}.")


def check_call(perceives: bool, *, settings: Sequence[str], seeds: int | None, vary: Sequence[str]) -> None:
    """Raise InputError for options of `resim verify` that mean nothing. perceives: whether a model perceives."""
    if settings and not perceives:
        raise InputError("--set", f"{settings[0]!r} without a model", "Name one with --perception.")
    if seeds is not None and not perceives:
        raise InputError("--seeds", "are runs with a perception model", "Name one with --perception.")
    _check_varied("--vary", "", vary)


def new_suite(folders: Sequence[Path], criteria: Path, out: Path, name: str) -> str:
    """Give the text of a suite of these recordings, with their hashes, for a file at `out`. Raises InputError."""

    folder_of = out.absolute().parent
    entries = [
        f'[[recording]]\nfolder = {json.dumps(relative(folder, folder_of))}\nhash = "{content_hash(folder)}"\n'
        for folder in folders
    ]
    head = (
        f'name = {json.dumps(name)}\ncriteria = {json.dumps(relative(criteria, folder_of))}\nbases = ["GT", "SD"]\n'
        "seeds = 200  # with a perception model, at most\nagreement = 0.9  # more of the seeds than that\n\n"
    )
    return head + "\n".join(entries) + "\n" + tolerances_text()


def tolerances_text() -> str:
    """Give the tolerances that hold where a suite says nothing, as TOML."""
    held = Tolerances()
    lines = [
        "# Largest root mean square errors [m, m/s, rad]; reaction: of first braking [s].",
        "[tolerances]",
    ]
    lines.append(f"reaction = {held.reaction:g}")
    for step in ("sensor", "fit", "simulation", "vehicle", "pipeline"):
        for who in ("ego", "to"):
            limits = getattr(getattr(held, step), who).model_dump(exclude_none=True)
            if limits:
                lines.append(
                    f"{step}.{who} = {{ " + ", ".join(f"{k} = {v:g}" for k, v in limits.items()) + " }"
                )
    return "\n".join(lines) + "\n"
