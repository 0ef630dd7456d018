"""Write drives in other formats: what `resim export` does."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from resim.core import remedies
from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.core.provenance import versions
from resim.core.sealed import sealed
from resim.core.spec import EXACT, to_json
from resim.jobs.given import path_of
from resim.recordings.checked import load_checked
from resim.resimulation.run import describe_recording
from resim.resimulation.written import read_run
from resim.results import EXPORT, check_output, whole_folder, write_json
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.jscen import read_jscen
from resim.scenario.openscenario import STYLES, VERSIONS, openscenario, refuse_without_openscenario
from resim.scenario.scenario import Scenario

SOURCE_ALONE = "scenario"
"""What the one source of a JSCEN file is called."""


@dataclass(frozen=True)
class ExportReport:
    """What export.json says of a folder of exported files.

    Attributes:
        versions: Of what wrote them.
        drive: Its name.
        format: Of the files.
        style: How drives are written: as trajectories, or as routes.
        sources: For each source of the drive its file.
        map: The OpenDRIVE file beside them.
        files: Hashes of all of them.
    """

    __pydantic_config__ = EXACT

    versions: Mapping[str, str]
    drive: str
    format: str
    style: str
    sources: Mapping[str, str]
    map: str
    files: Mapping[str, str]


def export_openscenario(
    drive: str | Path, out: str | Path, *, version: str = "1.2", style: str = "trajectory",
    accept: Collection[str] = (),
) -> ExportReport:  # fmt: skip
    """Write every source of a drive as an OpenSCENARIO file, with the map beside.

    Args:
        drive: A recording (GT, SD), a folder that `resim run` wrote (GT, SD, rGT, rSD), or a JSCEN file.
        out: Folder; earlier files of an export there are replaced.
        version: Of OpenSCENARIO: 1.1, 1.2 or 1.3.
        style: "trajectory", everybody's trace as a polyline over time, or "route", waypoints and a speed over time.
        accept: Codes of findings in a recording to continue despite.

    Returns:
        What was written.

    Raises:
        InputError: The drive cannot be read, or the folder not be written.
    """
    path, folder = path_of(drive), path_of(out)
    if version not in VERSIONS:
        raise InputError("--version", f"is {version!r}, expected {', '.join(VERSIONS)}")
    if style not in STYLES:
        raise InputError("--style", f"is {style!r}, expected {' or '.join(STYLES)}")
    refuse_without_openscenario()
    check_output(folder, EXPORT)
    name, network, scenarios = _scenarios(path, accept)
    with whole_folder(folder, EXPORT) as new:
        road = next(iter(scenarios.values())).map
        shutil.copyfile(network.path, new / road)
        sources = {}
        for source, scenario in scenarios.items():
            sources[source] = f"{source}.xosc"
            text = openscenario(scenario, network, name=f"{name}: {source}", version=version, style=style)
            (new / sources[source]).write_bytes(text)
        files = {file.name: file_hash(file) for file in sorted(new.iterdir())}
        report = ExportReport(versions(), name, f"OpenSCENARIO {version}", style, sources, road, files)
        write_json(sealed(to_json(report)), new / EXPORT.mark)
    return report


def _scenarios(path: Path, accept: Collection[str]) -> tuple[str, RoadNetwork, dict[str, Scenario]]:
    """Name, map and scenarios by source of a drive."""
    if path.is_file():
        if path.suffix.lower() not in (".json", ".jscen"):
            raise InputError(path, "is no JSCEN file (.json)", remedies.PLAYED)
        scenario = read_jscen(path)
        name = path.name.removesuffix(".json").removesuffix(".jscen")
        return name, load(path.parent / scenario.map), {SOURCE_ALONE: scenario}
    if (path / "run.json").is_file():
        run = read_run(path)
        return run.report.recording, run.network, dict(run.scenarios)
    if (path / "recording.toml").is_file():
        recording = load_checked(path, accept=tuple(accept))
        network = load(recording.map)
        return (
            recording.name,
            network,
            {str(k): one for k, one in describe_recording(recording, network).items()},
        )
    there = (
        "holds neither recording.toml nor run.json" if path.is_dir() else "there is no such file or folder"
    )
    raise InputError(path, there, remedies.PLAYED)
