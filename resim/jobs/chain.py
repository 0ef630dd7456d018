"""Results with all that they came from, as one RO-Crate: what `resim lake crate` and the Supervisor's pages do."""

from __future__ import annotations

import math
import os
import platform
import shlex
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.core.provenance import versions
from resim.core.sealed import sealed
from resim.core.spec import to_json
from resim.exports.chain import ChainLink, chain_crate
from resim.exports.rocrate import FILE as ROCRATE
from resim.exports.rocrate import write
from resim.jobs.export import ExportReport
from resim.jobs.given import path_of
from resim.jobs.lake import again, the_catalog
from resim.results import EXPORT, refuse_within, whole_folder, write_json
from resim.results.catalog import Catalog
from resim.results.entry import KINDS, CatalogEntry, CatalogInput
from resim.results.folders import check_results
from resim.results.inputs import files_of_input, read_input
from resim.results.lake import ITEM_KINDS, LakeItem, with_content
from resim.results.origin import ResultOrigin, read_origin

MOST = 10_000
"""Links of a chain."""


@dataclass(frozen=True)
class _Known:
    """A link that is at hand. origins: ids of what it came from. files: by where they lie, where to read them."""

    entry: CatalogEntry
    origins: tuple[str, ...]
    files: Mapping[Path, Path]


def export_chain(wanted: str, out: str | Path, *, catalog: str | None = None) -> ExportReport:
    """Write something of the lake with all that it came from as an RO-Crate.

    Files lie in the crate as they lay to each other, so that those that name others find them. What is not at hand
    with the content that it had is named, with its hash and the reason.

    Args:
        wanted: Id in the lake, four or more digits of it, or its path.
        out: Folder for the crate; an earlier export there is replaced.
        catalog: Path or URL of the lake's database, None for the user's.

    Returns:
        What was written; what is missing is in its notes.

    Raises:
        InputError: There is no such thing, its own files are not at hand, or the folder cannot be written.
    """
    lake = the_catalog(catalog)
    return write_chain(lake, lake.get(wanted, ITEM_KINDS), path_of(out))


def write_chain(lake: Catalog, entry: CatalogEntry, folder: Path, largest: float = math.inf) -> ExportReport:
    """Write something of a lake with all that it came from as an RO-Crate.

    Args:
        lake: The catalog.
        entry: Something in it.
        folder: For the crate; an earlier export there is replaced.
        largest: Bytes that all files may have.

    Returns:
        What was written; what is missing is in its notes.

    Raises:
        InputError: Its own files are not at hand or too large, or the folder cannot be written.
    """
    known, missing = _gathered(lake, entry)
    packed = [one.entry.folder for one in known.values() if one.files]
    for path in packed:
        refuse_within(folder, path, f"lies within {path}, which is to be packed")
    files = [file.parent for one in known.values() for file in one.files]
    size = sum(path.stat().st_size for one in known.values() for path in one.files.values())
    if size > largest:
        problem = f"has {size / 1e9:.1f} GB with all that it came from, more than is given here"
        raise InputError(entry.name, problem, f"`resim lake crate {entry.id} --out FOLDER` writes it.")
    above = Path(os.path.commonpath([*(path.parent for path in packed), *files]))
    with whole_folder(folder, EXPORT, packed) as new:
        links = [_packed(one, above, new, known) for one in known.values()]
        held = {
            digest: (name, (size, digest)) for link in links for name, (size, digest) in link.files.items()
        }
        for name, link in missing.items():  # of a run's map there is a copy in its folder
            if link.digest in held:
                missing[name] = replace(link, missing="", files=dict([held[link.digest]]))
        links += missing.values()
        write(new, chain_crate(links))
        hashes = {name: digest for link in links for name, (_, digest) in link.files.items()}
        hashes[ROCRATE] = file_hash(new / ROCRATE)
        lost = [link for link in missing.values() if link.missing]
        notes = tuple(f"{link.kind} {link.name or link.digest[:12]}: {link.missing}" for link in lost)
        report = ExportReport(versions(), entry.name, "RO-Crate 1.1", "", {}, "", hashes, notes)
        write_json(sealed(to_json(report)), new / EXPORT.mark)
    return report


def _gathered(lake: Catalog, entry: CatalogEntry) -> tuple[dict[str, _Known], dict[str, ChainLink]]:
    """What something came from, and what that came from, and so on: what is at hand, and what is not, by id."""
    if why := _lost(entry):
        raise InputError(entry.folder, why, "`resim lake show` says what is known of it.")
    known: dict[str, _Known] = {}
    missing: dict[str, ChainLink] = {}
    waiting = [_Known(entry, (), _files(entry))]
    while waiting and len(known) < MOST:
        own = waiting.pop(0)
        one = own.entry
        if one.id in known:
            continue
        held = with_content(lake, [i.hash for i in one.inputs])
        origins = []
        for its in one.inputs:
            found, why = _at_hand(lake, held.get(its.hash, ()))
            if found is None:
                link = _missing(its, why)
                missing[link.id] = link
                origins.append(link.id)
            else:
                waiting.append(found)
                origins.append(found.entry.id)
        known[one.id] = replace(own, origins=tuple(dict.fromkeys(origins)))
    return known, missing


def _at_hand(lake: Catalog, items: Iterable[LakeItem]) -> tuple[_Known | None, str]:
    """What has a content and is here as it was; else why there is nothing."""
    why = "the lake has nothing with this content"
    for one in lake.entries([item.id for item in items]):
        try:
            if not (why := _lost(one)):
                return _Known(one, (), _files(one)), ""
        except InputError as e:
            why = str(e)
    return None, why


def _lost(entry: CatalogEntry) -> str:
    """Why something is not at hand with the content that it had, "" where it is."""
    state = entry.state()
    if state == "there" and entry.kind not in (
        *KINDS,
        "cluster",
    ):  # times and sizes say so, and now the content
        try:
            now = read_input(entry.folder, entry.kind).digest  # type: ignore[arg-type]
            state = "there" if now == entry.digest else "changed"
        except OSError:
            state = "gone"
    words = {"there": "", "changed": "its files hold something else now", "gone": "its files are gone",
             "elsewhere": f"its files are on {entry.host}, and cannot be seen from {platform.node()}"}  # fmt: skip
    return words[state]


def _missing(its: CatalogInput, why: str) -> ChainLink:
    told = f"{its.role}-{its.hash or its.name}"
    return ChainLink(
        told, its.role, its.name, its.hash, missing=why if its.hash else "its content is not told"
    )


def _files(entry: CatalogEntry) -> dict[Path, Path]:
    """The files of something; links are not followed, and of results nothing but results is taken."""
    if entry.kind == "cluster":  # it lies in its space
        return {}
    if entry.kind not in KINDS:
        return files_of_input(entry.folder, entry.kind)  # type: ignore[arg-type]
    check_results(entry.folder, KINDS[entry.kind][1])
    return {p: p for p in sorted(entry.folder.rglob("*")) if p.is_file() and not p.is_symlink()}


def _packed(one: _Known, above: Path, new: Path, known: Mapping[str, _Known]) -> ChainLink:
    """Copy the files of a link, and give it as the crate has it."""
    files = {}
    for place, path in one.files.items():
        name = Path(os.path.relpath(place, above)).as_posix()
        (new / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, new / name)
        files[name] = ((new / name).stat().st_size, file_hash(new / name))
    entry = one.entry
    origin = read_origin(entry.folder, entry.kind) if entry.kind in KINDS else ResultOrigin()
    return ChainLink(
        entry.id, entry.kind, entry.name, entry.digest, files, "", one.origins, origin.versions, origin.settings,
        entry.written, _again(entry, above, known),
    )  # fmt: skip


def _again(entry: CatalogEntry, above: Path, known: Mapping[str, _Known]) -> str:
    """The command that makes a result again from the files of the crate, "" where there is none."""
    places = {one.entry.digest: os.path.relpath(one.entry.folder, above) for one in known.values()}
    words = again(entry, places.get)
    return "" if any(word.startswith("/") for word in words) else shlex.join(words)  # outside of the crate
