"""Arguments and options that name files. Each is looked at before anything is imported that takes time.

What says what such a file may hold (`settings`, `suite`, `sweep_file`, `criteria_file`) imports no tables, maps or
compiled code, and is imported only where such a file is named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import typer

from resim.core import remedies
from resim.core.errors import InputError
from resim.core.files import joined, open_file, parse_json, parse_toml, read_file

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
    from resim.recordings.present import look_over

    look_over(path)


def _criteria(path: Path) -> None:
    raw = read_file(path, remedies.CRITERIA)
    parse_toml(raw, path, remedies.CRITERIA)
    from resim.metrics.criteria_file import parse_criteria

    parse_criteria(raw, path)


def _suite(path: Path) -> None:
    _parsed(parse_toml, path, remedies.SUITE)
    from resim.verification.suite import read_suite

    _criteria(joined(path, read_suite(path).file.criteria))


def _sweep(path: Path) -> None:
    _parsed(parse_toml, path, remedies.SWEEP)
    from resim.recordings.listed import found_folders
    from resim.sweeps.sweep_file import read_sweep_file

    file = read_sweep_file(path)
    folders, _ = found_folders(path, file.recording)
    for folder in folders.values():
        _recording(folder)
    if file.suite is not None:
        _suite(joined(path, file.suite))
    for name in file.build:
        _parsed(parse_toml, joined(path, name), remedies.BUILD)
    if file.perception is not None:
        _parsed(parse_json, joined(path, file.perception), remedies.MODEL)
        _swept_model(path, joined(path, file.perception), [p.name for p in file.parameter])
    _criteria(joined(path, file.criteria))


def _swept_model(path: Path, model: Path, names: Sequence[str]) -> None:
    """Raise InputError, of the sweep at `path`, for a parameter that its model does not have."""
    from resim.perception.model import fault_of, read_model

    read_model(model)
    for name in (name for name in names if name.startswith("perception.")):
        own = name.removeprefix("perception.")
        try:
            read_model(model, (f"{own}=0.0",))
        except InputError as e:
            why = fault_of(e, own)
            if why.startswith("there is no"):  # whether the values are right is asked when all are known
                raise InputError(path, f"parameter {name!r}: {why}", remedies.SWEEP) from e


def _map(path: Path) -> None:
    open_file(path, remedies.MAP).close()


def _there(path: Path) -> None:
    if not path.exists():
        raise InputError(path, "there is no such file or folder", "Check the path.")
    from resim.recordings.logs.kinds import refuse_unsuited

    refuse_unsuited(path)


def _swept(path: Path) -> None:
    if not (path / "sweep.json").is_file():
        raise InputError(path, "holds no sweep", remedies.SWEPT)


A_RECORDING, A_DRIVE, A_MAP = _each(_recording), _each(_drive), _each(_map)
A_BUILD, A_SUITE, A_SWEEP, A_CRITERIA = (
    _each(_toml(remedies.BUILD)),
    _each(_suite),
    _each(_sweep),
    _each(_criteria),
)
A_SOURCE, A_SWEPT = _each(_there), _each(_swept)
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
