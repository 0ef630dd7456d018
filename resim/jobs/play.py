"""See a drive: what `resim play` does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from resim.core import remedies
from resim.core.errors import InputError
from resim.core.files import check_hashes, file_hash
from resim.core.spec import read_sealed_json
from resim.jobs.given import path_of
from resim.jobs.vary import ORIGIN, SCENARIOS, read_variations
from resim.metrics.assessment_report import DriveAssessment
from resim.recordings.checked import load_checked
from resim.recordings.checks import CODES
from resim.report import write_player_page
from resim.report.player import PlayedDrive, of_recording, of_run, of_scenario, of_variations
from resim.report.player.drive import DriveVerdict
from resim.report.player.together import together
from resim.report.player.video import check_video, write_video
from resim.resimulation import AssessmentOptions, assess_recording
from resim.resimulation.assessment_report import RunAssessment
from resim.resimulation.written import read_run
from resim.results import whole_file
from resim.results.reading import LARGEST
from resim.road.flaws import MAP_CODES
from resim.road.opendrive import load
from resim.scenario.jscen import read_jscen
from resim.variations.report import MARK

KINDS = remedies.PLAYED
BUNDLED = 60
"""Variations that are shown around their origin: more are a blot."""
OTHERS = {
    "verification.json": "the folder of `resim verify`: the player of each recording is in its drives/",
    "inputs.json": "the folder of `resim verify`: the player of each recording is in its drives/",
    "sweep.json": "the folder of `resim sweep`, which keeps no drives",
    "assessment.json": "the folder of `resim assess`: play what was assessed",
    "conversion.json": "the folder of `resim map convert`, which has no drive",
}
"""Folders of resim's in which there is no drive to play, by a file in them."""


def play(
    drives: Sequence[str | Path], out: str | Path, *, assess: bool = False, above: bool = False,
    video: str | Path | None = None,
) -> list[PlayedDrive]:  # fmt: skip
    """Write a page that plays drives.

    Args:
        drives: Recordings, folders that `resim run` or `resim vary` wrote, JSCEN files; played one after the other.
        out: Page (.html) to write.
        assess: Whether recordings are assessed for curves of risk and TTC; results have theirs.
        above: Whether all are shown above each other, as one drive, instead of one after the other.
        video: File (.mp4 or .gif) to film the first drive into; needs chromium and playwright, for mp4 ffmpeg.

    Returns:
        The drives, in the order of the page.

    Raises:
        InputError: A drive cannot be read, or the page cannot be written.
    """
    if not drives:
        raise InputError("resim play", "no drive is given", KINDS)
    film = None if video is None else path_of(video)
    if film is not None:
        check_video(film)
    with whole_file(path_of(out)) as beside:
        played = [played_drive(path_of(drive), assess=assess) for drive in drives]
        if above:
            played = [together(played)]
        write_player_page(played, beside)
    if film is not None:
        times = [t for layer in played[0].layers for t in layer.tracks.t[[0, -1]].tolist()]
        with whole_file(film, None) as beside:
            write_video(path_of(out), beside, film.suffix.lower(), min(times), max(times))
    return played


def played_drive(path: Path, *, assess: bool = False) -> PlayedDrive:
    """Give the drive at a path as the player shows it.

    Args:
        path: A recording, a folder that `resim run` or `resim vary` wrote, or a JSCEN file.
        assess: Whether a recording is assessed for curves of risk and TTC.

    Returns:
        The drive.

    Raises:
        InputError: There is no drive to play.
    """
    if path.is_file():
        return _scenario(path)
    if (path / "run.json").is_file():
        return _result(path)
    if (path / MARK).is_file():
        return _variations(path)
    if (path / "recording.toml").is_file():
        return _recording(path, assess=assess)
    if not path.is_dir():
        raise InputError(path, "there is no such file or folder", KINDS)
    told = next((words for name, words in OTHERS.items() if (path / name).is_file()), None)
    raise InputError(
        path, "holds neither recording.toml nor run.json" if told is None else f"is {told}", KINDS
    )


def _recording(path: Path, *, assess: bool) -> PlayedDrive:
    """A recording with all that is wrong with it: the findings are marks."""
    recording = load_checked(path, accept=[*CODES, *MAP_CODES])
    found = assess_recording(recording, AssessmentOptions()).blocks if assess else None
    return of_recording(recording, load(recording.map), found)


def _result(path: Path) -> PlayedDrive:
    run = read_run(path)
    found, judged = {}, None
    if (path / "assessment.json").is_file():
        told = read_sealed_json(
            path / "assessment.json", RunAssessment, "resim run", "Run it again.", largest=LARGEST
        )
        if told.inputs.run != file_hash(path / "report.json"):
            problem = "is of another run than run.json and report.json beside it"
            raise InputError(path / "assessment.json", problem, "Run it again.")
        every = {name: getattr(told, name) for name in ("GT", "SD", "rGT", "rSD")}
        found = {name: a for name, a in every.items() if hasattr(a, "measures")}
        judged = _judged(told, found)
    return replace(of_run(run.report, run.network, run.scenarios, run.tables, found), judged=judged)


def _variations(path: Path) -> PlayedDrive:
    """The origin of a folder of variations, and the first of these as a bundle around it."""
    made = read_variations(path)
    files = made.table.loc[made.table["file"] != "", ["variation", "file"]].head(BUNDLED)
    if not len(files):
        raise InputError(path, "has no scenarios to play", "Vary the recording without --rows.")
    origin = path / SCENARIOS / ORIGIN
    check_hashes(path, {name: made.report.files[name] for name in files["file"]}, "Vary the recording again.")
    scenario = read_jscen(origin)
    numbers = zip(files["variation"].tolist(), files["file"].tolist(), strict=True)
    varied = {int(number): read_jscen(path / str(file)) for number, file in numbers}
    objects = dict.fromkeys(one.partition(":")[0] for one in made.report.inputs.maneuvers)
    return of_variations(
        scenario, varied, [*objects], load(origin.parent / scenario.map), made.report.inputs.recording
    )


def _judged(told: RunAssessment, found: Mapping[str, DriveAssessment]) -> DriveVerdict | None:
    """The verdict on a run: that of those who decide, the worst first; who failed before it was judged is INVALID."""
    sources = {name: a.verdict for name, a in found.items() if a.verdict is not None}
    if (model := getattr(told.over_seeds, "verdict", None)) is not None:
        sources["rGT+M"] = model
    if not sources:
        return None
    deciding = {sources.get(name, "INVALID") for name in told.decides}
    verdict = next((one for one in ("FAIL", "INVALID", "PASS") if one in deciding), "INVALID")
    return DriveVerdict(verdict, sources, told.decides)


def _scenario(path: Path) -> PlayedDrive:
    if path.suffix.lower() not in (".json", ".jscen"):
        raise InputError(path, "is no JSCEN file (.json)", KINDS)
    scenario = read_jscen(path)
    return of_scenario(
        scenario, load(path.parent / scenario.map), path.name.removesuffix(".json").removesuffix(".jscen")
    )
