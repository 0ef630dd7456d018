"""The engines that a sweep can have, and the proof that the direct one gives what SUMO gives."""

from __future__ import annotations

from collections.abc import Mapping

from resim.core.errors import ResimError
from resim.core.schema import Row
from resim.simulation.direct import Direct
from resim.simulation.engine import Engine
from resim.simulation.sumo.engine import Sumo
from resim.sweeps.sweep_file import EngineName

Fingerprint = Mapping[str, str]
"""Of a drive (`SimulatedDrive.fingerprint`)."""
ENGINES: Mapping[EngineName, Engine] = {"sumo": Sumo(), "direct": Direct()}

_DIGITS = 8
"""Of a case's hash by which it is drawn."""


def is_repeated(case: str, run: int, share: float) -> bool:
    """Say whether a run of the engine "direct" is repeated in SUMO: the first, and a share drawn by the case's hash."""
    return share > 0.0 and (run == 0 or int(case[:_DIGITS], 16) < share * 16.0**_DIGITS)


_WORDS = ("failure", "unpinned")
"""Columns that say something of a run in words."""


def what_differs(one: tuple[Fingerprint, Row], other: tuple[Fingerprint, Row]) -> str:
    """Give where a run and its repetition are not the same to the byte, drive and row; "" where they are.

    The words of a failure may differ: they can hold addresses; and what the code asked, which is not of the drive.
    """
    for mine, others in zip(one, other, strict=True):
        if list(mine) != list(others):
            return "which columns there are"
        differ = (name for name in mine if repr(mine[name]) != repr(others[name]) and name not in _WORDS)
        if name := next(differ, ""):
            return name
    return ""


class EnginesDifferError(ResimError):
    """A run is not the same with the engine direct and in SUMO."""


def refuse_difference(run: int, what: str) -> None:
    """Raise EnginesDifferError for a run whose repetition in SUMO differs in this; nothing for ""."""
    if what:
        raise EnginesDifferError(
            f"run {run} is not the same with the engine direct and in SUMO: {what} differs. Either the function does "
            "not answer the same to the same twice, or step and step_batch answer differently, or resim has a fault. "
            'engine = "sumo" simulates every run in SUMO.'
        )
