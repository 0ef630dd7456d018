"""What mined.json says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from resim.mining.study import MinedPart

MARK = "mined.json"


@dataclass(frozen=True)
class MinedFailure:
    """A recording that could not be mined.

    Attributes:
        recording: Its name.
        folder: Where it was sought.
        why: What is wrong with it.
    """

    recording: str
    folder: str
    why: str


@dataclass(frozen=True)
class MiningReport:
    """A study of recordings, as `mined.json` says it.

    Attributes:
        version: Of resim.
        rules: Hash of the file of thresholds, "" for what ships.
        labels: That were looked for.
        trigger: What scenarios were cut out for.
        parts: What was found in each recording.
        failures: Recordings that could not be mined.
        egos: Who is the EGO: `every` vehicle once, or each recording's `own`.
    """

    version: str
    rules: str
    labels: list[str]
    trigger: list[str]
    parts: list[MinedPart]
    failures: list[MinedFailure]
    egos: Literal["every", "own"] = "every"
