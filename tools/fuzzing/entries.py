"""Gives an input to what a user would give it to, and says what became of it."""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from fuzzing.foreign import Import
from fuzzing.inputs import GROUND, ROOT
from resim import cli
from resim.core.errors import InputError, ResimError
from resim.recordings import Recording, RecordingTables, read_tables, write_tables
from resim.recordings.checks import CODES, examine
from resim.recordings.formats.registry import FORMATS
from resim.recordings.source import recording_of
from resim.report import write_map_page
from resim.resimulation import refuse_flaws
from resim.road.flaws import MAP_CODES, flaws
from resim.road.opendrive import RoadNetwork, load
from resim.road.sumo import sumo_net
from resim.scenario.jscen import read_jscen, write_jscen
from resim.simulation.function.interface import load_build

REPLAY = ROOT / "adfunc" / "builds" / "replay-1.0.toml"
NETCONVERT_LIMIT = 20.0
Step = Callable[[], object]


class FailureError(Exception):
    """What a user must never see."""


def steps(kind: str, path: Path, folder: Path, number: int) -> Iterator[Step]:
    """Give what is to be done with the input, one after the other."""
    if kind == "map":
        yield from _map(path, folder, number)
    elif kind == "recording":
        yield from _recording(path, folder)
    elif kind == "jscen":
        yield lambda: _jscen(path, folder)
    else:
        yield lambda: _build(path)


def outcome(made: Iterator[Step], names: tuple[str, ...]) -> tuple[str, str]:
    """Give "result" or "clear error", and the first error; raises FailureError for an error that names no file."""
    first = ""
    for step in made:
        try:
            step()
        except ResimError as error:
            text = str(error)
            if not any(name in text for name in names):
                raise FailureError(f"the error names no file: {text}") from error
            if "\n" in text or len(text) > 2000:
                raise FailureError(
                    f"an error of {len(text)} characters or several lines: {text[:300]}"
                ) from error
            first = first or text
    return ("clear error" if first else "result"), first


def _map(path: Path, folder: Path, number: int) -> Iterator[Step]:
    network: RoadNetwork | None = None

    def read() -> None:
        nonlocal network
        network = load(path)

    yield read
    if network is None:
        return
    known: RoadNetwork = network
    yield lambda: refuse_flaws(known, flaws(known), ())
    yield lambda: _places(known)
    yield lambda: sumo_net(known, cache=folder / "cache", time_limit=NETCONVERT_LIMIT)
    if number % 10 == 0:
        yield lambda: _page(known, folder / "map.html")


def _places(network: RoadNetwork) -> None:
    shapes = network.lane_shapes()
    x = np.array([shape.centre[0, 0] for shape in shapes[:50]] + [0.0, 1e9, np.nan])
    y = np.array([shape.centre[0, 1] for shape in shapes[:50]] + [0.0, -1e9, 0.0])
    network.to_road(x, y, heading=np.zeros(len(x)))
    network.to_road(x, y)
    for road in network.roads.values():
        s = np.linspace(0.0, road.length, 5)
        network.z(road.id, s)
        for lane in road.sections[0].lanes:
            for ask in (network.lane_heading, network.curvature, network.lane_width, network.speed_limit):
                ask(road.id, lane, 0.0)


def _page(network: RoadNetwork, path: Path) -> None:
    try:
        conversion = sumo_net(network, cache=path.parent / "cache", time_limit=NETCONVERT_LIMIT).conversion
    except ResimError:
        conversion = None
    write_map_page(network, path, conversion=conversion)
    path.unlink()


@cache
def _ground() -> RoadNetwork:
    return load(GROUND)


def _recording(path: Path, folder: Path) -> Iterator[Step]:
    def read() -> None:
        tables = read_tables(path)
        same = (
            hashlib.sha256(tables.map.read_bytes()).digest() == hashlib.sha256(GROUND.read_bytes()).digest()
        )
        network = _ground() if same else load(tables.map)
        examine(tables, network)
        examine(tables, None)
        recording = recording_of(tables)
        recording.sd_by_gt()
        recording_of(tables, lenient=True)

    yield read


def imported(made: Import, folder: Path) -> None:
    """Import a recording of others as `resim import` does, and read what is written."""
    reader = next(one for one in FORMATS if one.name == made.form).reader
    found = reader(made.file, map=GROUND, **{"ego": None, "start": None, "end": None} | made.options)
    if isinstance(found, Recording):
        found = replace(RecordingTables.of(found), gt_file=made.file, sd_file=made.file)
    write_tables(found, folder / "out")
    again = read_tables(folder / "out")
    for table in (again.gt, again.sd):
        if table is not None and not np.isfinite(table["t"]).all():
            raise FailureError("a time is not finite")
    examine(again, _ground())
    with contextlib.suppress(InputError):  # what `resim check` would say first
        recording_of(again, lenient=True)


def run(path: Path, folder: Path, *, accept: bool) -> tuple[str, str]:
    """Give the outcome of `resim run`, in spite of all findings with `accept`; the caller looks at standard error."""
    out = folder / "out"
    sys.argv = ["resim", "run", str(path), "--build", str(REPLAY), "--out", str(out)]
    if accept:
        sys.argv += [word for code in (*CODES, *MAP_CODES) for word in ("--accept", code)]
    try:
        cli.main()
        code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    if out.exists() != (code in (0, 1)):
        raise FailureError(
            f"exit code {code}, and the results are {'there' if out.exists() else 'not there'}"
        )
    if out.exists() and not (out / "report.html").is_file():
        raise FailureError(f"half of the results: {sorted(p.name for p in out.iterdir())}")
    return ("result" if code == 0 else "clear error"), f"exit code {code}"


def _jscen(path: Path, folder: Path) -> None:
    scenario = read_jscen(path)
    copy = folder / "copy.jscen.json"
    write_jscen(scenario, copy)
    again = read_jscen(copy)
    if [o.id for o in again.objects] != [o.id for o in scenario.objects]:
        raise FailureError("written and read again it has other objects")
    if not np.array_equal(again.ego.v.c, scenario.ego.v.c):
        raise FailureError("written and read again it has other numbers")
    copy.unlink()
    times = np.linspace(0.0, scenario.duration, 50)
    scenario.tracks(_ground(), times)


def _build(path: Path) -> None:
    build = load_build(path)
    child = os.fork()
    if not child:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                build.make()
            except Exception:  # the function's own fault; a run says so
                os._exit(0)
            os._exit(0)
    _, status = os.waitpid(child, 0)
    if status:
        raise FailureError(f"making the function ended its process with {status}")
