"""Converts OpenDRIVE maps to SUMO nets with netconvert, and keeps the nets in a cache."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import signal
import subprocess
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from lxml import etree

from resim.core.errors import ConversionError, InputError
from resim.road.opendrive import RoadNetwork
from resim.road.prepare import VERSION, prepared, section_of

OPTIONS = (
    "--opendrive.curve-resolution", "1", "--precision", "6", "--output.original-names",
    "--opendrive.position-ids", "--opendrive.import-all-lanes", "--opendrive.internal-shapes",
    "--offset.disable-normalization", "--opendrive.advance-stopline", "0",
    "--default.junctions.radius", "0", "--junctions.small-radius", "0", "--junctions.endpoint-shape",
)  # fmt: skip
TIME_LIMIT = 120.0
INSTALL = "Install eclipse-sumo of the version in pyproject.toml"
LIBRARIES = "Install libX11, libXext, libXrender, libGL, libatomic and libexpat from the system's packages"
SIMPLIFY = "Look at the map there in an OpenDRIVE editor, or use another map"

JUNCTION_SHAPES = "--opendrive.internal-shapes"
PLAIN_REMARK = "netconvert crashes over this map's junctions: converted without the shapes inside of them"

LaneKey = tuple[str, int, int]


class NetconvertCrashError(ConversionError):
    """netconvert died on a signal."""


@dataclass(frozen=True, eq=False)
class SumoNet:
    """A converted map.

    path: the .net.xml. hash: of all that decides the net: the map's bytes, the options, the SUMO version,
    the preparation. remark: what had to be left out of the conversion, "" where nothing was.
    """

    path: Path
    network: RoadNetwork
    hash: str
    remark: str

    @cached_property
    def lanes(self) -> Mapping[LaneKey, tuple[str, ...]]:
        """(road, section index of the map, lane) -> ids of its SUMO lanes in order of s.

        Lanes inside of junctions, and those netconvert left out, have no entry.
        """
        return _lanes(self.path, self.network)


def sumo_net(network: RoadNetwork, *, cache: Path | None = None, time_limit: float = TIME_LIMIT) -> SumoNet:
    """Give the SUMO net of an OpenDRIVE map, from the cache where it was converted before.

    cache: its directory, default resim/nets in XDG_CACHE_HOME or ~/.cache. time_limit: s for netconvert.
    A map that makes netconvert crash over the shapes inside of junctions is converted without them, and says
    so in `remark`: replay places vehicles by position and does not need them. Raises ConversionError where
    netconvert is missing, refuses the map, crashes or takes too long; nothing half-written stays behind.
    """
    text = network.path.read_bytes()
    key = _hash(text)
    folder = cache or default_cache()
    whole, plain = folder / f"{key}.net.xml", folder / f"{key}.plain.net.xml"
    if not _is_net(whole) and not _is_net(plain):
        prepared_text = prepared(text, network.path)
        try:
            _convert(network.path, prepared_text, whole, OPTIONS, time_limit)
        except NetconvertCrashError:
            fewer = tuple(option for option in OPTIONS if option != JUNCTION_SHAPES)
            _convert(network.path, prepared_text, plain, fewer, time_limit)
    target = whole if _is_net(whole) else plain
    return SumoNet(target, network, key, "" if target == whole else PLAIN_REMARK)


def _is_net(path: Path) -> bool:
    """Say whether the file is there and whole."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - 32, 0))
        return file.read().rstrip().endswith(b"</net>")


def default_cache() -> Path:
    """Give the directory of the converted nets."""
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "resim" / "nets"


def _hash(text: bytes) -> str:
    digest = hashlib.sha256(text)
    digest.update("\0".join((*OPTIONS, _sumo_version(), str(VERSION))).encode())
    return digest.hexdigest()[:32]


def _sumo_version() -> str:
    try:
        return version("eclipse-sumo")
    except PackageNotFoundError:
        raise ConversionError(f"netconvert: the package eclipse-sumo is not installed. {INSTALL}") from None


def _sumo_home() -> Path:
    """The folder of the installed package `sumo`, found without importing it."""
    found = importlib.util.find_spec("sumo")
    home = Path(found.origin).parent if found and found.origin else None
    if home is None or not (home / "bin").is_dir():
        raise ConversionError(f"netconvert: no sumo package with a bin folder is installed. {INSTALL}")
    return home


def _convert(xodr: Path, text: bytes, target: Path, options: tuple[str, ...], time_limit: float) -> None:
    """Convert in a folder of its own beside the target, and move the whole net into place at the end."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix="converting-", dir=target.parent))
    except OSError as error:
        problem = f"the cache cannot be written ({error.strerror})"
        raise InputError(target.parent, problem, "Set XDG_CACHE_HOME to a folder that can") from None
    try:
        source, net = folder / "map.xodr", folder / "map.net.xml"
        source.write_bytes(text)
        _run(xodr, source, net, options, time_limit)
        net.replace(target)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _run(xodr: Path, source: Path, net: Path, options: tuple[str, ...], time_limit: float) -> None:
    home = _sumo_home()
    proj = str(home / "data" / "proj")
    environment = {**os.environ, "SUMO_HOME": str(home), "PROJ_DATA": proj, "PROJ_LIB": proj}
    command = [str(home / "bin" / "netconvert"), "--opendrive-files", str(source), "-o", str(net), *options]
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, errors="replace", timeout=time_limit,
            stdin=subprocess.DEVNULL, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        text = f"{xodr}: netconvert was stopped after {time_limit:g} s without a result. {SIMPLIFY}."
        raise ConversionError(text) from None
    except OSError as error:
        raise ConversionError(f"netconvert cannot be started ({error.strerror}). {INSTALL}.") from None
    if done.returncode == 0 and net.is_file():
        return
    raise _failure(xodr, done.returncode, done.stderr)


def _failure(xodr: Path, code: int, said: str) -> ConversionError:
    """Put a failed run of netconvert into words."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    if "error while loading shared libraries" in said:
        return ConversionError(f"netconvert cannot start: {lines[-1]}. {LIBRARIES}.")
    if code < 0 or code > 128:
        number = -code if code < 0 else code - 128
        name = signal.Signals(number).name if number in set(signal.Signals) else str(number)
        last = f", after saying {lines[-1]!r}" if lines else ""
        return NetconvertCrashError(f"{xodr}: netconvert crashed on this map ({name}){last}. {SIMPLIFY}.")
    errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error")]
    told = [line for line in errors if " total messages of type" not in line] or errors
    last = told[-1].rstrip(".") if told else f"exit code {code}"
    return ConversionError(f"{xodr}: netconvert refuses this map: {last}. {SIMPLIFY}.")


def _lanes(net: Path, network: RoadNetwork) -> dict[LaneKey, tuple[str, ...]]:
    """Read the lanes of the net by road, section and lane of the map."""
    found: dict[LaneKey, list[tuple[float, str]]] = defaultdict(list)
    for lane, s, original in _original_lanes(net):
        road, _, number = original.rpartition("_")
        if road in network.roads and s is not None:
            starts = [section.start for section in network.roads[road].sections]
            found[road, section_of(starts, s), int(number)].append((s, lane))
    return {key: tuple(lane for _, lane in sorted(own)) for key, own in sorted(found.items())}


def _original_lanes(net: Path) -> Iterator[tuple[str, float | None, str]]:
    """Every lane outside of junctions: its id, the s where its edge begins, and `road_lane`."""
    for _, edge in etree.iterparse(str(net), tag="edge"):
        if edge.get("function") is None:
            s = _position(str(edge.get("id")))
            for lane in edge.iterfind("lane"):
                for param in lane.iterfind("param[@key='origId']"):
                    for original in str(param.get("value")).split():
                        yield str(lane.get("id")), s, original
        edge.clear()


def _position(edge: str) -> float | None:
    """The s in an edge's name `[-]road.s`, None where there is none."""
    try:
        return float(".".join(edge.rsplit(".", 2)[1:]))
    except ValueError:
        return None
