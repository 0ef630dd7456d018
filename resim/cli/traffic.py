"""`resim traffic`: naturalistic recordings of SUMO's traffic."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import Accept, app, command
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
    build: Annotated[
        Path | None,
        typer.Option(
            help="Build file (TOML) of an AD function that drives one vehicle of each recording, in closed loop; "
            "default: that of the settings, if any.",
            show_default=False,
        ),
    ] = None,
    perception: Annotated[
        Path | None,
        typer.Option(
            help="Perception model (JSON) by which that vehicle senses the others, as sensor data; default: that of "
            "the settings, if any.",
            show_default=False,
        ),
    ] = None,
    accept: Accept = None,
) -> None:
    """Make naturalistic recordings of SUMO's traffic on a map, with the truth of every lane change and turn.

    With a build each recording is a test drive: the function drives one vehicle among traffic that reacts, and sensor
    data, plans and the build's hash are recorded. Ends with 1 where it failed.
    """
    from resim.jobs.traffic import make_traffic

    made = []
    for one in make_traffic(
        road, out, hours=hours, settings=settings, seed=seed, highd=highd, build=build, perception=perception,
        accept=accept or [],
    ):  # fmt: skip
        made.append(one)
        _tell(one)
    km, changes = sum(one.kilometres for one in made), sum(_changes(one) for one in made)
    add_to_json(
        recordings=[one.folder for one in made], kilometres=km, lane_changes=changes,
        left_out=[list(one) for recording in made for one in recording.left_out],
        failed=[one.folder for one in made if one.failed],
    )  # fmt: skip
    rate = f"{changes / max(km, 1e-9):.3f} lane changes a km"
    say(f"{counted(len(made), 'recording')}, {km:.1f} km, {rate}: {out}")
    if any(one.failed for one in made):
        raise typer.Exit(1)


def _tell(one: TrafficRecording) -> None:
    left = f"; {counted(len(one.left_out), 'vehicle')} left out" if one.left_out else ""
    driven = f"{counted(one.vehicles, 'vehicle')}, {one.kilometres:.1f} km"
    who = f"; {one.driver} drives" if one.driver else ""
    say(f"{one.folder}: {driven}, {counted(_changes(one), 'lane change')}{left}{who}")
    if one.note:
        say(f"  {f'ended {one.note}' if one.driver else one.note}")


def _changes(one: TrafficRecording) -> int:
    return sum(count for label, count in one.labels.items() if label.startswith("lane_change"))
