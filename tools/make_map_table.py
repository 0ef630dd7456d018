"""Converts every map of ours and of a folder, and writes the table in networks/README.md.

python tools/make_map_table.py [../shared/data]
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import shapely
from lxml import etree

from resim.core.errors import ConversionError, ResimError
from resim.resimulation import MapCheck, check_map
from resim.road.opendrive import VEHICLE_LANES, load
from resim.road.sumo import sumo_net
from resim.road.sumo.netconvert import run_netconvert

HERE = Path(__file__).resolve().parents[1]
TARGET = HERE / "networks" / "README.md"
IMPORT = (
    "--opendrive.curve-resolution", "1", "--output.original-names", "--opendrive.position-ids",
    "--opendrive.import-all-lanes", "--opendrive.internal-shapes", "--opendrive.advance-stopline", "0",
)  # fmt: skip
START, END = "<!-- table -->", "<!-- end of table -->"
HEAD = (
    "| map | kB | roads | km | lanes | driving | netconvert's own import [m] | time [s] | again [ms] "
    "| worst [mm] | mean [mm] | remarks |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
)


def row(path: Path, name: str, cache: Path) -> str:
    """Give a map's line: read, examined and converted twice."""
    size = path.stat().st_size / 1000.0
    try:
        network = load(path)
        again = load(path)  # as another process would have it
        begin = time.perf_counter()
        sumo_net(network, cache=cache)
        middle = time.perf_counter()
        sumo_net(again, cache=cache)
        end = time.perf_counter()
        found = check_map(path, cache=cache)
    except ResimError as error:
        return (
            f"| {name} | {size:.0f} |"
            + " – |" * 9
            + f" refused: {str(error).replace(str(path), '').strip(': ')} |"
        )
    conversion = found.net.conversion
    kilometres = sum(road.length for road in network.roads.values()) / 1000.0
    driving = sum(lane.type in VEHICLE_LANES for lane in conversion.lanes)
    cells = [
        name, f"{size:.0f}", len(network.roads), f"{kilometres:.2f}", len(conversion.lanes), driving,
        imported(path, found), f"{middle - begin:.2f}", f"{1000.0 * (end - middle):.1f}",
        f"{1000.0 * conversion.worst:.2f}", f"{1000.0 * conversion.mean:.2f}", remarks(found),
    ]  # fmt: skip
    return "| " + " | ".join(map(str, cells)) + " |"


def imported(path: Path, found: MapCheck) -> str:
    """What netconvert makes of the map by itself: the worst distance of its lanes' points from the exact centres."""
    with tempfile.TemporaryDirectory() as folder:
        net = Path(folder) / "map.net.xml"
        try:
            run_netconvert(path, ["--opendrive-files", str(path), *IMPORT], net, time_limit=120.0)
        except ConversionError as error:
            return "crashes" if "crashed" in str(error) else "refuses"
        root = etree.parse(str(net)).getroot()
    centres = defaultdict(list)
    for shape in found.network.lane_shapes(step=0.2):
        centres[f"{shape.road}_{shape.lane}"].append(shapely.linestrings(shape.centre))
    lines = {name: shapely.multilinestrings(own) for name, own in centres.items()}
    worst = 0.0
    for lane in root.iter("lane"):
        for param in lane.iterfind("param[@key='origId']"):
            points = np.array([p.split(",")[:2] for p in str(lane.get("shape")).split()], dtype=float)
            for name in str(param.get("value")).split():
                if name in lines:
                    worst = max(worst, float(shapely.distance(lines[name], shapely.points(points)).max()))
    return f"{worst:.3f}"


def remarks(found: MapCheck) -> str:
    """What is wrong in the map and its net, in short."""
    out = []
    errors = [flaw for flaw in found.flaws if flaw.severity == "error"]
    if errors:
        more = f" and {len(errors) - 1} more errors" if len(errors) > 1 else ""
        codes = ", ".join(dict.fromkeys(flaw.code for flaw in errors))
        out.append(f"refused without `--accept` of {codes}: {errors[0].text}{more}")
    for severity in ("warning", "note"):
        codes = [flaw.code for flaw in found.flaws if flaw.severity == severity]
        out += [f"{codes.count(code)} {code}" for code in dict.fromkeys(codes)]
    if found.net.conversion.bad:
        out.append(f"{len(found.net.conversion.bad)} lanes not exact")
    if lost := found.net.conversion.lost:
        out.append(f"{len(lost)} links of lanes not in the net")
    if jumps := found.net.conversion.jumps:
        out.append(f"{len(jumps)} connections bridge gaps of up to {jumps[0].gap:.2f} m")
    return "; ".join(out)


def main(arguments: list[str]) -> int:
    folder = Path(arguments[0]) if arguments else HERE.parent / "shared" / "data"
    maps = [(path, f"networks/{path.name}") for path in sorted((HERE / "networks").glob("*.xodr"))]
    maps += [(path, path.relative_to(folder).as_posix()) for path in sorted(folder.rglob("*.xodr"))]
    with tempfile.TemporaryDirectory() as cache:
        rows = [row(path, name, Path(cache) / str(i)) for i, (path, name) in enumerate(maps)]
    before, _, rest = TARGET.read_text(encoding="utf-8").partition(START)
    text = f"{before}{START}\n{HEAD}\n" + "\n".join(rows) + f"\n{END}{rest.partition(END)[2]}"
    TARGET.write_text(text, encoding="utf-8", newline="\n")
    print("\n".join(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
