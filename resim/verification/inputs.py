"""Everything that a verification follows from, as `inputs` of verification.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from resim.core.spec import EXACT, Strict
from resim.simulation.reactive.settings import ReactiveSettings
from resim.verification.limits import RegressionLimits
from resim.verification.tolerance import Tolerances


class HashedFile(Strict):
    """A file or folder, and the SHA-256 of what it held; None where it could not be read."""

    path: str
    hash: str | None


class NamedBuild(HashedFile):
    """A build, with its name and version."""

    label: str


class VerificationRequest(Strict):
    """Everything that a verification follows from; paths from the folder of verification.json."""

    name: str
    suite: HashedFile
    build: NamedBuild
    against: NamedBuild | None
    criteria: HashedFile
    perception: HashedFile | None
    settings: tuple[str, ...]
    seeds: tuple[int, ...]
    bases: tuple[Literal["GT", "SD"], ...]
    agreement: float = Field(ge=0.5, le=0.99)
    vary: tuple[str, ...]
    accept: tuple[str, ...]
    driven_by: tuple[str, ...]
    vehicle: str
    traffic: ReactiveSettings | None
    tolerances: Tolerances
    limits: RegressionLimits
    reports: int
    recordings: dict[str, HashedFile]
    wanted: dict[str, str] = Field(description="hashes that the suite expects")


@dataclass(frozen=True)
class VerificationBegun:
    """What inputs.json says, from the beginning on; files: that the verification may write into its folders."""

    __pydantic_config__ = EXACT

    versions: Mapping[str, str]
    inputs: VerificationRequest
    files: tuple[str, ...]
