"""What sweep.json and manifest.json say, as dataclasses: their fields are those of the files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import MISSING

from resim.core.schema import SweepSchema
from resim.core.spec import EXACT
from resim.sweeps.file import SweepBoundary
from resim.sweeps.sweep_file import SweepFile
from resim.verification.inputs import HashedFile, NamedBuild

SCHEMA: SweepSchema = "resim-sweep-1"


@dataclass(frozen=True)
class SweepInputs:
    """Everything that the results follow from: what the sweep's file says, and hashes; paths from the folder.

    builds: by what the file calls them; recordings: by name. kernels, verified: of variations, where there are any.
    """

    sweep: SweepFile
    vehicle: str
    criteria: HashedFile
    perception: HashedFile | None
    builds: Mapping[str, NamedBuild]
    recordings: Mapping[str, HashedFile]
    kernels: HashedFile | MISSING = MISSING
    verified: HashedFile | MISSING = MISSING


@dataclass(frozen=True)
class SweepBegun:
    """What sweep.json says, from the beginning on."""

    __pydantic_config__ = EXACT

    versions: Mapping[str, str]
    inputs: SweepInputs


@dataclass(frozen=True, kw_only=True)
class SweepManifest:
    """What manifest.json says of a finished sweep: how many runs it has, and the hashes of its table's parts.

    boundaries: of an adaptive plan, one a recording and build. columns: of the table.
    """

    __pydantic_config__ = EXACT

    schema: SweepSchema
    versions: Mapping[str, str]
    inputs: SweepInputs
    runs: int
    failed: int
    files: Mapping[str, str]
    boundaries: tuple[SweepBoundary, ...] | MISSING = MISSING
    columns: tuple[str, ...]

    def found(self) -> tuple[SweepBoundary, ...]:
        """Give the boundaries; none of a plan that does not look for them."""
        return () if self.boundaries is MISSING else self.boundaries
