"""What a unit says by its logger: told on the standard error, and its last complaint beside the call that fails."""

from __future__ import annotations

import ctypes
import sys
from typing import Any

STATUSES = ("OK", "warning", "discard", "error", "fatal", "pending")
"""Of FMI 2 and 3, by their numbers."""


class UnitLog:
    """Hears a unit of FMPy.

    Attributes:
        complaint: The last message whose status was not OK, "" before there is one.
    """

    def __init__(self) -> None:
        self.complaint = ""

    def hear(self, status: int, message: bytes | None) -> None:
        """Tell a message, of a status of FMI."""
        text = " ".join((message or b"").decode("utf-8", "replace").split())
        name = STATUSES[status] if 0 <= status < len(STATUSES) else f"status {status}"
        print(f"the unit, {name}: {text}", file=sys.stderr)
        if status and text:
            self.complaint = text

    def instantiate(self, unit: Any, version: int) -> None:
        """Make the instance of a unit of FMI 2 or 3, and hear it. Raises RuntimeError where it makes none."""
        given: dict[str, Any]
        given = {"callbacks": self._callbacks()} if version == 2 else {"logMessage": self._hear3}
        try:
            unit.instantiate(**given)
        except Exception as e:  # FMPy raises no narrower one
            raise RuntimeError(f"the unit made no instance{self.said()}") from e

    def raise_failures(self, unit: Any) -> None:
        """Make every call of a unit raise RuntimeError for a status other than OK or warning, with the last complaint.

        FMPy raises for those above warning alone, and would take what is below 0 for good.
        """
        from fmpy.fmi1 import FMICallException

        call = unit._call

        def checked(name: str, *given: Any) -> Any:
            try:
                told = call(name, *given)
            except FMICallException as e:
                label = STATUSES[e.status] if e.status < len(STATUSES) else "which FMI does not know"
                raise RuntimeError(f"{name} gave the status {e.status} ({label}){self.said()}") from None
            if unit._functions[name].restype is ctypes.c_int and told < 0:
                raise RuntimeError(f"{name} gave the status {told}, which FMI does not know{self.said()}")
            return told

        unit._call = checked

    def said(self) -> str:
        """Give the complaint as the end of a sentence."""
        return f"; the unit says: {self.complaint}" if self.complaint else ""

    def _hear3(self, environment: Any, status: int, category: bytes, message: bytes | None) -> None:
        self.hear(status, message)

    def _callbacks(self) -> Any:
        """What a unit of FMI 2 calls; messages come with their arguments put in by a library of FMPy's."""
        from fmpy import calloc, fmi2, free
        from fmpy.logging import addLoggerProxy

        told = fmi2.fmi2CallbackFunctions()
        told.logger = fmi2.fmi2CallbackLoggerTYPE(
            lambda component, instance, status, category, message: self.hear(status, message)
        )
        told.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
        told.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
        addLoggerProxy(ctypes.byref(told))
        return told
