"""The lake: register what there is, find it again, keep what is of its own; what `resim lake` does."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from resim.core.errors import InputError
from resim.jobs.given import path_of
from resim.results.asked import read_asked, words_of
from resim.results.backup import back_up, restore
from resim.results.catalog import Catalog, user_catalog
from resim.results.database import VARIABLE, data_folder
from resim.results.entry import KINDS, CatalogEntry, CatalogInput
from resim.results.lake import (
    ITEM_KINDS,
    LakeItem,
    LakeQuery,
    SortKey,
    contents_of,
    find_page,
    maps_of,
    with_content,
)
from resim.results.origin import ResultOrigin, read_origin
from resim.results.scanning import Noted, ScanCounts, register, scan, unregister

LINKED = 20
"""How many results that followed from something are named."""
SHOWN = (
    "id",
    "kind",
    "name",
    "verdict",
    "risk",
    "builds",
    "maps",
    "written",
    "digest",
    "folder",
    "host",
    "fault",
)
"""Columns of the table."""


@dataclass(frozen=True)
class LakeLinks:
    """Something in the lake, what it came from and what came of it.

    Attributes:
        entry: All that is known of it.
        origins: What it follows from, each with what the lake has of this content.
        followers: The newest that follow from it.
        count: How many these are.
        command: That makes it again, "" where there is none.
        origin: Versions and settings, seeds among them, that results were made with.
    """

    entry: CatalogEntry
    origins: tuple[tuple[CatalogInput, tuple[LakeItem, ...]], ...]
    followers: tuple[LakeItem, ...]
    count: int
    command: str
    origin: ResultOrigin


def the_catalog(catalog: str | None = None) -> Catalog:
    """Give the catalog that is meant.

    Args:
        catalog: Its path or URL, None for the user's.

    Returns:
        The catalog.

    Raises:
        InputError: It is switched off, or is none.
    """
    found = user_catalog() if catalog is None else Catalog(catalog)
    if found is None:
        raise InputError(VARIABLE, "switches the catalog off", "Unset it, or name a file or database.")
    return found


def lake_add(
    paths: Iterable[str | Path], *, catalog: str | None = None, noted: Noted = lambda what, path: None
) -> ScanCounts:
    """Register files and folders in the lake; nothing is copied.

    Args:
        paths: Recordings, maps, builds, results, ..., or folders that hold such.
        catalog: Path or URL of the database, None for the user's.
        noted: Is told what was done (new, changed, gone, unreadable) with what.

    Returns:
        How much was found.

    Raises:
        InputError: There is nothing at one of the paths, or the database cannot be used.
    """
    return register(the_catalog(catalog), [path_of(path) for path in paths], noted)


def lake_scan(
    roots: Iterable[str | Path] = (), *, catalog: str | None = None, noted: Noted = lambda what, path: None
) -> ScanCounts:
    """Look what is new, changed and gone.

    Args:
        roots: Where; none for all that is registered.
        catalog: Path or URL of the database, None for the user's.
        noted: Is told what was done (new, changed, gone, unreadable) with what.

    Returns:
        How much was found.

    Raises:
        InputError: The database cannot be used.
    """
    return scan(the_catalog(catalog), [path_of(root) for root in roots], noted)


def lake_rm(paths: Iterable[str | Path], *, catalog: str | None = None) -> int:
    """Forget registered paths and all below them; files stay.

    Args:
        paths: What was registered.
        catalog: Path or URL of the database, None for the user's.

    Returns:
        How many entries were forgotten.

    Raises:
        InputError: The database cannot be used.
    """
    return unregister(the_catalog(catalog), [path_of(path) for path in paths])


def lake_find(
    *, sort: SortKey = "written", limit: int = 100, catalog: str | None = None, **filters: Any
) -> pd.DataFrame:
    """Find anything in the lake.

    Args:
        sort: written (the newest first), name, or risk (the highest first, where it is known).
        limit: How many rows at most.
        catalog: Path or URL of the database, None for the user's.
        filters: Fields of `resim.results.lake.LakeQuery`: text, kinds, tag, maneuver, place, weather, finding,
            risk_above, risk_below, verdict, build, hashes.

    Returns:
        A row each, with the columns of SHOWN.

    Raises:
        InputError: There is no such filter or kind, or the database cannot be used.
    """
    known = LakeQuery.__dataclass_fields__
    if strange := [name for name in filters if name not in known]:
        raise InputError("lake_find", f"there is no filter {strange[0]!r}", f"There are: {', '.join(known)}.")
    if strange := [kind for kind in filters.get("kinds", ()) if kind not in ITEM_KINDS]:
        raise InputError(
            "lake_find", f"there is no kind {strange[0]!r}", f"There are: {', '.join(ITEM_KINDS)}."
        )
    found = find_page(the_catalog(catalog), LakeQuery(**filters), sort=sort, most=limit)
    return pd.DataFrame(
        [{name: getattr(item, name) for name in SHOWN} for item in found.items], columns=SHOWN
    )


def lake_show(wanted: str, *, catalog: str | None = None) -> LakeLinks:
    """Give something in the lake with its links.

    Args:
        wanted: Its id, four or more digits of it, or its path.
        catalog: Path or URL of the database, None for the user's.

    Returns:
        What it is, what it came from and what came of it.

    Raises:
        InputError: There is no such thing, or the database cannot be used.
    """
    lake = the_catalog(catalog)
    return links_of(lake, lake.get(wanted, ITEM_KINDS))


def links_of(lake: Catalog, entry: CatalogEntry) -> LakeLinks:
    """Give what something came from and what came of it.

    Args:
        lake: The catalog.
        entry: Something in it.

    Returns:
        It with its links; the maps of the recordings that it follows from are among its inputs.

    Raises:
        InputError: The database cannot be used.
    """
    command = shlex.join(again(entry, lambda digest: _place_of(lake, digest)))
    known = with_content(lake, [i.hash for i in entry.inputs])
    if not any(i.role == "map" for i in entry.inputs):  # then it has those of its recordings
        drives = [one.id for i in entry.inputs if i.role == "recording" for one in known.get(i.hash, ())[:1]]
        maps = maps_of(lake, drives)
        entry = replace(entry, inputs=(*entry.inputs, *maps))
        known = known | with_content(lake, [i.hash for i in maps])
    origins = tuple((i, tuple(known.get(i.hash, ()))) for i in entry.inputs)
    after = find_page(lake, LakeQuery(hashes=contents_of(entry)), most=LINKED) if entry.digest else None
    origin = read_origin(entry.folder, entry.kind) if entry.kind in KINDS else ResultOrigin()
    return LakeLinks(
        entry, origins, after.items if after else (), after.count if after else 0, command, origin
    )  # fmt: skip


def again(entry: CatalogEntry, find: Callable[[str], str | None]) -> list[str]:
    """Give the words of the command that makes results again.

    Args:
        entry: The results.
        find: Gives where a content lies, by its hash; None for one that is nowhere.

    Returns:
        The words; none where nobody wrote down how they were asked for, or a file is nowhere with the content that it
        had.
    """
    asked = read_asked(entry) if entry.kind in KINDS else None
    return [] if asked is None else words_of(asked, find)


def _place_of(lake: Catalog, digest: str) -> str | None:
    """Where something with a content lies, on this machine if it does."""
    found = with_content(lake, [digest]).get(digest, ())
    return next((i.folder for i in sorted(found, key=lambda i: i.host != platform.node())), None)


def lake_backup(file: str | Path, *, catalog: str | None = None) -> dict[str, int]:
    """Write what follows from no files: tasks, registered paths, where other results lie, audit trail, key of tokens.

    Args:
        file: A new file, which this user alone may read.
        catalog: Path or URL of the database, None for the user's.

    Returns:
        How much of each there is.

    Raises:
        InputError: The file is there, or cannot be written.
    """
    return back_up(the_catalog(catalog), data_folder(), path_of(file))


def lake_restore(file: str | Path, *, catalog: str | None = None) -> dict[str, int]:
    """Put back what a backup holds and is not there, and enter results that no scan finds.

    Args:
        file: What `lake_backup` wrote.
        catalog: Path or URL of the database, None for the user's.

    Returns:
        How much of each was put back.

    Raises:
        InputError: It is no backup of this version.
    """
    return restore(the_catalog(catalog), data_folder(), path_of(file))
