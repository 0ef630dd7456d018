"""`resim suite`: make suites of recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from resim.cli.app import app, command
from resim.cli.inputs import A_CRITERIA
from resim.cli.terminal import add_to_json, say
from resim.core import remedies
from resim.core.errors import InputError
from resim.core.files import refuse_undecodable
from resim.core.spelling import counted

suites = typer.Typer(help="Suites: recordings that a build is verified on.", no_args_is_help=True)
app.add_typer(suites, name="suite")


@command(suites, "new")
def new(
    folder: Annotated[Path, typer.Argument(help="Folder with recording folders, at any depth.")],
    out: Annotated[Path, typer.Option(help="Suite (TOML) to write.")],
    criteria: Annotated[
        Path,
        typer.Option(
            callback=A_CRITERIA, help="Criteria (TOML) to judge by, such as scenarios/criteria/highway.toml."
        ),
    ],
) -> None:
    """Write a suite of all recordings in a folder, with the hashes of their content."""
    from resim.recordings.settings import SETTINGS

    found = sorted(path.parent for path in folder.rglob(SETTINGS)) if folder.is_dir() else []
    for one in found:
        refuse_undecodable(one)
    if not found:
        raise InputError(folder, "holds no recording", remedies.RECORDING)
    if out.exists():
        raise InputError(out, "exists already", "Name a new file: a suite may have been edited.")
    from resim.execution.workers import in_child
    from resim.results import whole_file
    from resim.verification.suite import new_suite, read_suite

    in_child(_read, criteria)  # a file that holds none is told of now
    text = new_suite(found, criteria, out, out.stem)
    with whole_file(out, None) as path:
        path.write_text(text, encoding="utf-8")
    read_suite(out)
    add_to_json(suite=out, recordings=found)
    say(f"{out}: {counted(len(found), 'recording')}")


def _read(criteria: Path) -> None:
    """Read criteria in a child process, as they bring code."""
    from resim.metrics.criteria import read_criteria

    read_criteria(criteria)
