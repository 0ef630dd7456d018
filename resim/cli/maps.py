"""`resim map`: is a map sound, how exact is its SUMO net, and what does it look like."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import Accept, BadVerdictError, app, command
from resim.cli.inputs import A_MAP
from resim.cli.terminal import add_to_json, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from resim.road.checked import MapCheck
    from resim.road.flaws import Flaw
    from resim.road.sumo import Conversion
    from resim.road.sumo.taken import TakenRules

maps = typer.Typer(help="Check, convert and plot OpenDRIVE maps.", no_args_is_help=True)
app.add_typer(maps, name="map")

MOST = 20
"""Lines of one kind that are printed; conversion.json has them all."""

MapFile = Annotated[
    Path, typer.Argument(metavar="MAP", callback=A_MAP, help="OpenDRIVE 1.4 to 1.8 file (.xodr).")
]


@command(maps, "check")
def check(path: MapFile) -> None:
    """Check and convert a map; list its errors and inexact lanes."""
    from resim.jobs.convert import check_map

    found = check_map(path)
    _print_map(found)
    _print_flaws(found.flaws)
    _print_conversion(found.net.conversion)
    add_to_json(map=path, flaws=found.flaws, problems=found.problems)
    if problems := found.problems:
        raise BadVerdictError(f"{path}: {'; '.join(problems)}")


@command(maps, "convert")
def convert(
    path: MapFile,
    out: Annotated[Path, typer.Option(help="Folder for the net; an earlier one there is replaced.")],
    accept: Accept = None,
) -> None:
    """Write the SUMO net of a map, and how exact each of its lanes is, as numbers and as a picture."""
    from resim.jobs import convert as job

    found = job.convert(path, out, accept=accept or [])
    _print_map(found)
    _print_flaws(found.flaws)
    _print_conversion(found.net.conversion)
    add_to_json(out=out, flaws=found.flaws, conversion=out / "conversion.json")
    say(f"net, numbers and picture: {out}")


@command(maps, "plot")
def plot(
    path: MapFile,
    out: Annotated[
        Path | None, typer.Option(help="HTML file to write; default: NAME.html in the current folder.")
    ] = None,
) -> None:
    """Draw a map: lanes with types and ids, junctions, and the errors of its SUMO net as colour."""
    from resim.jobs.convert import draw_map

    target = out or Path(f"{path.stem}.html")
    why = draw_map(path, target)
    if why:
        say(f"note: drawn without the errors of its SUMO net: {why}", err=True)
    add_to_json(page=target, missing=why or None)
    say(str(target))


def _print_map(found: MapCheck) -> None:
    network = found.network
    kilometres = sum(road.length for road in network.roads.values()) / 1000.0
    major, minor = network.header.revision
    say(
        f"{network.path.name}: OpenDRIVE {major}.{minor}, {len(network.roads)} roads ({kilometres:.2f} km), "
        f"{len(found.net.conversion.lanes)} lanes, {len(network.junctions)} junctions"
    )


def _print_flaws(flaws: Sequence[Flaw]) -> None:
    for flaw in flaws[:MOST]:
        say(f"{flaw.severity:7}  {flaw.code}  {flaw.text}")
    if len(flaws) > MOST:
        say(f"... and {len(flaws) - MOST} more")
    if not flaws:
        say("no flaw found in the map")


def _print_conversion(conversion: Conversion) -> None:
    there = [lane for lane in conversion.lanes if lane.worst is not None]
    say(
        f"SUMO net: {len(there)} of {len(conversion.lanes)} lanes, {conversion.connections} connections; "
        f"centre lines within {1000.0 * conversion.worst:.1f} mm, {1000.0 * conversion.mean:.2f} mm on average; "
        f"{100.0 * conversion.simulated:.1f} cm in the net for simulations, which has fewer points"
    )
    for lane in conversion.bad[:MOST]:
        what = "not in the net" if lane.worst is None else f"{1000.0 * lane.worst:.1f} mm off"
        why = f": {lane.remark}" if lane.remark else ""
        say(f"  {lane.key} ({lane.type}) at s = {lane.s:g} m (x {lane.x:g}, y {lane.y:g}): {what}{why}")
    if len(conversion.bad) > MOST:
        say(f"  ... and {len(conversion.bad) - MOST} more")
    for link in conversion.lost[:MOST]:
        say(f"  not in the net: the link from {link}, of which netconvert makes no connection")
    if len(conversion.lost) > MOST:
        say(f"  ... and {len(conversion.lost) - MOST} more")
    if conversion.jumps:
        worst = conversion.jumps[0]
        say(
            f"{len(conversion.jumps)} connection(s) bridge a gap between linked lanes, the widest {worst.gap:.2f} m "
            f"at x {worst.x:g}, y {worst.y:g}"
        )
    _print_rules(conversion.rules)


def _print_rules(rules: TakenRules) -> None:
    if not (rules.lights or rules.signs or rules.speed_signs or rules.priorities or rules.left_out):
        return
    own = sum(bool(program.controllers) for program in rules.programs)
    say(
        f"in the net: {rules.lights} traffic light(s), at {len(rules.programs)} junction(s), {own} of them with the "
        f"program of the map's controllers; {rules.signs} sign(s) of right of way, {rules.speed_signs} speed sign(s), "
        f"priorities between ways: {rules.priorities}"
    )
    for left in rules.left_out[:MOST]:
        place = f" (road {left.road}, s = {left.s:g} m)" if left.road else ""
        say(f"  not in the net: {left.kind} {left.id}{place}: {left.why}")
    if len(rules.left_out) > MOST:
        say(f"  ... and {len(rules.left_out) - MOST} more")
