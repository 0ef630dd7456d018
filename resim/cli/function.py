"""`resim function`: functions that are brought along, and what they need."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from resim.cli.app import BadVerdictError, app, command
from resim.cli.inputs import A_BUILD
from resim.cli.terminal import add_to_json, say

functions = typer.Typer(
    help="AD functions: check one of your own, serve it, or build it.", no_args_is_help=True
)
app.add_typer(functions, name="function")


@command(functions, "check")
def check(
    build: Annotated[Path, typer.Argument(callback=A_BUILD, help="Build file (TOML).")],
    conversation: Annotated[
        list[Path] | None,
        typer.Option(help="What `resim run --record` recorded: whether a process answers the same."),
    ] = None,
) -> None:
    """Check that a function does what resim asks of it: answers, units, determinism, clock, latency, restart,
    malformed input.

    It is asked the lists of a short drive several times, or what was recorded. Ends with 1 where something does not
    hold.
    """
    from resim.jobs.function import check_function

    found = check_function(build, conversation or ())
    for one in found.checks:
        say(f"{'holds' if one.holds else 'FAILS'}  {one.name}: {one.found}")
    add_to_json(build=found.label, checks=found.checks)
    if not found.good:
        broken = ", ".join(one.name for one in found.checks if not one.holds)
        raise BadVerdictError(f"{found.label}: does not hold: {broken}")


@command(functions, "serve")
def serve(
    build: Annotated[Path, typer.Argument(callback=A_BUILD, help="Build file (TOML) with `[process]`.")],
    address: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="Where to listen; others reach 0.0.0.0, unencrypted.")
    ] = "127.0.0.1:50051",
) -> None:
    """Serve a process build over gRPC, as in a container: for each run that asks, a process of its own.

    Ends by a signal.
    """
    from resim.jobs.function import serve_function

    serve_function(build, address, lambda found: say(f"listens on {found}"))


@command(functions, "include")
def include() -> None:
    """Print the folder of the C++ header, for the compiler's -I."""
    folder = Path(__file__).parents[1] / "function"
    add_to_json(include=folder)
    say(str(folder))
