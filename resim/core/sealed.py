"""JSON that states the SHA-256 of all else that it says: who reads it back sees that it is as it was written."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from resim.core.errors import InputError
from resim.core.files import LARGEST_TEXT, parse_json, read_file

CHECKSUM = "checksum"


def sealed(content: Mapping[str, Any]) -> dict[str, Any]:
    """Give the same as JSON has it, with its checksum. Raises ValueError for what is no JSON."""
    read: dict[str, Any] = json.loads(json.dumps(content, allow_nan=False, default=dict))
    return {CHECKSUM: _sum(read), **read}


def read_sealed(path: Path, remedy: str, *, largest: int = LARGEST_TEXT) -> dict[str, Any]:
    """Give what such a file says, without its checksum; `remedy` is for errors.

    Raises InputError where it cannot be read, or is not as it was written.
    """
    found = parse_json(read_file(path, remedy, largest=largest), path, remedy)
    if not isinstance(found, dict) or not isinstance(told := found.pop(CHECKSUM, None), str):
        raise InputError(path, "was not written by resim (it has no checksum)", remedy)
    if told != _sum(found):
        raise InputError(path, "was changed after it was written: its checksum does not match", remedy)
    return found


def _sum(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
