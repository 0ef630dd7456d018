"""Check, convert and draw a map: what `resim map` does."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from resim.core.errors import ConversionError, InputError
from resim.jobs.given import path_of
from resim.recordings.checked import check_codes
from resim.report import write_map_page
from resim.results import CONVERSION, check_output, whole_file, whole_folder, write_conversion
from resim.road.checked import MapCheck, refuse_flaws
from resim.road.checked import check_map as check_road
from resim.road.flaws import flaws
from resim.road.opendrive import load
from resim.road.sumo import sumo_net


def check_map(road: str | Path) -> MapCheck:
    """Examine a map and convert it.

    Args:
        road: OpenDRIVE file.

    Returns:
        What is wrong in it (worst first), and how exact its SUMO net is.

    Raises:
        InputError: It cannot be read.
        ConversionError: It cannot be converted.
    """
    return check_road(path_of(road))


def convert(road: str | Path, out: str | Path, *, accept: Collection[str] = ()) -> MapCheck:
    """Write the SUMO net of a map, and how exact each of its lanes is, as numbers and as a page.

    Args:
        road: OpenDRIVE file.
        out: Folder for the net; an earlier one there is replaced.
        accept: Codes of errors in the map to continue despite.

    Returns:
        What is wrong in the map, and its net.

    Raises:
        InputError: The map has errors that are not accepted, or the folder holds something else.
        ConversionError: The map cannot be converted.
    """
    check_codes(accept)
    check_output(path_of(out), CONVERSION, (path_of(road),))
    found = check_road(path_of(road))
    refuse_flaws(found.network, found.flaws, accept)
    with whole_folder(path_of(out), CONVERSION) as folder:
        write_conversion(found, folder)
        write_map_page(found.network, folder / "map.html", conversion=found.net.conversion, flaws=found.flaws)
    return found


def draw_map(road: str | Path, out: str | Path) -> str:
    """Draw a map: lanes with types and ids, junctions, and the errors of its SUMO net as colour.

    Args:
        road: OpenDRIVE file.
        out: Page (.html) to write.

    Returns:
        Why the errors of the net are not shown; "" where they are.

    Raises:
        InputError: The map cannot be read, or the page cannot be written.
    """
    network, why = load(path_of(road)), ""
    try:
        conversion = sumo_net(network).conversion
    except (ConversionError, InputError) as error:
        conversion, why = None, str(error)
    with whole_file(path_of(out)) as beside:
        write_map_page(network, beside, conversion=conversion, flaws=flaws(network))
    return why
