"""Brings the index up to date with the folders that are registered: what is new, what changed, what is gone."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy import and_, delete, or_, select

from resim.core.errors import InputError, ResimError
from resim.recordings.settings import SETTINGS
from resim.results.catalog import Catalog, begins, drop, put, rate, user_catalog
from resim.results.database import inserting
from resim.results.entry import KINDS, CatalogEntry, FileStamps, ItemKind, kind_of, stamps
from resim.results.inputs import input_kind, read_input, refuse_nothing
from resim.results.reading import MARKS, clusters_of, read_entry
from resim.results.tables import ITEM, ROOT

DEEPEST = 12
"""Levels of folders that are looked into."""
EACH = 25
"""Entries that are written at once."""
ALWAYS: tuple[ItemKind, ...] = ("build", "criteria")
"""Read at every scan: the code that they name may have changed, wherever it is."""
INSIDE = {"mining": ("recordings", "maps")}
"""Folders in results in which there is more to find."""
Noted = Callable[[str, str], None]
"""Is told what was done (new, changed, gone, unreadable) with what."""


@dataclass(frozen=True)
class ScanCounts:
    """What a scan found.

    Attributes:
        seen: What there is.
        new: That was not known.
        changed: That holds something else now.
        gone: That was known, and is not there any more.
        absent: Registered folders that are not there: what is known of them stays.
    """

    seen: int
    new: int
    changed: int
    gone: int
    absent: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Known:
    """What the index has of a path: ids, those that this machine entered, and by what a change is noticed."""

    ids: tuple[str, ...] = ()
    own: tuple[str, ...] = ()
    files: FileStamps = field(default_factory=dict)


def register(catalog: Catalog, paths: Sequence[Path], noted: Noted = lambda what, path: None) -> ScanCounts:
    """Register paths: what is there is found from now on. Nothing is copied.

    Raises InputError for one at which there is nothing; none is registered then.
    """
    roots = [Path(os.path.realpath(path)) for path in paths]
    for path, root in zip(paths, roots, strict=True):
        if next(iter(_found(root)), None) is None:
            if root.is_dir():
                _refuse_unfinished(path)
            raise refuse_nothing(path)
    return scan(catalog, roots, noted)


def _refuse_unfinished(folder: Path) -> None:
    for _, mark in KINDS.values():
        if (folder / mark.mark).is_file():
            kind_of(folder)


def add_roots(catalog: Catalog, roots: Sequence[Path]) -> None:
    """Register paths, in which the next scan looks."""
    rows = [{"path": os.path.realpath(root), "host": platform.node()} for root in roots]
    if rows:
        with catalog.changing() as connection:
            connection.execute(inserting(connection, ROOT).values(rows).on_conflict_do_nothing())


def roots_of(catalog: Catalog) -> list[Path]:
    """Give the registered paths of this machine, by name."""
    with catalog.connected() as connection:
        found = select(ROOT.c.path).where(ROOT.c.host == platform.node()).order_by(ROOT.c.path)
        return [Path(path) for path in connection.scalars(found)]


def entered_of(catalog: Catalog) -> list[Path]:
    """Give the folders of this machine's results that lie below no registered path: commands entered them, and no scan
    finds them.
    """
    roots = roots_of(catalog)
    mine = select(ITEM.c.folder).where(ITEM.c.host == platform.node(), ITEM.c.kind.in_([*KINDS]))
    with catalog.connected() as connection:
        folders = [Path(folder) for folder in connection.scalars(mine.distinct().order_by(ITEM.c.folder))]
    return [folder for folder in folders if not any(folder.is_relative_to(root) for root in roots)]


def enter(catalog: Catalog, folders: Iterable[Path]) -> int:
    """Enter the results in folders, as the commands that wrote them did. Says how many are there, and whole."""
    count = 0
    for folder in folders:
        try:
            kind = kind_of(folder)
        except InputError:  # gone, or begun anew
            continue
        if entries := _read(kind, folder, lambda what, path: None):
            catalog.add(*entries)
            count += 1
    return count


def unregister(catalog: Catalog, paths: Iterable[Path]) -> int:
    """Forget paths and all that is known below them; files stay. Says how much that was."""
    count = 0
    for path in paths:
        root = os.path.realpath(path)
        known = _known(catalog, Path(root))
        ids = [name for one in known.values() for name in one.own]
        with catalog.changing() as connection:
            connection.execute(delete(ROOT).where(ROOT.c.path == root, ROOT.c.host == platform.node()))
        catalog.forget(*catalog.entries(ids))
        count += len(ids)
    return count


def scan(catalog: Catalog, roots: Sequence[Path] = (), noted: Noted = lambda what, path: None) -> ScanCounts:
    """Look what there is now at some paths, which are registered, or at all that are.

    The same files give the same rows, whatever was known before.
    """
    add_roots(catalog, roots)
    counts = {"seen": 0, "new": 0, "changed": 0, "gone": 0}
    absent = []
    for root in roots or roots_of(catalog):
        whole = Path(os.path.realpath(root))
        if not whole.exists():
            absent.append(str(whole))
            continue
        for what, count in _scan(catalog, whole, noted).items():
            counts[what] += count
    return ScanCounts(**counts, absent=tuple(absent))


def scan_user_catalog(_: None) -> None:
    """Look into all that is registered in the user's catalog: a task for a child process."""
    if (catalog := user_catalog()) is not None:
        scan(catalog)


def is_up_to_date(catalog: Catalog) -> bool:
    """Say whether a scan would change nothing, but for code that builds name."""
    for root in roots_of(catalog):
        known = _known(catalog, root) if root.exists() else {}
        for one in _found(root):
            was = known.pop(one, None)
            if was is None or not _is_same(was, *one):
                return False
        if any(one.own and kind != "cluster" for (kind, _), one in known.items()):
            return False
    return True


def _scan(catalog: Catalog, root: Path, noted: Noted) -> dict[str, int]:
    known = _known(catalog, root)
    counts = {"seen": 0, "new": 0, "changed": 0, "gone": 0}
    waiting: list[tuple[tuple[str, ...], list[CatalogEntry]]] = []
    for kind, path in _found(root):
        counts["seen"] += 1
        was = known.pop((kind, path), None) or _Known()
        clusters = known.pop(("cluster", path), _Known()) if kind == "space" else _Known()
        if was.ids and _is_same(was, kind, path) and kind not in ALWAYS:
            continue
        entries = _read(kind, path, noted)
        if not entries or entries[0].id not in was.ids:
            what = "new" if not was.ids else "changed" if entries else "gone"
            if entries or was.ids:
                counts[what] += 1
                noted(what, str(path))
        waiting.append(((*was.own, *clusters.own), entries))
        if len(waiting) >= EACH:
            _write(catalog, waiting)
            waiting = []
    waiting += [(one.own, []) for one in known.values()]
    _write(catalog, waiting)
    lost = [path for (kind, path), one in known.items() if one.own and kind != "cluster"]
    for path in lost:
        noted("gone", str(path))
    return {**counts, "gone": counts["gone"] + len(lost)}


def _write(catalog: Catalog, waiting: Sequence[tuple[tuple[str, ...], list[CatalogEntry]]]) -> None:
    """Put entries in the place of what was known of their paths; what is as it was is not written."""
    if not waiting:
        return
    old = {e.id: e for e in catalog.entries([name for ids, _ in waiting for name in ids])}
    new = [e for _, entries in waiting for e in entries]
    changed = [e for e in new if old.get(e.id) != e]
    lost = [e for name, e in old.items() if name not in {n.id for n in new}]
    if changed or lost:
        with catalog.changing() as connection:
            drop(connection, [e.id for e in lost])
            for entry in changed:
                put(connection, entry)
            rate(connection, [*changed, *lost])


def _read(kind: ItemKind, path: Path, noted: Noted) -> list[CatalogEntry]:
    """What is at a path, a space with its clusters; nothing where results are broken, or gone by now."""
    try:
        if kind not in KINDS:
            return [read_input(path, kind)]  # type: ignore[arg-type]
        entry = read_entry(path)
        return [entry, *clusters_of(entry)] if kind == "space" else [entry]
    except (ResimError, OSError) as e:
        noted("unreadable", str(e))
        return []


def _is_same(was: _Known, kind: ItemKind, path: Path) -> bool:
    home = path if kind in (*KINDS, "recording") else path.parent
    names = MARKS[kind] if kind in MARKS else tuple(was.files)
    return stamps(home, names) == was.files


def _known(catalog: Catalog, root: Path) -> dict[tuple[ItemKind, Path], _Known]:
    """What the index has at a path and below."""
    below = or_(ITEM.c.folder == str(root), and_(*begins(ITEM.c.folder, f"{str(root).rstrip('/')}/")))
    rows = (
        select(ITEM.c.id, ITEM.c.kind, ITEM.c.folder, ITEM.c.host, ITEM.c.files)
        .where(below)
        .order_by(ITEM.c.id)
    )
    found: dict[tuple[ItemKind, Path], _Known] = {}
    with catalog.connected() as connection:
        for name, kind, folder, host, files in connection.execute(rows):
            was = found.get((kind, Path(folder)), _Known(files=files))
            own = (*was.own, name) if host == platform.node() else was.own
            same = files if files == was.files else {}  # two results of one folder: one of them is old
            found[kind, Path(folder)] = _Known((*was.ids, name), own, same)
    return found


def _found(root: Path) -> Iterator[tuple[ItemKind, Path]]:
    """What there is at a path and below: kinds and paths, in order; links and hidden files are left out."""
    if root.is_file():
        if root.name == SETTINGS:
            root = root.parent
        elif (kind := input_kind(root)) is not None:
            yield kind, root
            return
        else:
            return
    for where, folders, names in os.walk(root):
        here = Path(where)
        deep = len(here.relative_to(root).parts) < DEEPEST
        folders[:] = sorted(n for n in folders if not n.startswith(".") and deep)
        if SETTINGS in names and is_utf8(here):  # what else lies there belongs to it
            folders[:] = []
            yield "recording", here
            continue
        result = next((kind for kind, (mark, _) in KINDS.items() if mark in names), None)
        if result is not None and is_utf8(here):
            folders[:] = [name for name in folders if name in INSIDE.get(result, ())]
            yield result, here
            continue
        for name in sorted(names):
            path = here / name
            if name.startswith(".") or path.is_symlink() or not is_utf8(path):
                continue
            if path.suffix in (".toml", ".json", ".xodr") and (kind := input_kind(path)) is not None:
                yield kind, path


def is_utf8(path: Path) -> bool:
    """Say whether a path can be written down; resim writes no other one."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True
