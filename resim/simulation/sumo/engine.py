"""SUMO as an engine: libsumo in this process, sumo-gui for a window."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Sequence
from functools import cache

from resim.road.sumo import sumo_net
from resim.simulation.case import Case, SimulatedDrive
from resim.simulation.loop import drive
from resim.simulation.sumo.mirror import SumoMirror
from resim.simulation.sumo.session import held_session


class Sumo:
    """Traffic objects on their traces in SUMO, the EGO in closed loop with the case's function."""

    @property
    def name(self) -> str:
        """The name, and the version of SUMO."""
        return f"sumo {_version()}"

    def drive(self, cases: Sequence[Case], *, window: bool = False) -> list[SimulatedDrive]:
        """Drive cases (`resim.simulation.engine.Engine`), one by one."""
        return [self._driven(case, window=window) for case in cases]

    def _driven(self, case: Case, *, window: bool) -> SimulatedDrive:
        with held_session(sumo_net(case.network).simulated, case.step, gui=window) as session:
            return drive([case], lambda stage: SumoMirror(stage, case.network, session))[0]


@cache
def _version() -> str:
    return importlib.metadata.version("eclipse-sumo")
