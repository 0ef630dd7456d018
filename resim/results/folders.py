"""Folders of results: told by what they hold, written whole or not at all, deleted only where all is of resim."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from resim.core.errors import InputError
from resim.core.files import parse_json, read_file


@dataclass(frozen=True)
class FolderKind:
    """A kind of results folder: the file that tells it from others, and the names of all that resim writes there.

    inside: names of the files in each folder of it.
    """

    mark: str
    names: re.Pattern[str]
    inside: Mapping[str, re.Pattern[str]] = field(default_factory=dict)


_HALF = r"\..+\.\d+\.new"
"""A file that was being written when its process was killed."""
_JSON, _PAGES = re.compile(rf".+\.json|{_HALF}"), re.compile(rf".+\.html|{_HALF}")

RUN = FolderKind(
    "run.json",
    re.compile(
        r"(run|report|assessment)\.json|report\.html|(tracks|answers|plans|kpis)\.parquet|r?(GT|SD)\.jscen\.json"
        r"|[\w.-]+\.xodr"
    ),
)
ASSESSMENT = FolderKind("assessment.json", re.compile(r"assessment\.(json|html)|kpis\.parquet"))
CONVERSION = FolderKind("conversion.json", re.compile(r"conversion\.json|map\.html|[\w.-]+\.net\.xml"))
VERIFICATION = FolderKind(
    "inputs.json",
    re.compile(rf"inputs\.json|verification\.(html|json)|junit\.xml|cases|reports|{_HALF}"),
    {"cases": _JSON, "reports": _PAGES},
)
SWEEP = FolderKind(
    "sweep.json",
    re.compile(rf"(sweep|manifest|report)\.json|report\.html|times\.parquet|runs|journal|{_HALF}"),
    {
        "runs": re.compile(rf"part-\d+\.parquet|{_HALF}"),
        "journal": re.compile(r"\d+-of-\d+\.jsonl"),
    },
)


def check_output(folder: Path, kind: FolderKind = RUN) -> None:
    """Refuse, before any work is done, a folder that must not be replaced."""
    remedy = "Name another with --out."
    try:
        if folder.is_file():
            raise InputError(folder, "is a file, expected a folder for the results", remedy)
        whole = folder.absolute()
        above = next((parent for parent in whole.parents if parent.exists()), whole)
        if not above.is_dir() or not os.access(above, os.W_OK):
            raise InputError(folder, f"cannot be made: {above} is no folder that you may write", remedy)
        held = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    except OSError as e:
        raise InputError(folder, f"cannot be used: {e.strerror}", remedy) from e
    if held and not _is_result(folder / kind.mark):
        problem = f"exists and is not a results folder (it has no {kind.mark} of resim's)"
        raise InputError(folder, problem, remedy)
    if strange := [name for name in held if not kind.names.fullmatch(name)]:
        raise InputError(
            folder, f"holds {strange[0]}, which is no result of resim's and would be lost", remedy
        )


def _is_result(mark: Path) -> bool:
    try:
        return "resim" in parse_json(read_file(mark, ""), mark)["versions"]
    except (InputError, KeyError, TypeError):
        return False


def remove_results(folder: Path, kind: FolderKind) -> None:
    """Delete a folder of results of this kind, or nothing at all.

    Raises InputError where it is none, holds anything that is no result of resim's, or cannot be deleted.
    """
    remedy = "Look what it is, and delete it yourself."
    try:
        if folder.is_symlink():
            raise InputError(folder, "is a link, which is not followed to delete anything", remedy)
        if not _is_result(folder / kind.mark):
            raise InputError(folder, f"is not a results folder (it has no {kind.mark} of resim's)", remedy)
        if strange := next(_strange(folder, kind), None):
            raise InputError(folder, f"holds {strange}, which is no result of resim's", remedy)
        aside = folder.with_name(f".{folder.name}.{os.getpid()}.old")
        folder.rename(aside)  # what is deleted only in part never looks like a result
        shutil.rmtree(aside)
    except OSError as e:
        raise InputError(folder, f"cannot be deleted: {e.strerror}", remedy) from e


def _strange(folder: Path, kind: FolderKind) -> Iterator[str]:
    """Names of what resim does not write into such a folder."""
    for path in sorted(folder.iterdir()):
        within = kind.inside.get(path.name)
        if path.is_symlink() or not kind.names.fullmatch(path.name) or path.is_dir() != (within is not None):
            yield path.name
        elif within is not None:
            for file in sorted(path.iterdir()):
                if file.is_symlink() or file.is_dir() or not within.fullmatch(file.name):
                    yield f"{path.name}/{file.name}"


@contextlib.contextmanager
def locked(folder: Path, command: str) -> Iterator[None]:
    """Hold a folder of results for one command. Raises InputError where another process does at this moment."""
    folder.mkdir(parents=True, exist_ok=True)
    file = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # gone with the process, however it ends
        except BlockingIOError as e:
            problem = f"is written by another `{command}` at this moment"
            raise InputError(folder, problem, "Wait for that one, or end it.") from e
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
def whole_folder(folder: Path, kind: FolderKind = RUN) -> Iterator[Path]:
    """Give a folder beside to write into; it takes the place of `folder` if all went well, else it is gone."""
    check_output(folder, kind)
    folder = Path(os.path.realpath(folder))  # where a link leads
    beside = folder.with_name(f".{folder.name}.{os.getpid()}.new")
    old = folder.with_name(f".{folder.name}.{os.getpid()}.old")
    try:
        with explain_os_errors(folder):
            folder.parent.mkdir(parents=True, exist_ok=True)
            shutil.rmtree(beside, ignore_errors=True)
            beside.mkdir()
            yield beside
            try:
                if folder.exists():
                    folder.rename(old)
                beside.rename(folder)
            except BaseException:  # a signal, too
                if old.exists() and not folder.exists():
                    old.rename(folder)
                raise
    finally:
        shutil.rmtree(beside, ignore_errors=True)
        if folder.exists():
            shutil.rmtree(old, ignore_errors=True)


@contextlib.contextmanager
def whole_file(path: Path, kinds: tuple[str, ...] = (".html", ".htm")) -> Iterator[Path]:
    """Give a file beside to write; it takes the place of `path` if all went well, else it is gone.

    kinds: suffixes of the files that may be replaced. Raises InputError for a folder and for any other file.
    """
    path = path.absolute()
    if path.is_dir():
        raise InputError(path, "is a folder, expected a file to write", "Name a file with --out.")
    if path.exists() and path.suffix.lower() not in kinds:
        problem = f"exists and is no {' or '.join(kinds)} file: it would be lost"
        raise InputError(path, problem, "Name another with --out.")
    beside = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield beside
        beside.replace(path)
    except OSError as e:
        raise InputError(path, f"cannot be written: {e}", "Name another with --out.") from e
    finally:
        beside.unlink(missing_ok=True)
