"""`resim demo`: the main job on the example that comes with resim."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path
from typing import Annotated

import typer

from resim.cli.app import BadVerdictError, app, command
from resim.cli.run import run
from resim.cli.terminal import add_to_json, say
from resim.core.errors import InputError
from resim.core.files import shipped

PARTS = (
    "adfunc",
    "networks/proving_ground.xodr",
    "scenarios/criteria",
    "scenarios/cut_in_brake",
    "scenarios/overtake",
    "scenarios/rear_end",
)
"""What the example is made of, by its place in the project; the wheel holds it in `resim/shipped`."""


@command(app)
def demo(
    out: Annotated[Path, typer.Option(help="New folder for the example and its results.")] = Path(
        "resim-demo"
    ),
) -> None:
    """Re-simulate and judge the corner case that comes with resim, and say what to try next.

    A car cuts in and brakes; late sensors leave the function only emergency braking.
    """
    write_example(out)
    case, build, criteria = (
        out / "scenarios" / "cut_in_brake",
        out / "adfunc" / "builds" / "highway_pilot-1.0.toml",
        out / "scenarios" / "criteria" / "highway.toml",
    )
    result = out / "result"
    words = ["run", case, "--build", build, "--criteria", criteria, "--out", result]
    say(f"resim {shlex.join(map(str, words))}")
    try:
        run(case, build, result, criteria=criteria)
    except BadVerdictError as e:
        say(f"{e} (as it should: a corner case is hard)")
    add_to_json(example=out, result=result)
    say("")
    say("next, for example:")
    say(f"  resim assess {shlex.quote(str(case))} --criteria {shlex.quote(str(criteria))}")
    say("  resim run --help")


def write_example(out: Path) -> None:
    """Copy the example into a folder that is not there yet, or empty."""
    home = shipped()
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(out, "exists and is not empty", "Name another folder with --out.")
    try:
        for part in PARTS:
            (out / part).parent.mkdir(parents=True, exist_ok=True)
            if (home / part).is_dir():
                shutil.copytree(home / part, out / part, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(home / part, out / part)
    except OSError as e:
        raise InputError(out, f"cannot be written: {e}", "Name another folder with --out.") from e
