"""Arguments and options that name files. Each is looked at before anything is imported that takes time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import typer

from resim.core import remedies
from resim.core.errors import InputError
from resim.core.files import open_file, parse_json, parse_toml, read_file

_Given = Path | Sequence[Path] | None


def _each(look: Callable[[Path], None]) -> Callable[[typer.Context, _Given], _Given]:
    """Give a callback that looks at each path. Raises InputError for one that is not what it should be."""

    def callback(context: typer.Context, given: _Given) -> _Given:
        if not context.resilient_parsing:  # the shell asks for completions
            for path in [given] if isinstance(given, Path) else given or ():
                _look(look, path)
        return given

    return callback


def _look(look: Callable[[Path], None], path: Path) -> None:
    """Look at a path."""
    look(path)


def _toml(remedy: str) -> Callable[[Path], None]:
    return lambda path: _parsed(parse_toml, path, remedy)


def _parsed(parse: Callable[[bytes, Path, str], object], path: Path, remedy: str) -> None:
    parse(read_file(path, remedy), path, remedy)


def _drive(path: Path) -> None:
    if not (path / "run.json").is_file():
        if not (path / "recording.toml").is_file():
            raise InputError(path, "holds neither recording.toml nor run.json", remedies.DRIVE)
        _recording(path)


def _recording(path: Path) -> None:
    _parsed(parse_toml, path / "recording.toml", remedies.RECORDING)


def _map(path: Path) -> None:
    open_file(path, remedies.MAP).close()


A_RECORDING, A_DRIVE, A_MAP = _each(_recording), _each(_drive), _each(_map)
A_BUILD, A_SUITE, A_SWEEP = (_each(_toml(r)) for r in (remedies.BUILD, remedies.SUITE, remedies.SWEEP))
A_CRITERIA = _each(_toml(remedies.CRITERIA))
A_MODEL = _each(lambda path: _parsed(parse_json, path, remedies.MODEL))
"""Callbacks of arguments and options."""

RecordingFolder = Annotated[
    Path,
    typer.Argument(
        metavar="RECORDING", callback=A_RECORDING, help="Recording folder (recording.toml, gt, sd)."
    ),
]
BuildFile = Annotated[Path, typer.Option(callback=A_BUILD, help="Build file (TOML) of the AD function.")]
CriteriaFile = Annotated[
    Path | None,
    typer.Option(
        "--criteria",
        metavar="FILE",
        callback=A_CRITERIA,
        help="Criteria (TOML) to judge by, such as scenarios/criteria/highway.toml.",
    ),
]
"""By what a drive is judged."""
