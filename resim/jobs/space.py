"""The scenario space: what `resim space` does."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import pandas as pd

from resim.core.errors import InputError
from resim.core.files import check_hashes, file_hash, relative
from resim.core.provenance import versions
from resim.core.sealed import sealed
from resim.core.spec import read_sealed_json, read_strict, to_json
from resim.jobs.given import path_of
from resim.jobs.space_drives import driven_traces
from resim.jobs.space_members import (
    TRAFFIC,
    Simulated,
    SpaceReading,
    accidents,
    one_build,
    read_simulated,
)
from resim.jobs.space_recordings import RecordingReader
from resim.recordings.tables import read_parquet
from resim.report.markup import Markup
from resim.report.notebook import notebook_html
from resim.results import (
    COMPARISON,
    RELEASE,
    SPACE,
    explain_os_errors,
    locked,
    whole_folder,
    write_json,
    write_parquet,
)
from resim.space.build import BucketDone, build_space, grow_space, usual_threshold
from resim.space.clustering import PUBLISHED_THRESHOLD
from resim.space.comparison import SpaceComparison, compare_spaces, together
from resim.space.folder import REMEDY, read_report, read_space, write_space
from resim.space.held_out import held_out_calibration, mined_whole
from resim.space.limits import read_limits
from resim.space.members import (
    SimulatedRun,
    TestDrive,
    judged_members,
    not_mined,
)
from resim.space.model import Space
from resim.space.page import (
    write_comparison_page,
    write_cover_page,
    write_release_page,
    write_space_page,
)
from resim.space.release import decide
from resim.space.release_report import ReleaseReport
from resim.space.report import MARK, SpaceReport
from resim.space.risk import MARK as COVER
from resim.space.risk import CoverReport, GivenFolder, cluster_risks, cover_notes
from resim.space.settings import DEFAULT_SETTINGS, SpaceSettings
from resim.space.sources import read_mined

EXAMPLE = "See docs/guides/space.md."
COVER_AGAIN = "Cover the space again with `resim space cover`."


@dataclass(frozen=True)
class SpaceResult:
    """A scenario space. Shows itself in a notebook.

    Attributes:
        folder: Where it is.
        report: What space.json says.
    """

    folder: Path
    report: SpaceReport = field(repr=False)

    @cached_property
    def clusters(self) -> pd.DataFrame:
        """A row per scenario: bucket, cluster, whether it is its medoid, distance to the medoid."""
        return read_parquet(self.folder / "clusters.parquet")

    @cached_property
    def distances(self) -> pd.DataFrame:
        """A row per pair of scenarios of a bucket: bucket, one, two, distance."""
        return read_parquet(self.folder / "distances.parquet")

    def _repr_html_(self) -> str:
        told = f"{self.report.scenarios} scenarios in {len(self.report.clusters())} clusters"
        return notebook_html(told, Markup(), {"clusters": self.clusters})


def read_space_settings(file: str | Path) -> SpaceSettings:
    """Read how a space is built from a TOML file.

    Args:
        file: Its path.

    Returns:
        The settings; what the file does not say is as published.

    Raises:
        InputError: It is wrong.
    """
    return read_strict(path_of(file), SpaceSettings, EXAMPLE)


def build(
    mined: Sequence[str | Path],
    out: str | Path,
    settings: SpaceSettings = DEFAULT_SETTINGS,
    *,
    workers: int | None = None,
    done: BucketDone = lambda bucket, scenarios, clusters: None,
) -> SpaceResult:
    """Build a scenario space from what `resim mine` wrote.

    Args:
        mined: Folders that `resim mine` wrote.
        out: Folder to write; an earlier space there is replaced.
        settings: How scenarios are compared and clustered.
        workers: Threads; all cores, if None.
        done: Hears of each bucket that was clustered: its name, and how many scenarios and clusters it has.

    Returns:
        The space.

    Raises:
        InputError: A folder is none of `resim mine`, or there is no scenario.
    """
    folders = [path_of(one) for one in mined]
    if not folders:
        raise InputError("MINED", "no folder is given", "Name a folder that `resim mine` wrote.")
    count = workers or os.cpu_count() or 1
    space = build_space([read_mined(one) for one in folders], settings, count, done)
    return _write(space, path_of(out), folders, count)


def grow(
    space: str | Path,
    mined: Sequence[str | Path],
    out: str | Path | None = None,
    *,
    workers: int | None = None,
    done: BucketDone = lambda bucket, scenarios, clusters: None,
) -> SpaceResult:
    """Put more drives into a space. Its clusters keep their names and medoids; the order of drives does not matter.

    Args:
        space: Folder of the space.
        mined: Folders that `resim mine` wrote.
        out: Folder to write; the space's own, if None.
        workers: Threads; all cores, if None.
        done: Hears of each bucket that was clustered: its name, and how many scenarios and clusters it has.

    Returns:
        The grown space.

    Raises:
        InputError: A folder is none of `resim mine`, or is in the space already.
    """
    folders = [path_of(one) for one in mined]
    count = workers or os.cpu_count() or 1
    found, _ = read_space(path_of(space))
    grown = grow_space(found, [read_mined(one) for one in folders], count, done)
    return _write(grown, path_of(space if out is None else out), folders, count)


def read_result(folder: str | Path) -> SpaceResult:
    """Read a space.

    Args:
        folder: Its folder.

    Returns:
        The space.

    Raises:
        InputError: It is none, or was changed.
    """
    where = path_of(folder)
    report = read_report(where)
    check_hashes(where, report.files, REMEDY)
    return SpaceResult(where, report)


@dataclass(frozen=True)
class CoverOptions:
    """How simulated drives cover a space.

    Attributes:
        within: Slot distance to a verified test drive up to which a simulated member counts; the space's usual
            threshold, but not above the published one, if None.
        held_out: Folders of sweeps or verifications whose collisions calibrate predicted risk, and are no members.
    """

    within: float | None = None
    held_out: tuple[Path, ...] = ()


def cover(
    space: str | Path, simulated: Sequence[str | Path], options: CoverOptions = CoverOptions()
) -> CoverReport:
    """Put simulated drives into a space, say which of them count, and how risky each cluster is.

    Writes cover.json, cover.html and members.parquet into the space's folder, and traffic.toml where commands that
    repeat members need it.

    Args:
        space: Folder of the space.
        simulated: Folders of `resim sweep` and of `resim verify`, of one build and perception model.
        options: What counts, and what calibrates.

    Returns:
        What cover.json says.

    Raises:
        InputError: A folder is none of these, or they are of several builds or models.
    """
    folder, (found, told) = path_of(space), read_space(path_of(space))
    farthest = found.settings.distance.longest
    usual = min(usual_threshold(found), PUBLISHED_THRESHOLD)
    within = usual if options.within is None else _within(options.within, farthest)
    how = SpaceReading(folder, RecordingReader())
    given = [(path_of(one), read_simulated(path_of(one), how)) for one in simulated]
    held = [(path_of(one), read_simulated(path_of(one), how)) for one in options.held_out]
    if not given:
        raise InputError(
            "--sweep", "no simulated drive is given", "Name a folder of `resim sweep` or `resim verify`."
        )
    first = one_build([*given, *held])
    every = [one for _, one in given]
    known = driven_traces(found, [*every, *(one for _, one in held)])
    drives = _test_drives(every, [one for _, one in held])
    members = judged_members(found, [run for one in every for run in one.runs], drives, known, within)
    spared = _spared(every, [one for _, one in held])
    risks = cluster_risks(found, members, first.build, {known.scenario[run.recording] for run in spared})
    calibration = None if not held else held_out_calibration(found, members, first.build, spared, known)
    with locked(folder, "another `resim space`"), explain_os_errors(folder):
        files = _write_members(folder, members, next((one.traffic for one in every if one.traffic), ""))
        report = CoverReport(
            versions(), files, file_hash(folder / MARK), first.build, first.label, first.perception, within,
            _told(folder, given), _told(folder, held), _verified(drives),
            not_mined(found, accidents(one for _, one in (*given, *held)), known), risks, calibration,
            (*cover_notes(members, drives), *mined_whole(found, spared, known),
             *{one.judged: None for _, one in (*given, *held) if one.judged}),
        )  # fmt: skip
        write_json(sealed(to_json(report)), folder / COVER)
        write_cover_page(found, told, report, folder)
    return report


def _told(space: Path, given: Sequence[tuple[Path, Simulated]]) -> dict[str, GivenFolder]:
    """How many runs each folder holds, and its hash, by its path from the space's."""
    where = Path(os.path.realpath(space))
    return {
        relative(Path(os.path.realpath(folder)), where): GivenFolder(
            len(one.runs), file_hash(folder / one.mark)
        )
        for folder, one in given
    }


def _test_drives(given: Sequence[Simulated], held: Sequence[Simulated]) -> list[TestDrive]:
    """What was verified, or was to be, and what is held out and is not verified, which contradicts it."""
    contradicting = [drive for one in held for drive in one.drives if drive.verdict != "verified"]
    return [*(drive for one in given for drive in one.drives), *contradicting]


def _spared(given: Sequence[Simulated], held: Sequence[Simulated]) -> list[SimulatedRun]:
    """The runs that are held out. Raises InputError where one is a member as well, or is there twice."""
    spared = [run for one in held for run in one.runs]
    members_of = {run.same for one in given for run in one.runs}
    if twice := [run.name for run in spared if run.same in members_of]:
        raise InputError("--held-out", f"{twice[0]} is a member as well", "Hold other drives out.")
    if len({run.same for run in spared}) < len(spared):
        raise InputError("--held-out", "the same run is there twice", "Name each drive once.")
    return spared


def _write_members(folder: Path, members: pd.DataFrame, traffic: str) -> dict[str, str]:
    """Write the table of members, and how traffic reacts for its commands ("" for as usual); gives their hashes."""
    write_parquet(members, folder / "members.parquet")
    (folder / TRAFFIC).unlink(missing_ok=True)
    if traffic:
        (folder / TRAFFIC).write_text(traffic, encoding="utf-8", newline="\n")
    names = ("members.parquet", TRAFFIC) if traffic else ("members.parquet",)
    return {name: file_hash(folder / name) for name in names}


def _within(distance: float, farthest: float) -> float:
    """Give the distance back. Raises InputError where it is none."""
    if not 0.0 <= distance <= farthest:
        raise InputError("--within", f"expected 0 to {farthest:g}, found {distance:g}")
    return distance


def _verified(drives: Sequence[TestDrive]) -> int:
    return sum(one.own and one.verdict == "verified" for one in drives)


def read_cover(folder: Path) -> CoverReport | None:
    """Read what covers a space.

    Args:
        folder: Of the space.

    Returns:
        What cover.json says; None where nothing covers it.

    Raises:
        InputError: It was changed, or is of another state of the space.
    """
    path = folder / COVER
    if not path.is_file():
        return None
    found = read_sealed_json(path, CoverReport, "resim space cover", COVER_AGAIN)
    check_hashes(folder, found.files, COVER_AGAIN)
    if found.space != file_hash(folder / MARK):
        raise InputError(path, "is of another state of the space", COVER_AGAIN)
    return found


def release(space: str | Path, limits: str | Path, out: str | Path) -> ReleaseReport:
    """Decide whether the function may be released.

    Args:
        space: Folder of the space, covered or not.
        limits: TOML file of limits.
        out: Folder to write: release.json, release.html.

    Returns:
        The verdict: `good`, `bad`, or `not shown`, with what forbids it and what to do next.

    Raises:
        InputError: A file is wrong.
    """
    folder, target = path_of(space), path_of(out)
    found, _ = read_space(folder)
    covered = read_cover(folder)
    asked, digest = read_limits(path_of(limits))
    hashes = {"space": file_hash(folder / MARK), "limits": digest,
              "cover": "" if covered is None else file_hash(folder / COVER)}  # fmt: skip
    report = decide(found, covered, asked, hashes)
    with whole_folder(target, RELEASE, [folder, path_of(limits)]) as beside:
        write_json(sealed(to_json(report)), beside / RELEASE.mark)
        write_release_page(report, covered, beside)
    return report


def compare(
    one: str | Path, other: str | Path, out: str | Path, *, workers: int | None = None
) -> SpaceComparison:
    """Compare two spaces: what is in one only, and how far apart the shares of kinds are.

    Args:
        one: Folder of a space.
        other: Folder of another.
        out: Folder to write: comparison.json, comparison.html.
        workers: Threads; all cores, if None.

    Returns:
        The comparison.

    Raises:
        InputError: A folder is no space, or they are built in different ways.
    """
    folders = [path_of(one), path_of(other)]
    (first, _), (second, _) = (read_space(folder) for folder in folders)
    both = together(first, second, workers or os.cpu_count() or 1)
    hashes = file_hash(folders[0] / MARK), file_hash(folders[1] / MARK)
    found = compare_spaces(both, (folders[0].name, folders[1].name), hashes)
    with whole_folder(path_of(out), COMPARISON, folders) as beside:
        write_json(sealed(to_json(found)), beside / COMPARISON.mark)
        write_comparison_page(found, beside)
    return found


def _write(space: Space, out: Path, inputs: Sequence[Path], workers: int) -> SpaceResult:
    with whole_folder(out, SPACE, inputs) as beside:
        told = write_space(space, beside, workers)
        write_space_page(space, told, beside)
    return SpaceResult(out, told)
