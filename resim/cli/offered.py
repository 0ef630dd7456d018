"""Which commands the Supervisor starts, and why it does not start the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from resim.cli import export, function, maps, perception, prediction, space, suite, sweep_report
from resim.cli.assess import assess
from resim.cli.augment import augment
from resim.cli.check import check
from resim.cli.generate import generate
from resim.cli.imports import format_command, guess
from resim.cli.mine import mine
from resim.cli.play import play
from resim.cli.run import run
from resim.cli.sweep import sweep
from resim.cli.traffic import traffic
from resim.cli.vary import train as train_kernels
from resim.cli.vary import vary
from resim.cli.verify import verify
from resim.recordings.formats.registry import FORMATS
from resim.recordings.formats.table import TABLES


@dataclass(frozen=True)
class OfferedJob:
    """A command that pages offer.

    Attributes:
        words: Of the command.
        job: Its function, whose parameters the form has.
        group: Under which heading it stands.
        out: Option of where its results go, "" for a command without.
        suffix: Of the file that results are, "" for a folder.
        again: Words that a further attempt has besides.
        kept: Whether a further attempt goes on where the one before was stopped.
        entered: Whether its result is something for the lake that the command itself does not enter.
        only: Parameters that the form has, () for all.
        required: Parameters that the command asks for itself, as it has another way to be called.
        patterns: By parameter how files are called that the lake does not know.
        help: What it does, where its function does not say so.
        fresh: Whether it refuses a result that is there already.
    """

    words: tuple[str, ...]
    job: Callable[..., None]
    group: str
    out: str = "--out"
    suffix: str = ""
    again: tuple[str, ...] = ()
    kept: bool = False
    entered: bool = False
    only: tuple[str, ...] = ()
    required: tuple[str, ...] = ()
    patterns: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    help: str = ""
    fresh: bool = False


_DRIVE, _BUILD, _SPACE, _MAKE = "One drive", "Builds and many runs", "Scenarios and spaces", "New drives"
_LEARN, _MAP, _EXPORT, _IMPORT = "Models", "Maps", "Export", "Import"


def _exports() -> Iterator[tuple[str, OfferedJob]]:
    for job in (
        export.openscenario, export.osi, export.mcap, export.foxglove, export.rosbag, export.openlabel, export.rocrate
    ):  # fmt: skip
        yield f"export-{job.__name__}", OfferedJob(("export", job.__name__), job, _EXPORT)


def _imports() -> Iterator[tuple[str, OfferedJob]]:
    for form in FORMATS:
        patterns = {form.file: form.patterns, **{option.name: option.patterns for option in form.options}}
        yield f"import-{form.name}", OfferedJob(
            ("import", form.name), format_command(form), _IMPORT, entered=True, fresh=True, patterns=patterns,
            help=f"Turn {form.source} into a recording.",
        )  # fmt: skip


OFFERED: Mapping[str, OfferedJob] = {
    "run": OfferedJob(("run",), run, _DRIVE),
    "assess": OfferedJob(("assess", "drive"), assess, _DRIVE),
    "check": OfferedJob(("check",), check, _DRIVE, out="", only=("recording",)),
    "repair": OfferedJob(
        ("check",), check, _DRIVE, out="--fix", entered=True, fresh=True,
        help="Repair a recording: examine it, and write a copy in which what is safe to repair is repaired.",
    ),
    "play": OfferedJob(("play",), play, _DRIVE, suffix=".html"),
    "verify": OfferedJob(("verify",), verify, _BUILD, kept=True, required=("suite", "build")),
    "replay": OfferedJob(
        ("verify",), verify, _BUILD, out="", only=("replay", "workers"), required=("replay",),
        help="Repeat a verification with all that it was made with, and compare the bytes.",
    ),
    "suite": OfferedJob(("suite", "new"), suite.new, _BUILD, suffix=".toml", entered=True, fresh=True),
    "sweep": OfferedJob(("sweep", "run"), sweep, _BUILD, again=("--resume",), kept=True),
    "sweep-estimate": OfferedJob(
        ("sweep", "run", "--dry-run"), sweep, _BUILD,
        help="Say how many runs a sweep has, how long they take and how large the results are, without sweeping.",
    ),
    "sweep-report": OfferedJob(("sweep", "report"), sweep_report.report, _BUILD, suffix=".html"),
    "sweep-repeat": OfferedJob(("sweep", "repeat"), sweep_report.repeat_run, _BUILD),
    "function-check": OfferedJob(("function", "check"), function.check, _BUILD, out=""),
    "mine": OfferedJob(("mine",), mine, _SPACE, kept=True),
    "space": OfferedJob(("space", "build"), space.build, _SPACE),
    "space-grow": OfferedJob(("space", "grow"), space.grow, _SPACE),
    "space-cover": OfferedJob(("space", "cover"), space.cover, _SPACE, out=""),
    "space-release": OfferedJob(("space", "release"), space.release, _SPACE),
    "space-compare": OfferedJob(("space", "compare"), space.compare, _SPACE),
    "vary": OfferedJob(("vary", "drive"), vary, _MAKE),
    "augment": OfferedJob(("augment",), augment, _MAKE, entered=True, fresh=True),
    "generate": OfferedJob(("generate",), generate, _MAKE, entered=True, fresh=True),
    "traffic": OfferedJob(("traffic",), traffic, _MAKE, entered=True, fresh=True),
    "kernels": OfferedJob(("vary", "train"), train_kernels, _LEARN, suffix=".json", entered=True),
    "train": OfferedJob(("perception", "train"), perception.train, _LEARN, suffix=".json", entered=True),
    "show-model": OfferedJob(("perception", "show"), perception.show, _LEARN, out=""),
    "fit-prediction": OfferedJob(
        ("assess", "fit-prediction"), prediction.fit_prediction, _LEARN, suffix=".json"
    ),
    "map-check": OfferedJob(("map", "check"), maps.check, _MAP, out=""),
    "map-convert": OfferedJob(("map", "convert"), maps.convert, _MAP),
    "map-plot": OfferedJob(("map", "plot"), maps.plot, _MAP, suffix=".html"),
    **dict(_imports()),
    "import-guess": OfferedJob(
        ("import", "guess"), guess, _IMPORT, suffix=".toml", fresh=True, patterns={"file": TABLES, "sensor": TABLES}
    ),
    **dict(_exports()),
}  # fmt: skip
"""By its name in addresses."""
NOT_OFFERED: Mapping[tuple[str, ...], str] = {
    ("serve",): "is the Supervisor",
    ("demo",): "is for a terminal; `resim serve --demo` shows the same in the browser",
    ("tasks",): "steers tasks: the page of tasks does the same",
    ("users",): "gives tokens: who may do that is on the machine itself",
    ("lake",): "registers folders, which pages must not do; finding and showing are pages",
    ("runs",): "lists, shows and removes results: pages show them, and none deletes files",
    ("mined",): "prints what the pages of what was mined show",
    ("function", "serve"): "is a server, which never ends",
    ("function", "include"): "prints a folder for a compiler",
}
"""Commands, or groups of them, without a form, and why."""
