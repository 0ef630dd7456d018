"""What a simulator is to resim: it drives a case."""

from __future__ import annotations

from typing import Protocol

from resim.simulation.case import Case, SimulatedDrive


class Engine(Protocol):
    """A simulator. SUMO (`resim.simulation.sumo.engine.Sumo`) is the first."""

    @property
    def name(self) -> str:
        """Give its name and version, which a case's hash holds."""

    def drive(self, case: Case, *, window: bool = False) -> SimulatedDrive:
        """Drive a case from its lead-in to its end; with `window` somebody may look on.

        Faults of the function end the drive (`SimulatedDrive.failure`); faults of the input raise ResimError.
        """
