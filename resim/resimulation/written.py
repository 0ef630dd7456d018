"""What `resim run` wrote, read back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from resim.core.errors import InputError
from resim.core.files import check_hashes
from resim.core.schema import PLAN_COLUMNS, SOURCE
from resim.core.spec import read_json, read_sealed_json
from resim.recordings.tables import read_table
from resim.resimulation.report import RunProvenance, RunReport
from resim.resimulation.run import map_name
from resim.resimulation.run_blocks import RunTables, described_runs
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.jscen import read_jscen
from resim.scenario.scenario import Scenario

SOURCES = ("GT", "SD", "rGT", "rSD")
"""What is described by a JSCEN file, in the order of the tables."""
REMEDY = "Run it again."


@dataclass(frozen=True, eq=False)
class WrittenRun:
    """A folder that `resim run` wrote: report.json, the map, the JSCEN files by source, and the tables."""

    report: RunReport
    network: RoadNetwork
    scenarios: Mapping[str, Scenario]
    tables: RunTables


def read_run(folder: Path) -> WrittenRun:
    """Read a folder that `resim run` wrote. Raises InputError where a file is missing or not as it was written."""
    report, mark = folder / "report.json", folder / "run.json"
    hashes = read_sealed_json(mark, RunProvenance, "resim run", REMEDY).files
    check_hashes(folder, hashes, REMEDY)
    written = read_json(report, RunReport, "resim run", REMEDY)
    try:
        road = folder / map_name(Path(written.map))
    except ValueError as e:
        raise InputError(report, "is not what `resim run` writes", REMEDY) from e
    read = (report.name, road.name, "tracks.parquet", "answers.parquet", "plans.parquet")
    if lost := [file for file in read if file not in hashes]:
        raise InputError(mark, f"has no checksum of {lost[0]}", REMEDY)
    network = load(road)
    files = {name: folder / f"{name}.jscen.json" for name in SOURCES}
    scenarios = {name: read_jscen(path) for name, path in files.items() if path.name in hashes}
    tables = RunTables(
        read_table(
            folder / "tracks.parquet",
            required=(SOURCE, "t", "id", "x", "y"),
            text=(SOURCE, "id", "kind"),
            optional=("heading", "v", "length", "width", "kind"),
        ),
        _table(folder / "answers.parquet", (SOURCE, "t")),
        _table(folder / "plans.parquet", (SOURCE, *PLAN_COLUMNS)),
    )
    try:
        wanted = ("GT", *described_runs(written))
    except (ValueError, KeyError, TypeError) as e:
        raise InputError(report, "is not what `resim run` writes", REMEDY) from e
    if lost := [basis for basis in wanted if basis not in scenarios]:
        raise InputError(folder, f"{lost[0]}.jscen.json is missing", REMEDY)
    return WrittenRun(written, network, scenarios, tables)


def _table(path: Path, columns: tuple[str, ...]) -> pd.DataFrame:
    return read_table(path, required=columns, text=("source",), may_be_empty=True)
