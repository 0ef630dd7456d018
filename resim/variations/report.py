"""What variations.json says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from resim.core.spec import EXACT

MARK = "variations.json"


@dataclass(frozen=True)
class VariationInputs:
    """What variations follow from.

    Attributes:
        recording: Name of the drive.
        recording_hash: Of its content.
        kernels: Name of their file.
        kernels_hash: Of it.
        data: Where the kernels' traces come from.
        maneuvers: What is varied, `object:label@start`.
        components: How many components each maneuver has.
        box: Share of each component's range, to either side.
        settings: All settings.
        verified: Hash of the verification that trust is judged by, "" without one.
    """

    recording: str
    recording_hash: str
    kernels: str
    kernels_hash: str
    data: Literal["real", "synthetic"]
    maneuvers: tuple[str, ...]
    components: tuple[int, ...]
    box: float
    settings: Mapping[str, object]
    verified: str


@dataclass(frozen=True)
class VariationReport:
    """What variations.json says of a folder of variations.

    Attributes:
        schema: Its kind.
        versions: Of all that they depend on.
        inputs: What they follow from.
        variations: How many there are.
        looked: How many points of the sequence were looked at.
        rejected: How many of them were left out, by reason.
        trust: How many variations have which trust.
        notes: What is to be known to use them.
        files: Hashes of all files.
    """

    __pydantic_config__ = EXACT

    schema: Literal["resim-variations-1"]
    versions: Mapping[str, str]
    inputs: VariationInputs
    variations: int
    looked: int
    rejected: Mapping[str, int]
    trust: Mapping[str, int]
    notes: tuple[str, ...]
    files: Mapping[str, str]
