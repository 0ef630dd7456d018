"""Results on disk: a run's folder, written whole or not at all."""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb
import pandas as pd

import resim
from resim.core.errors import InputError
from resim.pipeline import Assessed, MapCheck, Resimulation, map_name
from resim.scenario.jscen import write_jscen


@dataclass(frozen=True)
class Results:
    """A kind of results folder: the file that tells it from others, and the names of all that resim writes there."""

    mark: str
    names: re.Pattern[str]


RUN = Results(
    "run.json",
    re.compile(
        r"(run|report|assessment)\.json|report\.html|(tracks|answers|plans|kpis)\.parquet|r?(GT|SD)\.jscen\.json"
        r"|[\w.-]+\.xodr"
    ),
)
ASSESSMENT = Results("assessment.json", re.compile(r"assessment\.(json|html)|kpis\.parquet"))
CONVERSION = Results("conversion.json", re.compile(r"conversion\.json|map\.html|[\w.-]+\.net\.xml"))


def check_output(folder: Path, kind: Results = RUN) -> None:
    """Refuse, before any work is done, a folder that must not be replaced."""
    remedy = "Name another with --out."
    try:
        if folder.is_file():
            raise InputError(folder, "is a file, expected a folder for the results", remedy)
        whole = folder.absolute()
        above = next((parent for parent in whole.parents if parent.exists()), whole)
        if not above.is_dir() or not os.access(above, os.W_OK):
            raise InputError(folder, f"cannot be made: {above} is no folder that you may write", remedy)
        held = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    except OSError as e:
        raise InputError(folder, f"cannot be used: {e.strerror}", remedy) from e
    if held and not _is_result(folder / kind.mark):
        problem = f"exists and is not a results folder (it has no {kind.mark} of resim's)"
        raise InputError(folder, problem, remedy)
    if strange := [name for name in held if not kind.names.fullmatch(name)]:
        raise InputError(
            folder, f"holds {strange[0]}, which is no result of resim's and would be lost", remedy
        )


def _is_result(mark: Path) -> bool:
    try:
        return "resim" in json.loads(mark.read_text(encoding="utf-8"))["versions"]
    except (OSError, ValueError, KeyError, TypeError):
        return False


@contextlib.contextmanager
def whole_folder(folder: Path, kind: Results = RUN) -> Iterator[Path]:
    """Give a folder beside to write into; it takes the place of `folder` if all went well, else it is gone."""
    check_output(folder, kind)
    folder = folder.absolute()
    beside = folder.with_name(f".{folder.name}.{os.getpid()}.new")
    old = folder.with_name(f".{folder.name}.{os.getpid()}.old")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(beside, ignore_errors=True)
        beside.mkdir()
        yield beside
        if folder.exists():
            folder.rename(old)
        try:
            beside.rename(folder)
        except OSError:
            if old.exists():
                old.rename(folder)
            raise
        shutil.rmtree(old, ignore_errors=True)
    except OSError as e:
        raise InputError(folder, f"cannot be written: {e}", "Name another with --out.") from e
    finally:
        shutil.rmtree(beside, ignore_errors=True)


@contextlib.contextmanager
def whole_file(path: Path, kinds: tuple[str, ...] = (".html", ".htm")) -> Iterator[Path]:
    """Give a file beside to write; it takes the place of `path` if all went well, else it is gone.

    kinds: suffixes of the files that may be replaced. Raises InputError for a folder and for any other file.
    """
    path = path.absolute()
    if path.is_dir():
        raise InputError(path, "is a folder, expected a file to write", "Name a file with --out.")
    if path.exists() and path.suffix.lower() not in kinds:
        problem = f"exists and is no {' or '.join(kinds)} file: it would be lost"
        raise InputError(path, problem, "Name another with --out.")
    beside = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield beside
        beside.replace(path)
    except OSError as e:
        raise InputError(path, f"cannot be written: {e}", "Name another with --out.") from e
    finally:
        beside.unlink(missing_ok=True)


def write_json(data: Any, path: Path) -> None:
    """Write JSON, the same bytes for the same data, an array of numbers or texts in one line; NaN is refused."""
    path.write_text(json_text(data), encoding="utf-8")


def json_text(data: Any) -> str:
    """Give JSON as `write_json` writes it."""
    return "".join(_json(data, "")) + "\n"


def _json(data: Any, indent: str) -> Iterator[str]:
    """JSON in pieces; dictionaries and lists of them are spread over lines."""
    deeper = indent + "  "
    if isinstance(data, Mapping) and data:
        start = "{\n"
        for key, value in data.items():
            yield f"{start}{deeper}{json.dumps(str(key))}: "
            yield from _json(value, deeper)
            start = ",\n"
        yield f"\n{indent}}}"
    elif isinstance(data, list | tuple) and any(isinstance(value, Mapping | list | tuple) for value in data):
        start = "[\n"
        for value in data:
            yield start + deeper
            yield from _json(value, deeper)
            start = ",\n"
        yield f"\n{indent}]"
    else:
        yield json.dumps(data, allow_nan=False)


def write_parquet(table: pd.DataFrame, path: Path) -> None:
    """Write a Parquet file through DuckDB (libsumo brings an Arrow of its own that pyarrow would clash with)."""
    with duckdb.connect(config={"threads": 1}) as connection:
        connection.register("frame", table)
        try:
            connection.execute(f"COPY frame TO '{str(path).replace(chr(39), chr(39) * 2)}' (FORMAT parquet)")
        except duckdb.IOException as e:
            raise OSError(f"{path.name}: {str(e).splitlines()[0]}") from e


def write_resimulation(result: Resimulation, folder: Path) -> None:
    """Write report.json, tracks, answers and plans, the JSCEN files with their map, run.json."""
    shutil.copyfile(result.recording.map, folder / map_name(result.recording.map))
    for name, scenario in result.scenarios().items():
        write_jscen(scenario, folder / f"{name}.jscen.json")
    write_parquet(result.tracks_frame(), folder / "tracks.parquet")
    write_parquet(result.answers_frame(), folder / "answers.parquet")
    write_parquet(result.plans_frame(), folder / "plans.parquet")
    write_json(result.report(), folder / "report.json")
    write_json(result.provenance(), folder / RUN.mark)


def write_conversion(found: MapCheck, folder: Path) -> None:
    """Write the SUMO net of a map and conversion.json: what is wrong in the map, and every lane's error."""
    name = map_name(found.network.path).removesuffix(".xodr")
    shutil.copyfile(found.net.path, folder / f"{name}.net.xml")
    versions = {p: importlib.metadata.version(p) for p in ("eclipse-sumo", "shapely", "numpy")}
    write_json(
        {"versions": {"resim": resim.__version__, **versions}, **found.report()}, folder / CONVERSION.mark
    )


def write_assessment(found: Assessed, folder: Path) -> None:
    """Write assessment.json and kpis.parquet."""
    versions = {p: importlib.metadata.version(p) for p in ("numpy", "numba", "scipy")}
    write_json(
        {"versions": {"resim": resim.__version__, **versions}, **found.to_json()}, folder / ASSESSMENT.mark
    )
    write_parquet(found.kpi_frame(), folder / "kpis.parquet")
