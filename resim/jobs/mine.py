"""Find the scenarios of recordings: what `resim mine` does."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import pandas as pd

from resim.core.errors import InputError, ResimError
from resim.core.files import file_hash
from resim.core.plugins.frozen import FrozenFile
from resim.core.provenance import versions
from resim.core.sealed import sealed
from resim.core.spec import read_sealed_json, to_json
from resim.core.spelling import unknown
from resim.execution.child import Failure
from resim.execution.workers import run_all
from resim.jobs.given import path_of
from resim.jobs.play import play
from resim.mining.around import AroundOptions, moments_finder
from resim.mining.maneuver import label_names
from resim.mining.own_labels import LIMIT, MiningRules, read_rules, rules_of
from resim.mining.page import write_mined_page, write_scenario_picture
from resim.mining.report import MARK, MinedFailure, MiningReport
from resim.mining.study import MinedPart, StudyOptions, mine_into, own_extraction, seen_from
from resim.mining.study_run import finished
from resim.recordings import read_recording
from resim.recordings.settings import SETTINGS
from resim.recordings.tables import read_parquet
from resim.report.markup import Markup
from resim.report.notebook import notebook_html
from resim.results import (
    MINING,
    PICTURE,
    check_own,
    explain_os_errors,
    locked,
    merge_parquet,
    refuse_within,
    whole_file,
    write_json,
)
from resim.road.opendrive import load

TABLES = ("maneuvers", "scenarios", "slots")
SURROUNDINGS = "surroundings"
"""Asks for the scenarios of extraction, of each recording's own EGO alone."""


@dataclass(frozen=True)
class MineOptions:
    """How to mine.

    Attributes:
        labels: File of thresholds and own labels; None for what ships.
        around: Which moments of each recording's own EGO are cut out in place of extraction: a measure, a label,
            `surroundings` for what extraction gives of this EGO alone, or `decision`, with the windows of the
            thresholds; or options of one's own.
        accept: Codes of findings to continue despite.
        write: Whether scenarios are written as recordings.
        fit: Whether they are fitted and written as JSCEN files.
        resume: Whether the folder may hold an earlier study, of which all is kept that is as it would be.
        workers: Processes that fit scenarios; all cores, if None. The results do not depend on it.
    """

    labels: Path | None = None
    around: AroundOptions | str | None = None
    accept: tuple[str, ...] = ()
    write: bool = True
    fit: bool = True
    resume: bool = False
    workers: int | None = None


@dataclass(frozen=True)
class MiningResult:
    """What was mined. Shows itself in a notebook.

    Attributes:
        folder: Where it is.
        report: What mined.json says.
    """

    folder: Path
    report: MiningReport = field(repr=False)

    @cached_property
    def maneuvers(self) -> pd.DataFrame:
        """A row per label: recording, object, label, start, end, t [s], partner, lanes, figures."""
        return read_parquet(self.folder / "maneuvers.parquet")

    @cached_property
    def scenarios(self) -> pd.DataFrame:
        """A row per scenario: recording, EGO, window [s], bucket, tags, members, figures, files."""
        return read_parquet(self.folder / "scenarios.parquet")

    @property
    def labels(self) -> dict[str, int]:
        """How many there are of each label."""
        total: Counter[str] = Counter()
        for part in self.report.parts:
            total.update(part.labels)
        return dict(total)

    def _repr_html_(self) -> str:
        told = f"{len(self.report.parts)} recordings mined, {len(self.report.failures)} not"
        return notebook_html(told, Markup(), {"scenarios": self.scenarios, "maneuvers": self.maneuvers})


def mine(
    recordings: Sequence[str | Path],
    out: str | Path,
    options: MineOptions = MineOptions(),
    *,
    heard: Callable[[MinedPart | MinedFailure], None] = lambda told: None,
) -> MiningResult:
    """Find the maneuvers of recordings, and cut their scenarios out.

    Args:
        recordings: Their folders.
        out: Folder to write.
        options: Thresholds, what is cut out, and how it is written.
        heard: Hears of each recording when it is mined, or why it is not.

    Returns:
        What was found; recordings that cannot be mined are told of, and the others are mined all the same.

    Raises:
        InputError: The file of thresholds is wrong, no recording could be mined, or the folder holds something else.
    """
    folders = [path_of(one) for one in recordings]
    target = path_of(out)
    _check_target(target, options.resume, [*folders, *([] if options.labels is None else [options.labels])])
    study = _study(options)
    with explain_os_errors(target), locked(target, "another `resim mine`"):
        (target / MARK).unlink(missing_ok=True)
        named = _named(folders)
        told: dict[str, MinedPart | MinedFailure] = {}
        workers = options.workers or os.cpu_count() or 1
        for one in finished(_mined(named, target, study, options, workers), target, workers):
            heard(one)
            told[one.recording] = one if isinstance(one, MinedFailure) else replace(one, files={})
        parts = [one for name in named if isinstance(one := told[name], MinedPart)]
        failures = [one for name in named if isinstance(one := told[name], MinedFailure)]
        if not parts:
            raise InputError(target, f"no recording could be mined: {failures[0].why}", "See `resim check`.")
        return _finish(target, study, parts, failures)


@dataclass(frozen=True, eq=False)
class _MineTask:
    """A recording to be mined by labels of the user's own, from their frozen copy."""

    name: str
    folder: Path
    target: Path
    rules: FrozenFile
    options: MineOptions


def _mine_task(task: _MineTask) -> MinedPart | str:
    """Mine a recording in a child: gives what was found, or why it cannot be mined."""
    try:
        return mine_into(task.folder, task.name, task.target, _study_of(rules_of(task.rules), task.options))
    except ResimError as e:
        return str(e)


def _mined(
    named: Mapping[str, Path], target: Path, study: StudyOptions, options: MineOptions, workers: int
) -> Iterator[MinedPart | MinedFailure]:
    """Mine each recording, in children that can be ended where the user's code has a say; in their order."""
    if not study.rules.own or study.rules.frozen is None:
        for name, folder in named.items():
            try:
                yield mine_into(folder, name, target, study)
            except ResimError as e:
                yield MinedFailure(name, seen_from(target, folder), str(e))
        return
    tasks = [_MineTask(name, folder, target, study.rules.frozen, options) for name, folder in named.items()]
    limit = LIMIT * (1 + len(study.rules.own))
    found = dict(run_all(_mine_task, tasks, workers=min(workers, len(tasks)), time_limit=limit))
    for k, task in enumerate(tasks):
        told = found[k]
        why = told.reason if isinstance(told, Failure) else told
        yield MinedFailure(task.name, seen_from(target, task.folder), why) if isinstance(why, str) else why


def read_mined(folder: str | Path) -> MiningResult:
    """Read what `resim mine` wrote.

    Args:
        folder: Its folder.

    Returns:
        What was found.

    Raises:
        InputError: It is none, or was changed.
    """
    where = path_of(folder)
    report = read_sealed_json(where / MARK, MiningReport, "resim mine", "Mine the recordings again.")
    return MiningResult(where, report)


def draw_scenario(found: MiningResult, name: str, file: str | Path) -> None:
    """Draw a scenario from above.

    Args:
        found: What `resim mine` wrote.
        name: Of the scenario.
        file: SVG file to write.

    Raises:
        InputError: There is no such scenario, it was not written as a recording, or the file cannot be written.
    """
    recording = read_recording(scenario_folder(found, name))
    with whole_file(path_of(file), PICTURE) as beside:
        write_scenario_picture(recording.gt, recording.ego, load(recording.map), beside)


def play_scenario(found: MiningResult, name: str, page: str | Path) -> None:
    """Write a page that plays a scenario.

    Args:
        found: What `resim mine` wrote.
        name: Of the scenario.
        page: HTML file to write.

    Raises:
        InputError: There is no such scenario, it was not written as a recording, or the page cannot be written.
    """
    play([scenario_folder(found, name)], page)


def scenario_folder(found: MiningResult, name: str) -> Path:
    """Give the recording of a scenario.

    Args:
        found: What `resim mine` wrote.
        name: Of the scenario.

    Returns:
        Its folder.

    Raises:
        InputError: There is no such scenario, or it was not written as a recording.
    """
    rows = found.scenarios
    own = rows[rows["scenario"] == name]
    if not len(own):
        raise InputError(found.folder, unknown("scenario", name, rows["scenario"].tolist()))
    if not (where := own["folder"].iloc[0]):
        why = own["note"].iloc[0] or "the study wrote rows alone"
        raise InputError(name, f"has no recording: {why}", "Mine with --scenarios recordings.")
    return found.folder / str(where)


def _study(options: MineOptions) -> StudyOptions:
    return _study_of(read_rules(options.labels), options)


def _study_of(rules: MiningRules, options: MineOptions) -> StudyOptions:
    scenarios = None
    if options.around == SURROUNDINGS:
        scenarios = SURROUNDINGS, own_extraction(rules)
    elif options.around is not None:
        asked = options.around
        if isinstance(asked, str):
            asked = AroundOptions(asked, **rules.settings.around.model_dump())
        scenarios = f"{asked}", moments_finder(asked, rules.labels)
    return StudyOptions(rules, options.accept, options.write, options.fit, scenarios)


def _check_target(target: Path, resume: bool, inputs: Iterable[Path]) -> None:
    """Refuse a folder that an input lies in, or that holds something else, or an earlier study not to be resumed."""
    for one in inputs:
        refuse_within(one, target, "lies within --out, where `resim mine` replaces what it finds")
        refuse_within(target, one, f"lies within {one}, which is mined")
    check_own(target, MINING)
    if target.is_dir() and any(target.iterdir()) and not resume:
        raise InputError(target, "exists already", "Name a new folder, or continue with resume=True.")


def _named(folders: Sequence[Path]) -> dict[str, Path]:
    """Recordings by a name of their own: that of the folder, with a number where it is a duplicate."""
    out: dict[str, Path] = {}
    for folder in folders:
        base = "".join(c if c.isalnum() or c in "-_." else "_" for c in folder.resolve().name) or "recording"
        name, number = base, 2
        while name in out:
            name, number = f"{base}.{number}", number + 1
        out[name] = folder
    return out


def _finish(
    target: Path, study: StudyOptions, parts: list[MinedPart], failures: list[MinedFailure]
) -> MiningResult:
    """Put the tables of all parts together, and write mined.json and mined.html."""
    for table in TABLES:
        beside = target / f".{table}.parquet"
        merge_parquet([target / "parts" / part.recording / f"{table}.parquet" for part in parts], beside)
        beside.replace(target / f"{table}.parquet")
    report = MiningReport(
        versions=versions(), rules=study.rules.hash, labels=[*study.rules.labels], trigger=_trigger(study),
        parts=parts, failures=failures, egos="every" if study.scenarios is None else "own",
        files={name: file_hash(target / name) for name in (f"{table}.parquet" for table in TABLES)},
    )  # fmt: skip
    write_json(sealed(to_json(report)), target / MARK)
    write_mined_page(report, target)
    return MiningResult(target, report)


def _trigger(study: StudyOptions) -> list[str]:
    """For what scenarios are cut out."""
    if study.scenarios is None or study.scenarios[0] == SURROUNDINGS:
        return [*study.rules.settings.extraction.trigger]
    return [study.scenarios[0]]


def known_labels() -> tuple[str, ...]:
    """Give the names of the labels that ship.

    Returns:
        The names.
    """
    return label_names()


def is_recording(folder: Path) -> bool:
    """Say whether a folder is a recording.

    Args:
        folder: A folder.

    Returns:
        Whether it holds recording.toml.
    """
    return (folder / SETTINGS).is_file()
