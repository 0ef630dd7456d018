"""What a simulator is to resim: it drives cases."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from resim.core.geometry import Floats
from resim.simulation.case import Case, SimulatedDrive
from resim.simulation.function.interface import EgoState
from resim.simulation.reactive.deciders import Deciders
from resim.simulation.traffic import Phase


class Engine(Protocol):
    """What drives a case: with SUMO beside it (`simulation.sumo.engine`), or alone (`simulation.direct`)."""

    @property
    def name(self) -> str:
        """Give its name and version."""

    def drive(self, cases: Sequence[Case], *, window: bool = False) -> list[SimulatedDrive]:
        """Drive cases from their lead-in to their end; with `window` somebody may look on.

        They are alike in all but their perceptions and seeds; what each gives does not depend on the others. Faults of
        the function end its drive (`SimulatedDrive.failure`); faults of the input raise ResimError.
        """


class Mirror(Protocol):
    """A simulator beside a drive: told at every step where everybody is, it says where it has them."""

    def deciders(self) -> Deciders:
        """Give the simulator's own models, as drivers of objects that react."""

    def enter(self, phase: Phase) -> None:
        """Let objects come and go."""

    def advance(self, step: int, ego: EgoState, traffic: Floats | None) -> None:
        """Put everybody where they are at this step of the phase: the objects on their traces, or as `traffic` says.

        traffic: (4, n) x, y, heading, v of the objects of the phase.
        """

    def off(self, motion: Floats, steps: int) -> float:
        """Give how far [m] it had somebody from where it was told to. Raises ResimError where that is too far.

        motion: (6, N, T) x, y, heading, v, a, yaw rate of all, EGO first. steps: how many were taken.
        """
