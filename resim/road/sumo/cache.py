"""SUMO nets of OpenDRIVE maps, converted once and kept in a cache."""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

from lxml import etree

from resim.core.errors import ConversionError, InputError
from resim.core.files import cache_folder
from resim.core.spec import read_json, to_json
from resim.road.links import LaneKey
from resim.road.opendrive import RoadNetwork
from resim.road.sumo.coarse import coarse
from resim.road.sumo.conversion import Conversion, measure
from resim.road.sumo.netconvert import OPTIONS, run_netconvert, sumo_version
from resim.road.sumo.patch import mark_stops, patch
from resim.road.sumo.plain import plain
from resim.road.sumo.plainxml import names, write
from resim.road.sumo.programs import write_programs
from resim.road.sumo.rules import find_rules
from resim.road.sumo.taken import taken

VERSION = 8
"""Counts up when the same map gives another net."""

TIME_LIMIT = 120.0
NET, SIMULATED, REPORT = "net.xml", "simulated.net.xml", "conversion.json"
BESIDE, ABANDONED = "converting-", 86400.0


@dataclass(frozen=True, eq=False)
class SumoNet:
    """A converted map.

    path: the .net.xml. simulated: the one for simulation, with fewer points (`coarse`). report: the file with its
    `Conversion`. hash: of all that decides the nets: the map's bytes, netconvert's options, the SUMO version, ours.
    """

    path: Path
    simulated: Path
    report: Path
    hash: str

    @cached_property
    def conversion(self) -> Conversion:
        """How exact the net is."""
        remedy = f"Remove the folder {self.report.parent}: the map is then converted again."
        return read_json(self.report, Conversion, "resim", remedy)

    @cached_property
    def lanes(self) -> Mapping[LaneKey, tuple[str, ...]]:
        """Every lane of the map that is in the net, with its SUMO lanes in driving direction."""
        return {lane.key: lane.sumo for lane in self.conversion.lanes if lane.sumo}


def sumo_net(network: RoadNetwork, *, cache: Path | None = None, time_limit: float = TIME_LIMIT) -> SumoNet:
    """Give the SUMO net of an OpenDRIVE map, from the cache where it was converted before.

    cache: its directory, default resim/nets in XDG_CACHE_HOME or ~/.cache. time_limit: s for netconvert.
    Processes may convert the same map at once. Raises InputError where the map has no driving lane or the cache
    cannot be written, ConversionError where netconvert is missing, refuses the map, crashes or takes too long.
    """
    key = _key(network)
    folder = (cache or default_cache()) / key
    found = SumoNet(folder / NET, folder / SIMULATED, folder / REPORT, key)
    if not _is_whole(folder):
        _convert(network, folder, time_limit)
    return found


def default_cache() -> Path:
    """Give the directory of the converted nets."""
    return cache_folder("nets")


@lru_cache(maxsize=64)
def _key(network: RoadNetwork) -> str:
    """The name of a map's folder: runs of one map ask again and again."""
    return _hash(network.path.read_bytes())


def _hash(text: bytes) -> str:
    digest = hashlib.sha256(text)
    digest.update("\0".join((*OPTIONS, sumo_version(), str(VERSION))).encode())
    return digest.hexdigest()[:32]


def _convert(network: RoadNetwork, target: Path, time_limit: float) -> None:
    """Convert in a folder beside the target, and move it into place, whole, at the end."""
    lanes = [lane for road in network.roads.values() for s in road.sections for lane in s.lanes.values()]
    if not any(lane.drivable and lane.id != 0 for lane in lanes):
        kinds = ", ".join(sorted({lane.type for lane in lanes if lane.id != 0})) or "none at all"
        raise InputError(network.path, f"has no driving lane (its lanes are: {kinds})", "Give a map with lanes "
                         'of type "driving".')  # fmt: skip
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _sweep(target.parent)
        with tempfile.TemporaryDirectory(prefix=BESIDE, dir=target.parent) as beside:
            result = _written(network, Path(beside), time_limit)
            _put(result, target)
    except OSError as error:
        problem = f"the cache cannot be written ({error.strerror})"
        raise InputError(target.parent, problem, "Set XDG_CACHE_HOME to a writable folder.") from error


def _is_whole(folder: Path) -> bool:
    return all((folder / name).is_file() for name in (NET, SIMULATED, REPORT))


def _sweep(folder: Path) -> None:
    """Remove what conversions that were killed left behind, once no running one can be so old."""
    for left in folder.glob(f"{BESIDE}*"):
        with contextlib.suppress(OSError):  # another process may sweep as well
            if time.time() - left.stat().st_mtime > ABANDONED:
                shutil.rmtree(left, ignore_errors=True)


def _written(network: RoadNetwork, folder: Path, time_limit: float) -> Path:
    """Write the net and its report into a folder of their own; give that."""
    work, result = folder / "work", folder / "result"
    work.mkdir()
    result.mkdir()
    made = plain(network)
    if not made.lanes:
        raise ConversionError(
            f"{network.path}: no lane has a length, but inside of junctions to which none leads. Correct the map"
        )
    rules = find_rules(network, made)
    arguments = write(network, made, rules, work)
    run_netconvert(network.path, arguments, work / NET, time_limit=time_limit, names=names(made))
    root, via = patch(work / NET, made)
    mark_stops(root, rules.stops)
    told = taken(network, made, rules, write_programs(network, rules, root, via))
    net = etree.tostring(root, xml_declaration=True, encoding="UTF-8")
    simple = coarse(net)
    worst = measure(network, simple, made, via).worst
    report = replace(measure(network, net, made, via), simulated=worst, rules=told)
    (result / NET).write_bytes(net)
    (result / SIMULATED).write_bytes(simple)
    (result / REPORT).write_text(json.dumps(to_json(report), indent=1) + "\n", encoding="utf-8")
    return result


def _put(result: Path, target: Path) -> None:
    """Move the folder into place; another process may have been first, or left a part of one behind."""
    try:
        result.rename(target)
    except OSError:
        if not _is_whole(target):
            shutil.rmtree(target)
            result.rename(target)
