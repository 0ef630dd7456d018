"""What pydantic finds wrong with a user's file, in words."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pydantic_core import ErrorDetails


def describe(faults: Iterable[ErrorDetails]) -> str:
    """Give every fault: field, what was expected, and the value where it is a plain one."""
    return "; ".join(map(_said, faults))


def _said(fault: ErrorDetails) -> str:
    found: Any = fault["input"]
    told = f", found {found!r:.60}" if isinstance(found, str | int | float) else ""
    return f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}{told}"
