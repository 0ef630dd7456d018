"""Folders of results: told by what they hold, written whole or not at all, deleted only where all is of resim."""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import os
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_args

from resim.core.errors import InputError
from resim.core.files import read_file
from resim.core.schema import GENERATOR, PerceptionSchema, SweepReportSchema
from resim.core.sealed import read_sealed


@dataclass(frozen=True)
class FolderKind:
    """A kind of results folder: the file that tells it from others, and what else resim writes there.

    names: of files that every such folder may have; the mark lists the others as `files`. inside: names of the files in
    each folder of it, likewise. deep: of folders with folders of their own the paths of all files, seen from them.
    """

    mark: str
    names: re.Pattern[str]
    inside: Mapping[str, re.Pattern[str]] = field(default_factory=dict)
    deep: Mapping[str, re.Pattern[str]] = field(default_factory=dict)


_NONE = re.compile(r"(?!)")
LONGEST_NAME = 230
"""Bytes of a folder's name: what is written beside it has a longer one, and file systems take 255."""
HALF = re.compile(r"\..+\.\d+\.new")
"""A file that was being written when its process was killed."""

RUN = FolderKind("run.json", re.compile(r"(run|assessment|asked)\.json|report\.html|kpis\.parquet"))
ASSESSMENT = FolderKind("assessment.json", re.compile(r"assessment\.(json|html)|asked\.json|kpis\.parquet"))
CONVERSION = FolderKind("conversion.json", re.compile(r"conversion\.json|map\.html"))
EXPORT = FolderKind("export.json", re.compile(r"export\.json"))
VERIFICATION = FolderKind(
    "inputs.json",
    re.compile(rf"(inputs|asked)\.json|(verification\.(html|json)|junit\.xml)(\.previous)?|{HALF.pattern}"),
    {"cases": HALF, "drives": HALF, "reports": HALF},
)
SWEEP = FolderKind(
    "sweep.json",
    re.compile(rf"(sweep|manifest|report|asked)\.json|report\.html|times\.parquet|{HALF.pattern}"),
    {
        "runs": re.compile(rf"part-\d+\.parquet|{HALF.pattern}"),
        "journal": re.compile(r"\d+-of-\d+\.jsonl(\.refused\d*)?"),
    },
)
VARIATIONS = FolderKind("variations.json", re.compile(r"variations\.(json|html)"))

MINING = FolderKind(
    "mined.json",
    re.compile(rf"\.?mined\.(json|html)|asked\.json|\.?(maneuvers|scenarios|slots)\.parquet|{HALF.pattern}"),
    deep={
        "parts": re.compile(r"[^/]+/\.?((part|cut)\.json|(maneuvers|scenarios|overview|slots)\.parquet)"),
        "pages": re.compile(r"\.?[^/]+\.html|scripts\.css"),
        "recordings": re.compile(r"[^/]+/(recording\.toml|(gt|sd|plan)\.(csv|parquet))"),
        "maps": re.compile(r"[^/]+/\.?[^/]+\.(xodr|jscen\.json)(\.\d+\.new)?"),
    },
)

SPACE = FolderKind(
    "space.json",
    re.compile(
        rf"(space|asked)\.json|space\.html|cover\.(json|html)|members\.parquet|traffic\.toml|{HALF.pattern}"
    ),
)
RELEASE = FolderKind("release.json", re.compile(r"release\.(json|html)"))
COMPARISON = FolderKind("comparison.json", re.compile(r"comparison\.(json|html)"))


def check_output(folder: Path, kind: FolderKind = RUN, inputs: Iterable[Path] = ()) -> None:
    """Refuse, before any work is done, a folder that must not be replaced, or that any of the inputs lies in."""
    remedy = "Name another with --out."
    for one in inputs:
        refuse_within(one, folder, "lies within --out, and would be lost: it is an input of this command")
    try:
        if folder.exists() and not folder.is_dir():  # a file, or a device, which no rename may take away
            raise InputError(folder, "is no folder, expected one for the results", remedy)
        if Path(os.path.realpath(folder)).is_symlink():
            raise InputError(folder, "is a link that leads to itself", remedy)
        if len(os.fsencode(folder.name)) > LONGEST_NAME:
            raise InputError(folder, f"has a name of more than {LONGEST_NAME} bytes", remedy)
        whole = folder.absolute()
        above = next((parent for parent in whole.parents if parent.exists()), whole)
        if not above.is_dir() or not os.access(above, os.W_OK):
            raise InputError(folder, f"cannot be made: {above} is no folder that you may write", remedy)
        held = [*folder.iterdir()] if folder.is_dir() else []
        if any(not HALF.fullmatch(path.name) for path in held):
            _check_held(folder, kind, "exists and is not a results folder", remedy, " and would be lost")
    except OSError as e:
        raise InputError(folder, f"cannot be used: {e.strerror}", remedy) from e


def refuse_within(inner: Path, outer: Path, problem: str) -> None:
    """Raise InputError of `inner`, with the problem, where it is `outer` or lies in it, links followed."""
    if Path(os.path.realpath(inner)).is_relative_to(os.path.realpath(outer)):
        raise InputError(inner, problem, "Name a folder elsewhere with --out.")


def _check_held(folder: Path, kind: FolderKind, none: str, remedy: str, lost: str = "") -> None:
    """Raise InputError where a folder holds anything but results of this kind: `none` and `lost` say so."""
    try:
        mark = read_sealed(folder / kind.mark, remedy)
        listed = {*mark["files"]} if "files" in mark else set[str]()
        if "resim" not in mark["versions"]:
            raise TypeError
    except (InputError, KeyError, TypeError) as e:
        problem = f"{none} (it has no {kind.mark} of resim, or one that was changed since)"
        raise InputError(folder, problem, remedy) from e
    if strange := next(_strange(folder, kind, listed), None):
        raise InputError(folder, f"holds {strange}, which is not a resim result{lost}", remedy)


def check_own(folder: Path, kind: FolderKind) -> None:
    """Refuse a folder that holds anything but results of this kind, whole or not. Raises InputError."""
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "is no folder, expected one for the results", "Name another with --out.")
    if folder.is_dir() and (strange := next(_strange(folder, kind, set()), None)):
        raise InputError(folder, f"holds {strange}, which is not a resim result", "Name another with --out.")


def check_results(folder: Path, kind: FolderKind) -> None:
    """Refuse a folder that holds anything but whole results of this kind. Raises InputError."""
    _check_held(folder, kind, "is no folder of results", "Make it again, or take out what is not of resim.")


def remove_results(folder: Path, kind: FolderKind) -> None:
    """Delete a folder of results of this kind, or nothing at all.

    Raises InputError where it is none, holds anything that is not a resim result, or cannot be deleted.
    """
    remedy = "Inspect it and delete it manually."
    try:
        if folder.is_symlink():
            raise InputError(folder, "is a link, which is not followed to delete anything", remedy)
        _check_held(folder, kind, "is not a results folder", remedy)
        with locked(folder, "another command"):
            pass
        aside = folder.with_name(f".{folder.name}.{os.getpid()}.old")
        folder.rename(aside)  # what is deleted only in part never looks like a result
        try:
            _check_held(aside, kind, "is not a results folder", remedy)  # nobody puts anything in any more
        except InputError:
            _put_back(aside, folder)
            raise
        shutil.rmtree(aside)
    except OSError as e:
        raise InputError(folder, f"cannot be deleted: {e.strerror}", remedy) from e


def _strange(folder: Path, kind: FolderKind, listed: set[str]) -> Iterator[str]:
    """Names of what resim did not write into such a folder: all but plain files that it lists or always has."""

    def is_own(path: Path, name: str, names: re.Pattern[str]) -> bool:
        known = name in listed or names.fullmatch(path.name) is not None
        return known and path.is_file() and not path.is_symlink()

    for path in sorted(folder.iterdir()):
        within, deep = kind.inside.get(path.name), kind.deep.get(path.name, _NONE)
        is_folder = path.is_dir() and not path.is_symlink()
        holds = path.name in kind.deep or (
            is_folder and within is None and any(name.startswith(f"{path.name}/") for name in listed)
        )
        if holds and is_folder:
            for file in sorted(path.rglob("*")):
                name = file.relative_to(folder).as_posix()
                known = name in listed or deep.fullmatch(file.relative_to(path).as_posix()) is not None
                if file.is_symlink() or not (file.is_dir() or (known and file.is_file())):
                    yield name
        elif within is None or path.is_symlink() or not path.is_dir():
            if not is_own(path, path.name, kind.names):
                yield path.name
        else:
            for file in sorted(path.iterdir()):
                if not is_own(file, name := f"{path.name}/{file.name}", within):
                    yield name


@contextlib.contextmanager
def locked(folder: Path, command: str, *, shared: bool = False) -> Iterator[None]:
    """Hold a folder of results for one command, or for all of those that share it.

    Raises InputError where another process holds it at this moment.
    """
    folder.mkdir(parents=True, exist_ok=True)
    file = os.open(folder, os.O_RDONLY)
    try:
        try:
            how = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
            fcntl.flock(file, how | fcntl.LOCK_NB)  # gone with the process, however it ends
        except BlockingIOError as e:
            problem = f"is written by {command} at this moment"
            raise InputError(folder, problem, "Wait until it ends, or stop it.") from e
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(file)


@contextlib.contextmanager
def explain_os_errors(folder: Path) -> Iterator[None]:
    """Raise InputError of the folder for what the system refuses within."""
    try:
        yield
    except OSError as e:
        raise InputError(folder, f"cannot be written: {e}", "Name another with --out.") from e


@contextlib.contextmanager
def whole_folder(
    folder: Path, kind: FolderKind = RUN, inputs: Iterable[Path] = ()
) -> Iterator[Path]:  # fmt: skip
    """Give a folder beside to write into; it takes the place of `folder` if all went well, else it is gone.

    Raises InputError where `folder` must not be replaced, or an input lies in it; where it got something else in the
    meantime, the error says where the new results are.
    """
    check_output(folder, kind, inputs)
    folder = Path(os.path.realpath(folder))  # where a link leads
    beside = folder.with_name(f".{folder.name}.{os.getpid()}.new")
    try:
        with explain_os_errors(folder):
            folder.parent.mkdir(parents=True, exist_ok=True)
            shutil.rmtree(beside, ignore_errors=True)
            beside.mkdir()
            yield beside
    except BaseException:
        shutil.rmtree(beside, ignore_errors=True)
        raise
    _take_place(beside, folder, kind)


def _take_place(beside: Path, folder: Path, kind: FolderKind) -> None:
    """Put a folder of new results in the place of one that may be replaced; nothing of either is lost if it may not."""
    old = folder.with_name(f".{folder.name}.{os.getpid()}.old")
    placed = False
    try:
        if os.path.lexists(folder):
            folder.rename(old)  # from here on nobody puts anything in by its name
        if old.is_symlink():
            raise InputError(old, "is a link")
        check_output(old, kind)
        beside.rename(folder)
        placed = True
    except (InputError, OSError) as e:
        _put_back(old, folder)
        why = e.problem if isinstance(e, InputError) else e.strerror
        problem = f"was changed while the command ran ({why}), and was left alone"
        raise InputError(folder, problem, f"The results are in {_kept(beside, folder)}.") from e
    except BaseException:  # a signal, maybe just after the last renaming
        placed = not beside.exists()
        if not placed:
            _put_back(old, folder)
            shutil.rmtree(beside, ignore_errors=True)
        raise
    finally:
        if placed:
            shutil.rmtree(old, ignore_errors=True)


def _put_back(old: Path, folder: Path) -> None:
    """Give a folder its name back, or, where that was taken meanwhile, one that anybody sees."""
    if os.path.lexists(old):
        old.rename(_free(folder, "old") if os.path.lexists(folder) else folder)


def _kept(beside: Path, folder: Path) -> Path:
    """Give new results a name that anybody sees, and that nobody has; say where they are."""
    try:
        return beside.rename(_free(folder, "new"))
    except OSError:
        return beside


def _free(folder: Path, word: str) -> Path:
    """A name beside a folder's that nobody has: with `word`, and a number where that is taken."""
    names = (f"{folder.name}.{word}{f'-{k}' if k else ''}" for k in itertools.count())
    return next(p for name in names if not os.path.lexists(p := folder.with_name(name)))


@dataclass(frozen=True)
class FileKind:
    """A kind of file that resim writes beside a user's own: its suffixes, and all that stands in each of resim's."""

    suffixes: tuple[str, ...]
    marks: tuple[str, ...]

    def holds(self, path: Path) -> bool:
        """Say whether a file is one that resim wrote."""
        if path.suffix.lower() not in self.suffixes:
            return False
        held = read_file(path, "Name another with --out.", largest=sys.maxsize)
        return all(mark.encode() in held for mark in self.marks)


PAGE = FileKind((".html", ".htm"), (GENERATOR,))
MODEL = FileKind((".json",), (f'"{get_args(PerceptionSchema)[0]}"', '"training"', '"trained on '))
"""A model that was trained, none that somebody wrote by hand."""
KERNELS = FileKind((".json",), ('"resim-kernels-1"', '"checksum"'))
PREDICTION = FileKind((".json",), ('"kinds"', '"fitted"', '"fitted to '))
"""A set that was fitted, likewise."""
PICTURE = FileKind((".svg",), ('class="resim-scenario"',))
SWEEP_REPORT = FileKind((".json",), (f'"{get_args(SweepReportSchema)[0]}"',))


@contextlib.contextmanager
def whole_file(path: Path, kind: FileKind | None = PAGE) -> Iterator[Path]:
    """Give a file beside to write; it takes the place of `path` if all went well, else it is gone.

    kind: of the files that may be replaced; any file, if None: those of a results folder.
    Raises InputError for a folder and for any other file.
    """
    path = path.absolute()
    if path.is_dir():
        raise InputError(path, "is a folder, expected a file to write", "Name a file with --out.")
    if kind is not None and path.exists() and not kind.holds(path):
        raise InputError(
            path, "exists, is not such a resim file, and would be lost", "Name another with --out."
        )
    beside = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield beside
        beside.replace(path)
    except OSError as e:
        raise InputError(path, f"cannot be written: {e}", "Name another with --out.") from e
    finally:
        beside.unlink(missing_ok=True)
