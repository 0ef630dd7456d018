"""The command line, and the options of every command. Results go to standard output, progress and errors to standard
error.

Exit code 0: done; 1: done, and the verdict is bad; 2: the input or the call is wrong; 3: the function under test
failed.
"""

from __future__ import annotations

import inspect
import io
import os
import signal
import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NoReturn, TypeVar

import typer
from typer.core import TyperGroup

from resim import __version__
from resim.cli.parameters import noted
from resim.cli.terminal import OutputSettings, output_as, say
from resim.core.errors import FunctionError, InputError, ResimError, StopError
from resim.core.files import refuse_undecodable
from resim.core.spelling import unknown
from resim.simulation.vehicles.registry import VEHICLES

Job = TypeVar("Job", bound=Callable[..., None])

app = typer.Typer(
    help="Put a measured test drive back into simulation, with the same AD function at the wheel, "
    "and see what every step did to it.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


class _FirstByDefault(TyperGroup):
    """`resim assess FOLDER` is `resim assess drive FOLDER`: the command that was added first stands for all."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the command in front where none is named."""
        if ctx.resilient_parsing and not args:  # the shell completes the command itself
            return super().parse_args(ctx, args)
        first = next(iter(self.commands))
        return super().parse_args(ctx, args if args and args[0] in self.commands else [first, *args])


assess_app = typer.Typer(cls=_FirstByDefault, rich_markup_mode=None)
app.add_typer(
    assess_app,
    name="assess",
    help="Rate the danger of each moment of a drive, name the objects, and judge the drive by criteria.",
)


sweep_app = typer.Typer(cls=_FirstByDefault, rich_markup_mode=None)
app.add_typer(
    sweep_app, name="sweep", help="Sweep perception errors and other parameters over thousands of runs."
)


vary_app = typer.Typer(cls=_FirstByDefault, rich_markup_mode=None)
app.add_typer(
    vary_app, name="vary", help="Make neighbours of a measured drive that a human could have driven."
)

Accept = Annotated[
    list[str] | None,
    typer.Option(
        metavar="CODE", help="Continue despite findings with this code; may be given several times."
    ),
]
"""Errors despite which a command continues."""
Labels = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Thresholds and own labels (TOML); default: scenarios/mining/labels.toml."
    ),
]
"""Which maneuvers are looked for, and how."""


class DecidingSource(StrEnum):
    """What is judged by criteria."""

    gt = "GT"
    sd = "SD"
    resimulated_gt = "rGT"
    resimulated_sd = "rSD"
    perceived = "rGT+M"


Deciding = Annotated[
    list[DecidingSource] | None,
    typer.Option(
        "--verdict-of",
        help="Whose verdict on the criteria is the command's; may be given several times. Default: of all that was "
        "simulated, or else measured.",
        show_default=False,
    ),
]
"""Which sources decide about the exit code."""

Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the model, such as latency.speed=0.4."),
]
"""Parameters of a perception model that take the place of the file's."""


def unknown_vehicle(name: str) -> str:
    """Say which vehicle models there are where none has this name, else ""."""
    return "" if name in VEHICLES else unknown("vehicle model", name, VEHICLES)


def _vehicle(context: typer.Context, name: str | None) -> str | None:
    """Look whether there is such a vehicle model before anything is imported that takes time. Raises InputError."""
    if name is not None and not context.resilient_parsing and (problem := unknown_vehicle(name)):
        raise InputError("--vehicle", problem)
    return name


def _vehicles(incomplete: str) -> list[str]:
    """The vehicle models that the shell offers."""
    return [name for name in VEHICLES if name.startswith(incomplete)]


def vehicle_option(words: str, default: str | None = None) -> Any:
    """Give the option that names the EGO's vehicle model, which the shell completes."""
    return typer.Option(
        metavar="MODEL",
        callback=_vehicle,
        autocompletion=_vehicles,
        help=words,
        show_default=default or True,
    )


VEHICLE_HELP = f"Vehicle model of the EGO, one of: {', '.join(VEHICLES)}."
Vehicle = Annotated[str, vehicle_option(VEHICLE_HELP)]
"""Which model (`resim.simulation.vehicles.registry.VEHICLES`) moves the EGO."""

Workers = Annotated[int | None, typer.Option(min=1, help="Processes; default: all cores.")]
"""In how many processes a command works."""


AsJson = Annotated[bool, typer.Option("--json", help="Print the results as JSON.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors and bad verdicts only.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Print each step, and where in resim an error arose.")
]


def command(group: typer.Typer, name: str | None = None, **options: Any) -> Callable[[Job], Job]:
    """Register a command under a name, with the options that all commands have."""

    def register(job: Job) -> Job:
        own = inspect.signature(job, eval_str=True).parameters.values()
        shared = [
            inspect.Parameter(word, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
            for word, kind in (("as_json", AsJson), ("quiet", Quiet), ("verbose", Verbose))
        ]

        def told(*, context: typer.Context, as_json: bool, quiet: bool, verbose: bool, **given: Any) -> None:
            with output_as(OutputSettings(as_json, quiet, verbose)), noted(job, given, context):
                job(**given)

        called = inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)
        parameters = [called, *(p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in own), *shared]
        told.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        told.__annotations__ = {p.name: p.annotation for p in parameters}
        told.__name__, told.__doc__ = job.__name__, job.__doc__
        group.command(name, **options)(told)
        return job

    return register


class BadVerdictError(Exception):
    """The job is done and its verdict is bad: exit code 1."""


@app.callback(invoke_without_command=True)
def _top(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        say(f"resim {__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command line."""
    os.environ.setdefault(
        "OMP_NUM_THREADS", "1"
    )  # before numpy: threads of BLAS get in the way of other processes
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # as with nohup
            signal.signal(number, _stop)
    _open_streams()
    try:
        for name in sys.argv[1:]:
            refuse_undecodable(name)
        app(standalone_mode=True)
    except (BadVerdictError, ResimError) as e:
        say(f"resim: {e}", err=True)
        sys.exit(1 if isinstance(e, BadVerdictError) else 3 if isinstance(e, FunctionError) else 2)
    except OSError as e:
        if e.filename is None:
            _untold(f"does not accept the whole output ({e.strerror})")
        say(f"resim: {e}", err=True)
        sys.exit(2)
    except SystemExit as e:
        if isinstance(e.__context__, BrokenPipeError):
            _untold("was closed before the whole output was written")
        raise
    finally:
        _flush()


def _stop(number: int, frame: object) -> None:
    """End the command and all that it started, as somebody asked by a signal."""
    raise StopError(128 + number)


def _open_streams() -> None:
    """Make sure that no file that is opened later becomes the standard input, output or error."""
    closed = sys.stdout is None
    while (number := os.open(os.devnull, os.O_RDWR)) < 3:
        pass
    os.close(number)
    if sys.stderr is None:
        sys.stderr = io.StringIO()
    if closed:
        _untold("is closed")


def _flush() -> None:
    """Write what is left to tell."""
    try:
        sys.stdout.flush()
    except OSError as e:
        _untold(f"does not accept the whole output ({e.strerror})")


def _untold(why: str) -> NoReturn:
    """End with 2, as a verdict may be among what nobody was told."""
    sys.stdout = io.StringIO()  # Python flushes it at its end
    say(f"resim: standard output {why}. Give one, such as a file.", err=True)
    sys.exit(2)
