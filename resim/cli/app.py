"""The command line. Results go to standard output, progress and errors to standard error.

Exit code 0: done; 1: done, and the verdict is bad; 2: the input or the call is wrong.
"""

from __future__ import annotations

import signal
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from resim import __version__
from resim.core.errors import ResimError

app = typer.Typer(
    help="Put a measured test drive back into simulation, with the same AD function at the wheel, "
    "and see what every step did to it.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


class _FirstByDefault(TyperGroup):
    """`resim assess FOLDER` is `resim assess drive FOLDER`: the command that was added first stands for all."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the command in front where none is named."""
        first = next(iter(self.commands))
        return super().parse_args(ctx, args if args and args[0] in self.commands else [first, *args])


assess_app = typer.Typer(cls=_FirstByDefault, rich_markup_mode=None)
app.add_typer(
    assess_app, name="assess", help="How dangerous was a drive, when, because of whom, and does it pass?"
)


sweep_app = typer.Typer(cls=_FirstByDefault, rich_markup_mode=None)
app.add_typer(
    sweep_app, name="sweep", help="How late, how wrong, how blind may perception be? Thousands of runs."
)


Accept = Annotated[
    list[str] | None,
    typer.Option(metavar="CODE", help="Go on in spite of findings of this code; may be given several times."),
]
"""Errors in spite of which a command goes on."""


class BadVerdictError(Exception):
    """The job is done and its verdict is bad: exit code 1."""


@app.callback(invoke_without_command=True)
def _top(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        typer.echo(f"resim {__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command line."""
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))  # what runs is ended, too
    try:
        app(standalone_mode=True)
    except BadVerdictError as e:
        typer.echo(f"resim: {e}", err=True)
        sys.exit(1)
    except ResimError as e:
        typer.echo(f"resim: {e}", err=True)
        sys.exit(2)
