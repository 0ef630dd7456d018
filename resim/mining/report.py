"""What mined.json says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from resim.core.spec import EXACT
from resim.mining.study import MinedPart

MARK = "mined.json"


@dataclass(frozen=True)
class MinedFailure:
    """A recording that could not be mined.

    Attributes:
        recording: Its name.
        folder: Where it was sought, seen from the study's folder.
        why: What is wrong with it.
    """

    recording: str
    folder: str
    why: str


@dataclass(frozen=True)
class MiningReport:
    """A study of recordings, as `mined.json` says it.

    Attributes:
        versions: Of what wrote it.
        rules: Hash of the file of thresholds, "" for what ships.
        labels: That were looked for.
        trigger: What scenarios were cut out for.
        parts: What was found in each recording.
        failures: Recordings that could not be mined.
        files: SHA-256 of the tables.
        egos: Who is the EGO: `every` vehicle once, or each recording's `own`.
    """

    versions: Mapping[str, str]
    rules: str
    labels: list[str]
    trigger: list[str]
    parts: list[MinedPart]
    failures: list[MinedFailure]
    files: Mapping[str, str]
    egos: Literal["every", "own"] = "every"

    __pydantic_config__ = EXACT
