"""Results as files: JSON and Parquet, the same bytes for the same result, and what each job writes of them."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import duckdb

from resim.core.errors import InputError
from resim.core.files import file_hash, plain_names
from resim.core.json_text import json_text
from resim.core.sealed import sealed
from resim.core.spec import read_json, read_sealed_json, to_json
from resim.results.folders import ASSESSMENT, CONVERSION, RUN

if TYPE_CHECKING:  # the catalog lists results without loading all that makes them
    import pandas as pd

    from resim.resimulation import MapCheck, Resimulation, ResimulationAssessment
    from resim.resimulation.assessment_report import HashedBuild, HashedName


RECORDED = "recorded.toml"
"""Build file of the conversations beside it."""


def write_json(data: Any, path: Path) -> None:
    """Write JSON, the same bytes for the same data, an array of numbers or texts in one line; NaN is refused."""
    path.write_text(json_text(data), encoding="utf-8")


def write_parquet(table: pd.DataFrame, path: Path) -> None:
    """Write a Parquet file through DuckDB (libsumo brings an Arrow of its own that pyarrow would clash with)."""
    with duckdb.connect(config={"threads": 1}) as connection:
        connection.register("frame", table)
        try:
            connection.execute(f"COPY frame TO '{str(path).replace(chr(39), chr(39) * 2)}' (FORMAT parquet)")
        except duckdb.IOException as e:
            raise OSError(f"{path.name}: {str(e).splitlines()[0]}") from e


def merge_parquet(parts: Sequence[Path], path: Path) -> None:
    """Write the rows of Parquet files one after the other as one; columns that a part lacks are NULL there.

    One part after the other is in memory.
    """
    with duckdb.connect(config={"threads": 1}) as connection, plain_names(parts) as names:
        out = str(path).replace("'", "''")
        query = "SELECT * FROM read_parquet($names, union_by_name = true, hive_partitioning = false)"
        connection.execute(f"COPY ({query}) TO '{out}' (FORMAT parquet)", {"names": [*names]})


def write_resimulation(result: Resimulation, folder: Path) -> None:
    """Write report.json, tracks, answers and plans, the JSCEN files with their map, what the function said and was
    asked, and run.json with their hashes."""
    from resim.resimulation import map_name
    from resim.resimulation.report import provenance
    from resim.resimulation.tables import answers_frame, plans_frame, tracks_frame
    from resim.scenario.jscen import write_jscen

    road = map_name(result.recording.map)
    shutil.copyfile(result.recording.map, folder / road)
    scenarios = {f"{name}.jscen.json": scenario for name, scenario in result.scenarios().items()}
    for name, scenario in scenarios.items():
        write_jscen(scenario, folder / name)
    frames = {"tracks": tracks_frame, "answers": answers_frame, "plans": plans_frame}
    tables = {f"{name}.parquet": frame for name, frame in frames.items()}
    for name, frame in tables.items():
        write_parquet(frame(result), folder / name)
    write_json(to_json(result.report), folder / "report.json")
    said = [*_words(result, folder), *_conversations(result, folder)]
    files = {
        name: file_hash(folder / name) for name in sorted([road, *scenarios, *tables, *said, "report.json"])
    }
    write_json(sealed(to_json(provenance(result, files))), folder / RUN.mark)


def _words(result: Resimulation, folder: Path) -> Iterator[str]:
    """Write what the function wrote to the standard error, a file a run, and give the names."""
    for source, drive in result.drives.items():
        if drive.said:
            (folder / f"{source}.words.txt").write_text(drive.said, encoding="utf-8", newline="")
            yield f"{source}.words.txt"


def _conversations(result: Resimulation, folder: Path) -> Iterator[str]:
    """Write what was said to a process and by it, a file a run, with a build file of them, and give the names."""
    from resim.simulation.function.conversation import SUFFIX, Conversation, Speaker, build_file

    build = result.build
    speaker = Speaker(build.name, build.version, build.hash, build.cycle_time, build.time_limit)
    recorded = {f"{source}{SUFFIX}": drive for source, drive in result.drives.items() if drive.exchanges}
    for name, drive in recorded.items():
        (folder / name).write_bytes(Conversation(speaker, drive.exchanges, drive.failure).packed())
        yield name
    if recorded:
        (folder / RECORDED).write_text(build_file(speaker), encoding="utf-8", newline="\n")
        yield RECORDED


def write_conversion(found: MapCheck, folder: Path) -> None:
    """Write a map's SUMO nets, exact and for simulations, and conversion.json: flaws, every lane's error."""
    from resim.resimulation import map_name

    name = map_name(found.network.path).removesuffix(".xodr")
    nets = {
        folder / f"{name}.net.xml": found.net.path,
        folder / f"{name}.simulated.net.xml": found.net.simulated,
    }
    for net, made in nets.items():
        shutil.copyfile(made, net)
    report = found.report({net.name: file_hash(net) for net in nets})
    write_json(sealed(to_json(report)), folder / CONVERSION.mark)


def write_assessment(found: ResimulationAssessment, folder: Path, drive: Path) -> None:
    """Write assessment.json and kpis.parquet. drive: the folder that was assessed, of a recording or a run."""
    write_json(assessment_document(found, drive), folder / ASSESSMENT.mark)
    write_parquet(found.kpi_frame(), folder / "kpis.parquet")


def assessment_document(found: ResimulationAssessment, drive: Path) -> dict[str, Any]:
    """Give what assessment.json says, as `write_assessment`."""
    from resim.resimulation.assessment_report import AssessmentInputs, HashedName, report

    recording, build, run = _drive_inputs(drive, found.name)
    criteria = None if found.criteria is None else HashedName(found.criteria.name, found.criteria.hash)
    return sealed(to_json(report(found, AssessmentInputs(recording, build, criteria, run))))


def _drive_inputs(drive: Path, name: str) -> tuple[HashedName, HashedBuild | None, str | None]:
    """The recording, the build and the hash of report.json of what `resim run` wrote, or of a recording, without it."""
    from resim.recordings.content import content_hash, hash_of_hashes
    from resim.recordings.settings import SETTINGS, read_settings
    from resim.resimulation.assessment_report import HashedBuild, HashedName
    from resim.resimulation.report import RunProvenance, RunReport

    if (mark := drive / RUN.mark).is_file():
        remedy = "Run it again."
        try:
            told = read_sealed_json(mark, RunProvenance, "resim run", remedy)
            hashes = told.hashes
            build = read_json(drive / "report.json", RunReport, "resim run", remedy).build
            return (
                HashedName(name, hash_of_hashes(hashes, hashes["map"])),
                HashedBuild(f"{build.name}-{build.version}", hashes["build"]),
                told.files["report.json"],
            )
        except (KeyError, ValueError) as e:
            raise InputError(mark, "is not what `resim run` writes", remedy) from e
    settings = read_settings(drive / SETTINGS)
    drove = None if settings.build is None else HashedBuild(settings.build, settings.build_hash)
    return HashedName(name, content_hash(drive)), drove, None
