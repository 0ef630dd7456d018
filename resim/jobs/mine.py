"""Find the scenarios of recordings: what `resim mine` does."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import pandas as pd

from resim import __version__
from resim.core.errors import InputError, ResimError
from resim.core.sealed import sealed
from resim.core.spec import read_sealed_json, to_json
from resim.jobs.given import path_of
from resim.mining.around import AroundOptions, moments_finder
from resim.mining.maneuver import label_names
from resim.mining.own_labels import read_rules
from resim.mining.page import write_mined_page
from resim.mining.report import MARK, MinedFailure, MiningReport
from resim.mining.study import MinedPart, StudyOptions, mine_into, own_extraction
from resim.recordings.settings import SETTINGS
from resim.recordings.tables import read_parquet
from resim.report.markup import Markup
from resim.report.notebook import notebook_html
from resim.results import explain_os_errors, locked, merge_parquet, write_json

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
    """

    labels: Path | None = None
    around: AroundOptions | str | None = None
    accept: tuple[str, ...] = ()
    write: bool = True
    fit: bool = True
    resume: bool = False


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
    _check_target(target, options.resume)
    study = _study(options)
    parts: list[MinedPart] = []
    failures: list[MinedFailure] = []
    with explain_os_errors(target), locked(target, "another `resim mine`"):
        (target / MARK).unlink(missing_ok=True)
        for name, folder in _named(folders).items():
            told: MinedPart | MinedFailure
            try:
                with contextlib.chdir("."):
                    told = mine_into(folder, name, target, study)
                parts.append(told)
            except ResimError as e:
                told = MinedFailure(name, str(folder), str(e))
                failures.append(told)
            heard(told)
        if not parts:
            raise InputError(target, f"no recording could be mined: {failures[0].why}", "See `resim check`.")
        return _finish(target, study, parts, failures)


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


def _study(options: MineOptions) -> StudyOptions:
    rules = read_rules(options.labels)
    scenarios = None
    if options.around == SURROUNDINGS:
        scenarios = SURROUNDINGS, own_extraction(rules)
    elif options.around is not None:
        asked = options.around
        if isinstance(asked, str):
            asked = AroundOptions(asked, **rules.settings.around.model_dump())
        scenarios = f"{asked}", moments_finder(asked, rules.labels)
    return StudyOptions(rules, options.accept, options.write, options.fit, scenarios)


def _check_target(target: Path, resume: bool) -> None:
    """Refuse a folder that holds something else, or an earlier study that is not to be resumed."""
    if target.exists() and not target.is_dir():
        raise InputError(target, "is no folder, expected one for the results", "Name another with --out.")
    held = {path.name for path in target.iterdir()} if target.is_dir() else set()
    own = {"parts", "recordings", "maps", "mined.html", MARK, *(f"{name}.parquet" for name in TABLES)}
    if strange := sorted(held - own):
        raise InputError(
            target, f"holds {strange[0]}, which is not of `resim mine`", "Name another with --out."
        )
    if held and not resume:
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
        version=__version__, rules=study.rules.hash, labels=[*study.rules.labels],
        trigger=_trigger(study),
        parts=parts, failures=failures, egos="every" if study.scenarios is None else "own",
    )  # fmt: skip
    write_json(sealed(to_json(report)), target / MARK)
    result = MiningResult(target, report)
    write_mined_page(report, result.maneuvers, result.scenarios, target)
    return result


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
