"""`resim traffic`: naturalistic recordings of SUMO's traffic."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import app, command
from resim.cli.inputs import A_MAP
from resim.cli.terminal import add_to_json, say
from resim.core.spelling import counted

if TYPE_CHECKING:
    from resim.jobs.traffic import TrafficRecording


@command(app, "traffic")
def traffic(
    road: Annotated[Path, typer.Argument(metavar="MAP", callback=A_MAP, help="OpenDRIVE file (.xodr).")],
    out: Annotated[Path, typer.Option(help="New folder; each recording is a folder in it.")],
    hours: Annotated[
        float, typer.Option(help="How long, without the time in which the map fills [h].")
    ] = 1.0,
    settings: Annotated[
        Path | None,
        typer.Option(
            help="Demand, drivers and lane changes (TOML); default: those of a motorway that ship.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of all draws.")] = 1,
    highd: Annotated[bool, typer.Option(help="Write CSV of the highD family as well.")] = False,
) -> None:
    """Make naturalistic recordings of SUMO's traffic on a map, with the truth of every lane change and turn."""
    from resim.jobs.traffic import make_traffic

    made = []
    for one in make_traffic(road, out, hours=hours, settings=settings, seed=seed, highd=highd):
        made.append(one)
        _tell(one)
    km, changes = sum(one.kilometres for one in made), sum(_changes(one) for one in made)
    add_to_json(
        recordings=[one.folder for one in made], kilometres=km, lane_changes=changes,
        left_out=[list(one) for recording in made for one in recording.left_out],
    )  # fmt: skip
    rate = f"{changes / max(km, 1e-9):.3f} lane changes a km"
    say(f"{counted(len(made), 'recording')}, {km:.1f} km, {rate}: {out}")


def _tell(one: TrafficRecording) -> None:
    left = f"; {counted(len(one.left_out), 'vehicle')} left out" if one.left_out else ""
    driven = f"{counted(one.vehicles, 'vehicle')}, {one.kilometres:.1f} km"
    say(f"{one.folder}: {driven}, {counted(_changes(one), 'lane change')}{left}")


def _changes(one: TrafficRecording) -> int:
    return sum(count for label, count in one.labels.items() if label.startswith("lane_change"))
