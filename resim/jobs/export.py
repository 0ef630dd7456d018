"""Write drives in other formats: what `resim export` does."""

from __future__ import annotations

import importlib
import importlib.util
import math
import shutil
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from resim.core import remedies
from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.core.provenance import versions
from resim.core.sealed import read_sealed, sealed
from resim.core.spec import EXACT, to_json
from resim.core.tracks import Tracks
from resim.exports.rocrate import FILE as ROCRATE
from resim.exports.rocrate import crate, write
from resim.jobs.given import path_of
from resim.jobs.labelled import with_maneuvers
from resim.jobs.play import played_drive
from resim.recordings import Recording
from resim.recordings.checked import load_checked
from resim.recordings.window import rows_beyond
from resim.report.player import PlayedDrive, of_recording
from resim.report.player.simulated import broken_off
from resim.resimulation.run import describe_recording
from resim.resimulation.written import read_run
from resim.results import EXPORT, check_output, refuse_within, whole_folder, write_json
from resim.results.folders import (
    ASSESSMENT,
    COMPARISON,
    CONVERSION,
    MINING,
    RELEASE,
    RUN,
    SPACE,
    SWEEP,
    VARIATIONS,
    VERIFICATION,
    check_results,
    locked,
)  # fmt: skip
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.jscen import read_jscen
from resim.scenario.openscenario import STYLES, VERSIONS, openscenario, refuse_without_openscenario
from resim.scenario.scenario import Scenario

PACKED = (RUN, VERIFICATION, SWEEP, VARIATIONS, MINING, SPACE, RELEASE, COMPARISON, CONVERSION, ASSESSMENT)
PACKED_OF = "run, assess, map convert, verify, sweep, vary, mine or space"
"""Folders that are packed as a crate, and the commands that write them."""
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
        notes: What the files leave out, or cannot say, of this drive.
    """

    __pydantic_config__ = EXACT

    versions: Mapping[str, str]
    drive: str
    format: str
    style: str
    sources: Mapping[str, str]
    map: str
    files: Mapping[str, str]
    notes: tuple[str, ...] = ()


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
    check_output(folder, EXPORT, (path,))
    name, network, scenarios, notes = _scenarios(path, accept)
    with whole_folder(folder, EXPORT, (network.path,)) as new:
        road = next(iter(scenarios.values())).map
        shutil.copyfile(network.path, new / road)
        sources = {}
        for source, scenario in scenarios.items():
            sources[source] = f"{source}.xosc"
            text = openscenario(scenario, network, name=f"{name}: {source}", version=version, style=style)
            (new / sources[source]).write_bytes(text)
        files = {file.name: file_hash(file) for file in sorted(new.iterdir())}
        report = ExportReport(
            versions(), name, f"OpenSCENARIO {version}", style, sources, road, files, tuple(notes)
        )
        write_json(sealed(to_json(report)), new / EXPORT.mark)
    return report


@dataclass(frozen=True)
class ExportForm:
    """A form in which a drive is written.

    Attributes:
        title: What it is called.
        module: Has `write`, which writes a drive into a folder and gives the file of each source.
        needs: Packages that are not always there, and the extra that brings each.
        labelled: Whether it holds maneuvers.
        latest: Whole seconds that its clock counts to.
    """

    title: str
    module: str
    needs: Mapping[str, str]
    labelled: bool = False
    latest: float = math.inf


FORMS: Mapping[str, ExportForm] = {
    "osi": ExportForm(
        "OSI", "resim.exports.osi", {"osi3": "osi"},
    ),
    "mcap": ExportForm(
        "MCAP", "resim.exports.mcap", {"osi3": "osi", "mcap": "osi", "foxglove": "foxglove"}, latest=2**32,
    ),
    "rosbag": ExportForm("rosbag2", "resim.exports.rosbag", {"rosbags": "ros"}, latest=2**31),
    "openlabel": ExportForm("OpenLABEL 1.0.0", "resim.exports.openlabel", {}, labelled=True),
    "foxglove": ExportForm(
        "Foxglove", "resim.exports.foxglove", {"mcap": "foxglove", "foxglove": "foxglove"}, latest=2**32,
    ),
}  # fmt: skip
"""By the name of the command; OpenSCENARIO has more to choose from, and a function of its own."""


def export_drive(
    drive: str | Path, out: str | Path, form: str, *, accept: Collection[str] = (), labels: Path | None = None
) -> ExportReport:
    """Write a drive in one of FORMS, with the map beside.

    Args:
        drive: As in `export_openscenario`.
        out: Folder; earlier files of an export there are replaced.
        form: Its name.
        accept: Codes of findings in a recording to continue despite.
        labels: Thresholds and own labels of maneuvers, as `mine` takes them; None for what ships.

    Returns:
        What was written.

    Raises:
        InputError: The drive cannot be read, or the folder not be written, or a package is missing.
    """
    if form not in FORMS:
        raise InputError("export", f"there is no form {form!r}", f"There are {', '.join(FORMS)}.")
    path, folder, made = path_of(drive), path_of(out), FORMS[form]
    if lost := [one for one in made.needs if importlib.util.find_spec(one) is None]:
        extras = ",".join(dict.fromkeys(made.needs.values()))
        raise InputError(
            f"export {form}", f"needs {lost[0]}", f"In resim's own folder: pip install '.[{extras}]'"
        )
    check_output(folder, EXPORT, (path,))
    played = _played(path, accept)
    _check_clock(path, played, made)
    if made.labelled:
        played = with_maneuvers(played, labels)
    with whole_folder(folder, EXPORT, (played.network.path,)) as new:
        road = played.network.path
        sources = importlib.import_module(made.module).write(played, new)
        _copy_map(road, new)
        every = sorted(file for file in new.rglob("*") if file.is_file())
        files = {file.relative_to(new).as_posix(): file_hash(file) for file in every}
        report = ExportReport(
            versions(), played.name, made.title, "", sources, road.name, files, played.notes
        )
        write_json(sealed(to_json(report)), new / EXPORT.mark)
    return report


def _copy_map(road: Path, folder: Path) -> None:
    """Put the map beside the files. Raises InputError where one of them has its name."""
    if (folder / road.name).exists() or road.name == EXPORT.mark:
        raise InputError(
            road, f"has the name of a file of the export, {road.name}", "Give the map another name."
        )
    shutil.copyfile(road, folder / road.name)


def export_rocrate(results: str | Path, out: str | Path) -> ExportReport:
    """Write a folder of results as an RO-Crate: all of its files, and what is in it, what made it, from what.

    Args:
        results: Folder that `resim run`, `assess --out`, `map convert`, `verify`, `sweep`, `vary`, `mine` or `space`
            wrote.
        out: Folder for the crate; an earlier export there is replaced.

    Returns:
        What was written.

    Raises:
        InputError: It is no folder of results, or the folder cannot be written.
    """
    path, folder = path_of(results), path_of(out)
    kind = next(
        (one for one in PACKED if (path / one.mark).is_file()),
        None,
    )
    if kind is None:
        raise InputError(path, "is no folder of results", f"Give what {PACKED_OF} wrote.")
    check_results(path, kind)
    refuse_within(folder, path, f"lies within {path}, which is to be packed")
    check_output(folder, EXPORT, (path,))
    told = read_sealed(path / kind.mark, "Make it again.")
    date = datetime.fromtimestamp((path / kind.mark).stat().st_mtime, UTC).isoformat(timespec="seconds")
    with locked(path, "another command", shared=True), whole_folder(folder, EXPORT) as new:
        shutil.copytree(path, new, dirs_exist_ok=True)
        copied = sorted(file for file in new.rglob("*") if file.is_file())
        about = {file.relative_to(new).as_posix(): (file.stat().st_size, file_hash(file)) for file in copied}
        title = path.resolve().name
        write(new, crate(title, kind.mark, told, about, date))
        files = {name: digest for name, (_, digest) in about.items()}
        files[ROCRATE] = file_hash(new / ROCRATE)
        report = ExportReport(versions(), title, "RO-Crate 1.1", "", {}, "", files)
        write_json(sealed(to_json(report)), new / EXPORT.mark)
    return report


def _check_clock(path: Path, played: PlayedDrive, made: ExportForm) -> None:
    """Raise InputError for times that the clock of a form does not count to; it counts from 0, or the first below."""
    first = min(0.0, *(float(layer.tracks.t[0]) for layer in played.layers))
    last = max(float(layer.tracks.t[-1]) for layer in played.layers)
    if last - first >= made.latest - 1.0:
        problem = f"has times up to {last:g} s, and the clock of {made.title} ends at {made.latest:g} s"
        raise InputError(path, problem, "Give t in seconds, since 1970 or since the start of the drive.")


def _played(path: Path, accept: Collection[str]) -> PlayedDrive:
    """A drive with each object in one track; a recording is refused where it has errors that are not accepted."""
    if (path / "recording.toml").is_file() and not (path / "run.json").is_file():
        recording = load_checked(path, accept=tuple(accept))
        played = recorded_drive(recording, load(recording.map))
    else:
        played = played_drive(path)
    layers = [replace(layer, tracks=layer.tracks.joined()) for layer in played.layers]
    described = path / "GT.jscen.json"
    for k, layer in enumerate(layers):
        if "+M" in layer.name and not layer.is_sensed:
            scenario = read_jscen(described)
            layers[k] = replace(layer, tracks=_with_traffic(layer.tracks, scenario, played.network))
    return replace(played, layers=tuple(layers))


def recorded_drive(recording: Recording, network: RoadNetwork) -> PlayedDrive:
    """Give a recording as it is exported: where SD has no EGO, that of GT does not stand in for it.

    Args:
        recording: With its findings.
        network: Its map.

    Returns:
        The drive.
    """
    played = of_recording(recording, network)
    played = replace(played, notes=(*played.notes, *_left_out(recording)))
    if recording.sd is None or recording.senses_ego:
        return played
    layers = [
        one if one.name != "SD" else replace(one, tracks=one.tracks.without(recording.ego), acceleration=None)
        for one in played.layers
    ]
    return replace(played, layers=tuple(layers))


def _left_out(recording: Recording) -> Iterator[str]:
    """What files do not say of a recording, though verdicts on it depend on it."""
    for source in ("gt", "sd"):
        if len(rows := recording.incomplete.get(source, ())):
            yield f"{source.upper()}: {len(rows)} rows that lack a value are in no file"
        if source in recording.repairs and (count := int(recording.repairs[source]["filled"].sum())):
            yield f"{source.upper()}: {count} samples that a repair filled in are in the files as if they were measured"


def _with_traffic(own: Tracks, scenario: Scenario, network: RoadNetwork) -> Tracks:
    """What a run with a perception model has of its own, among the traffic of the scenario that it is of."""
    others = scenario.tracks(network, own.t).to_frame()
    others = others[~others.id.isin(own.ids.tolist())]
    return Tracks.from_frame(pd.concat([own.to_frame(), others], ignore_index=True))


def _not_described(source: str, tracks: pd.DataFrame, scenario: Scenario) -> Iterator[str]:
    """What a scenario does not have of the tracks that it describes: its time is the EGO's."""
    own = tracks.loc[tracks["id"] == scenario.ego.id, "t"].to_numpy(float)
    if len(own) and (more := rows_beyond(own, tracks)):
        yield f"{source}: {more} rows before the EGO's first or after its last are in no file"
    lost = sorted({*tracks["id"]} - {one.id for one in (scenario.ego, *scenario.objects)})
    if lost:
        yield f"{source}: {len(lost)} objects that no spline describes are in no file: {', '.join(lost[:20])}"


class _Described(NamedTuple):
    """A drive's name, map and scenarios by source, and what they do not say of it."""

    name: str
    network: RoadNetwork
    scenarios: dict[str, Scenario]
    notes: list[str]


def _scenarios(path: Path, accept: Collection[str]) -> _Described:
    """The scenarios of a drive."""
    if path.is_file():
        if path.suffix.lower() not in (".json", ".jscen"):
            raise InputError(path, "is no JSCEN file (.json)", remedies.PLAYED)
        scenario = read_jscen(path)
        name = path.name.removesuffix(".json").removesuffix(".jscen")
        return _Described(name, load(path.parent / scenario.map), {SOURCE_ALONE: scenario}, [])
    if (path / "run.json").is_file():
        run = read_run(path)
        notes = [*broken_off(run.report).values()]
        for source, scenario in run.scenarios.items():
            notes += _not_described(
                source, run.tables.tracks[run.tables.tracks["source"] == source], scenario
            )
        return _Described(run.report.recording, run.network, dict(run.scenarios), notes)
    if (path / "recording.toml").is_file():
        recording = load_checked(path, accept=tuple(accept))
        network = load(recording.map)
        described = {str(basis): one for basis, one in describe_recording(recording, network).items()}
        notes = [*_left_out(recording)]
        for source, tracks in (("GT", recording.gt), ("SD", recording.sd)):
            if source in described and tracks is not None:
                notes += _not_described(source, tracks.to_frame(), described[source])
        return _Described(recording.name, network, described, notes)
    there = (
        "holds neither recording.toml nor run.json" if path.is_dir() else "there is no such file or folder"
    )
    raise InputError(path, there, remedies.PLAYED)
