"""An engine without a simulator: guided traffic is where it is commanded to be, which is what SUMO echoes."""

from __future__ import annotations

from collections.abc import Sequence

from resim.simulation.case import Case, SimulatedDrive
from resim.simulation.loop import drive
from resim.simulation.turn import turn


class Direct:
    """Traffic objects on their traces, the EGO in closed loop with the case's function; every byte as with SUMO."""

    name = "direct"

    def drive(self, cases: Sequence[Case], *, window: bool = False) -> list[SimulatedDrive]:
        """Drive cases (`resim.simulation.engine.Engine`); there is no window to look on by."""
        with turn():
            return drive(cases)
