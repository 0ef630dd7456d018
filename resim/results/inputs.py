"""What jobs are given, read for the catalog: recordings, maps, scenarios, builds, models, criteria, suites, sweeps.

No code of a user is run: a build is told by its file and the sources that it names.
"""

from __future__ import annotations

import os
import platform
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from resim.core.errors import InputError, ResimError
from resim.core.files import file_hash, joined, parse_json, read_file
from resim.core.sealed import read_sealed
from resim.recordings.settings import SETTINGS, Settings, read_settings
from resim.results.entry import NAME, CatalogEntry, CatalogFact, CatalogInput, InputKind, digest, stamps
from resim.results.reading import written

LARGEST = 1_000_000
"""Bytes of the largest file that a person writes."""
LARGEST_SCENARIO = 100_000_000
"""Bytes of the largest scenario that is read."""
LONGEST = 200
"""Letters of a tag that are kept."""
_TABLES = ("gt", "sd", "plan")
_MINED = "mined.json"
_JSON: Mapping[bytes, InputKind] = {b'"resim-perception-': "model", b'"resim-kernels-': "kernels"}


def input_kind(path: Path) -> InputKind | None:
    """Say what a file is by what stands in it, None where it is nothing that jobs are given."""
    if path.name == SETTINGS:
        return "recording"
    if path.suffix == ".xodr":
        return "map"
    if path.name.endswith(".jscen.json"):
        return "scenario"
    try:
        if not path.is_file():  # a pipe never ends
            return None
        if path.suffix == ".json":
            with path.open("rb") as file:
                head = file.read(400)
            return next((kind for mark, kind in _JSON.items() if mark in head), None)
        if path.suffix != ".toml" or path.stat().st_size > LARGEST:
            return None
        return _toml_kind(tomllib.loads(path.read_text("utf-8")))
    except (OSError, ValueError, RecursionError):
        return None


def _toml_kind(told: Mapping[str, Any]) -> InputKind | None:
    if "version" in told and {"factory", "process", "grpc", "fmi", "recorded"} & told.keys():
        return "build"
    if "criterion" in told:
        return "criteria"
    if "criteria" in told and ("recording" in told or "suite" in told):
        return "sweep-file" if {"build", "parameter", "variation"} & told.keys() else "suite"
    return None


@dataclass(frozen=True)
class _Contents:
    """What a kind of input says of itself. files: by which a change is noticed, besides itself."""

    name: str
    digest: str
    inputs: tuple[CatalogInput, ...] = ()
    facts: tuple[CatalogFact, ...] = ()
    files: tuple[str, ...] = ()
    fault: str = ""


def read_input(path: Path, kind: InputKind) -> CatalogEntry:
    """Read what jobs are given: the folder of a recording, or a file. What is wrong with it stands in its fault.

    Raises OSError for one that is not there any more.
    """
    path = Path(os.path.normpath(path.absolute()))
    file = path / SETTINGS if kind == "recording" else path
    try:
        found = _READERS[kind](path)
    except (ResimError, OSError, ValueError, KeyError, TypeError, RecursionError) as e:
        files = _of_recording(path, None) if kind == "recording" else ()
        found = _Contents(path.name if kind == "recording" else path.stem, "", files=files, fault=str(e))
    entry = CatalogEntry(
        kind=kind, name=found.name, folder=path, host=platform.node(), written=written(file), digest=found.digest,
        resim="", verdict="", inputs=found.inputs, facts=found.facts, fault=found.fault,
    )  # fmt: skip
    names = dict.fromkeys([str(file.relative_to(entry.home)), *found.files])
    return replace(entry, files=stamps(entry.home, names))


def _recording(folder: Path) -> _Contents:
    from resim.recordings.content import content_hash

    settings = read_settings(folder / SETTINGS)
    road = os.path.normpath(folder / settings.map)
    inputs = [CatalogInput("map", Path(road).stem, road, file_hash(Path(road), "Its map is not there."))]
    if settings.build is not None:
        inputs.append(CatalogInput("drove", settings.build, hash=settings.build_hash or ""))
    mined, origin = _origin(folder)
    tables = [CatalogFact("table", name) for name in _TABLES if _has_table(folder, name)]
    facts = [
        CatalogFact(NAME, settings.name),
        *tables,
        *_weather(settings),
        *_tags(settings),
        *_findings(folder),
    ]
    content = content_hash(folder)
    return _Contents(
        folder.name, content, (*inputs, *origin), tuple(replace(fact, hash=content) for fact in facts),
        (*_of_recording(folder, settings), *mined),
    )  # fmt: skip


def _of_recording(folder: Path, settings: Settings | None) -> tuple[str, ...]:
    """Files that a recording is read from; those that are not there yet, too."""
    tables = [f"{name}.{suffix}" for name in _TABLES for suffix in ("csv", "parquet")]
    return (SETTINGS, *tables, *(() if settings is None else (settings.map,)))


def _has_table(folder: Path, name: str) -> bool:
    return any((folder / f"{name}.{suffix}").is_file() for suffix in ("csv", "parquet"))


def _weather(settings: Settings) -> Iterator[CatalogFact]:
    for name, value in settings.environment.model_dump(by_alias=True).items():
        if value is not None:
            yield CatalogFact("weather", f"{name}={value}".lower())


def _tags(settings: Settings) -> Iterator[CatalogFact]:
    for name, value in settings.provenance.items():
        yield CatalogFact("tag", f"{name}={value}".lower()[:LONGEST])


def _findings(folder: Path) -> Iterator[CatalogFact]:
    """How often `resim check` finds what."""
    from resim.recordings import read_tables
    from resim.recordings.checks import examine
    from resim.road.opendrive import load

    tables = read_tables(folder)
    for code, count in sorted(Counter(f.code for f in examine(tables, load(tables.map))).items()):
        yield CatalogFact("finding", code.lower(), float(count))


def _origin(path: Path) -> tuple[list[str], list[CatalogInput]]:
    """What something mined was cut out of: the file that says so, the mined folder, and the recording."""
    found = next((p for p in [*path.parents][:3] if (p / _MINED).is_file()), None)
    if found is None:
        return [], []
    own = path.relative_to(found).as_posix()
    mined = [CatalogInput("mining", found.name, str(found), digest(found, "mining"))]
    name, *_ = path.name.removesuffix(".jscen.json").rsplit("+", 2)  # recording, EGO and number
    told = [found / _MINED, found / "parts" / name / "part.json"]
    if told[1].is_file():
        part = read_sealed(told[1], "Mine it again.")
        if any(file == own or file.startswith(f"{own}/") for file in part["files"]):
            where = str(joined(found / _MINED, part["folder"]))
            mined.append(CatalogInput("recording", part["recording"], where, part["content"]))
    start = path if path.is_dir() else path.parent
    return [os.path.relpath(file, start) for file in told if file.is_file()], mined


def _map(path: Path) -> _Contents:
    return _Contents(path.stem, file_hash(path))


def _scenario(path: Path) -> _Contents:
    mined, origin = _origin(path)
    roads = [path.parent / name for name in _map_of(path)]
    inputs = [CatalogInput("map", road.stem, str(road), file_hash(road)) for road in roads if road.is_file()]
    return _Contents(
        path.name.removesuffix(".jscen.json"), file_hash(path), (*inputs, *origin),
        files=(*mined, *(road.name for road in roads)),
    )  # fmt: skip


def _map_of(scenario: Path) -> list[str]:
    """The map that a JSCEN file names, which lies beside it; nothing where it names none."""
    told = parse_json(read_file(scenario, "Write it again.", largest=LARGEST_SCENARIO), scenario)
    name = told.get("map") if isinstance(told, dict) else None
    return [name] if isinstance(name, str) and name and "/" not in name and "\\" not in name else []


def _build(path: Path) -> _Contents:
    from resim.simulation.function.interface import freeze_build

    told = tomllib.loads(path.read_text("utf-8"))
    return _Contents(f"{told['name']}-{told['version']}", freeze_build(path).hash)


def _criteria(path: Path) -> _Contents:
    from resim.metrics.criteria import freeze_criteria

    return _Contents(str(tomllib.loads(path.read_text("utf-8"))["name"]), freeze_criteria(path).hash)


def _model(path: Path) -> _Contents:
    from resim.perception.model import read_model

    return _Contents(read_model(path).name, file_hash(path))  # by its file, as results name it


def _study(path: Path) -> _Contents:
    """A suite or a sweep's file: what it names, whose hashes it does not say."""
    told = tomllib.loads(path.read_text("utf-8"))

    def named(role: str, given: Iterable[str]) -> Iterator[CatalogInput]:
        for one in given:
            whole = os.path.normpath(path.parent / one)
            yield CatalogInput(role, Path(whole).stem, whole)

    inputs = [
        CatalogInput("recording", Path(one["folder"]).name, os.path.normpath(path.parent / one["folder"]),
                     one.get("hash", "")) for one in told.get("recording", ())
    ]  # fmt: skip
    for role in ("build", "criteria", "perception", "suite"):
        given = told.get(role, ())
        inputs += named(role, [given] if isinstance(given, str) else given)
    return _Contents(str(told["name"]), file_hash(path), tuple(inputs))


_READERS: Mapping[InputKind, Callable[[Path], _Contents]] = {
    "recording": _recording, "map": _map, "scenario": _scenario, "build": _build, "criteria": _criteria,
    "model": _model, "kernels": _map, "suite": _study, "sweep-file": _study,
}  # fmt: skip


def files_of_input(path: Path, kind: InputKind) -> dict[Path, Path]:
    """Give the files of what jobs are given, each by where it lies, or would be found, with where to read it.

    Code and data of builds and criteria are theirs, beside them, as they were read; what a recording or a suite names
    is something of its own. Raises InputError where they cannot be read.
    """
    from resim.core.plugins.frozen import load_frozen
    from resim.metrics.criteria import freeze_criteria
    from resim.simulation.function.interface import freeze_build

    files = [path / name for name in _of_recording(path, None)] if kind == "recording" else [path]
    if linked := [file for file in files if file.is_symlink()]:
        raise InputError(linked[0], "is a link, which is not followed", "Put the file itself there.")
    if kind not in ("build", "criteria"):
        return {file: file for file in files if file.is_file()}
    again = freeze_build if kind == "build" else freeze_criteria
    copy = load_frozen(again(path), again)
    beside = {Path(os.path.normpath(path.parent / name)): copy.folder / name for name in sorted(copy.names)}
    return {path: path, **beside}


def refuse_nothing(path: Path) -> InputError:
    """Give the error of a path at which there is nothing for the lake."""
    what = "holds nothing that the lake knows" if path.exists() else "is not there"
    remedy = (
        "Give recordings (folders with a recording.toml), maps (.xodr), scenarios (.jscen.json), builds, models, "
        "criteria, suites, files of sweeps, folders of results, mined ones or spaces, or folders that hold such."
    )
    return InputError(path, what, remedy)
