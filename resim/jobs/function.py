"""`resim function check`: whether a build does what resim asks of an AD function."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from resim.core.files import shipped
from resim.execution.workers import in_child
from resim.jobs.given import path_of
from resim.road.opendrive import load
from resim.simulation.function.conformance import SPEED, Check, conformance
from resim.simulation.function.interface import EgoState, load_build


@dataclass(frozen=True)
class FunctionCheck:
    """What holds of a build.

    Attributes:
        label: Name and version of the build.
        checks: What was asked for, in order.
    """

    label: str
    checks: tuple[Check, ...]

    @property
    def good(self) -> bool:
        """Whether all of it holds."""
        return all(check.holds for check in self.checks)


MAP, START = "networks/proving_ground.xodr", EgoState(200.0, -5.25, 0.0, SPEED)
"""Where the drive is: the map that ships, and a lane of it that is straight for more than the drive's 160 m."""


def check_function(build: str | Path) -> FunctionCheck:
    """Ask a function lists of a short drive, and say what holds: answers, units, determinism, clock, latency.

    Args:
        build: Build file.

    Returns:
        What was asked for, and what holds.

    Raises:
        InputError: The build cannot be used.
    """
    return in_child(_checked, path_of(build))


def _checked(path: Path) -> FunctionCheck:
    build = load_build(path)
    return FunctionCheck(build.label, tuple(conformance(build, load(shipped() / MAP), START)))
