"""`resim function`: whether a build does what resim asks of an AD function, and a server of one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from resim.core.errors import InputError
from resim.core.files import shipped
from resim.execution.workers import in_child
from resim.jobs.given import path_of
from resim.road.opendrive import load
from resim.simulation.function.conformance import SPEED, Check, conformance, repeated
from resim.simulation.function.conversation import read_conversation
from resim.simulation.function.interface import EgoState, load_build
from resim.simulation.function.program import RecordedProgram, refuse_unrecordable, served_program
from resim.simulation.function.relay import RelayServer


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


def check_function(build: str | Path, conversations: Sequence[str | Path] = ()) -> FunctionCheck:
    """Ask a function lists of a short drive, and say what holds: answers, units, determinism, clock, latency.

    Args:
        build: Build file.
        conversations: Recorded ones, to which a process is to answer the same.

    Returns:
        What was asked for, and what holds.

    Raises:
        ResimError: The build cannot be used, or a conversation not be read; or the build is no process.
    """
    return in_child(_checked, (path_of(build), [path_of(one) for one in conversations]))


def _checked(asked: tuple[Path, list[Path]]) -> FunctionCheck:
    path, files = asked
    build, recorded = load_build(path), {file.name: read_conversation(file) for file in files}
    if recorded:
        refuse_unrecordable(path, build.program)
        return FunctionCheck(build.label, tuple(repeated(build, *one) for one in recorded.items()))
    if isinstance(build.program, RecordedProgram):
        problem = (
            "is recorded: it answers the drive that it was recorded in, and no other that a check could ask"
        )
        raise InputError(path, problem, "Check the function itself, or re-simulate that drive with it.")
    return FunctionCheck(build.label, tuple(conformance(build, load(shipped() / MAP), START)))


def serve_function(build: str | Path, address: str, listens: Callable[[str], None]) -> None:
    """Serve a process build over gRPC until a signal ends the program: for each stream a process of its own.

    Args:
        build: Build file.
        address: host:port to listen on; port 0 is any that is free.
        listens: Called with the address once it is listened on.

    Raises:
        ResimError: The build cannot be used or is no process, grpcio is missing, or somebody else listens there.
    """
    path = path_of(build)
    server = RelayServer(served_program(path, load_build(path).program), address)
    server.start()
    listens(server.address)
    server.serve()
