"""Catalogs: files beside a scenario with vehicles, trajectories and maneuvers that it refers to by name."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from resim.core.errors import InputError
from resim.core.files import joined
from resim.recordings.storyboard.document import (
    ScenarioElement,
    ScenarioParameters,
    declared_parameters,
    open_scenario_file,
)

MOST_FILES = 200
"""Catalog files of a folder."""


class ScenarioCatalogs:
    """The catalogs that a scenario names the folders of; files are read when an entry is asked for."""

    def __init__(self, scenario: ScenarioElement) -> None:
        self._scenario = scenario
        self._read: dict[Path, ScenarioElement] = {}
        self._unread: list[InputError] = []

    def resolved(self, one: ScenarioElement) -> ScenarioElement:
        """Give the entry that a CatalogReference names, with its parameters; any other element is given back.

        Raises:
            InputError: There is no such entry, or its file cannot be read.
        """
        if one.tag != "CatalogReference":
            return one
        catalog, entry = one.text("catalogName"), one.text("entryName")
        there: list[str] = []
        for found in self._catalogs():
            name = found.get("name", "")
            there.append(f"{name!r}")
            if name != catalog:
                continue
            for candidate in found.children():
                if candidate.xml.get("name") == entry:
                    return _with_parameters(candidate, one)
            there[-1] = f"{name!r} without that entry"
        if self._unread:  # what was looked for may be in it
            raise self._unread[0]
        folders = "; the catalogs there are " + ", ".join(there[:8]) if there else "; there is no catalog"
        raise one.refused(
            f"names {entry!r} of the catalog {catalog!r}, which is not there{folders}",
            "Put the catalog's file where CatalogLocations says.",
        )

    def _catalogs(self) -> Iterator[ScenarioElement]:
        places = self._scenario.child("CatalogLocations")
        self._unread = []
        for place in () if places is None else places.children():
            try:
                directory = place.needed("Directory")
                files = _files(directory, joined(self._scenario.file, directory.get("path") or "."))
            except InputError as e:
                self._unread.append(e)
                continue
            for file in files:
                if (root := self._opened(file)) is not None and (found := root.child("Catalog")) is not None:
                    yield found

    def _opened(self, file: Path) -> ScenarioElement | None:
        """The root of a catalog's file, None for one that cannot be read: the entry may be in another."""
        if file not in self._read:
            try:
                self._read[file] = open_scenario_file(file)
            except InputError as e:
                self._unread.append(e)
                return None
        return self._read[file]


def _files(directory: ScenarioElement, folder: Path) -> list[Path]:
    """The catalog files of a folder; of a file, that one."""
    try:
        if folder.suffix.lower() == ".xosc" and folder.exists() and not folder.is_dir():
            return [folder]
        found = sorted(file for file in folder.iterdir() if file.suffix.lower() == ".xosc")
    except (OSError, ValueError) as e:
        why = getattr(e, "strerror", None) or e
        raise directory.refused(f"names a folder that cannot be read ({why})", "Check its path.") from None
    if len(found) > MOST_FILES:
        problem = f"holds {len(found)} .xosc files; up to {MOST_FILES} are read"
        raise InputError(folder, problem, "Put the catalogs into a folder of their own.")
    return found


def _with_parameters(entry: ScenarioElement, reference: ScenarioElement) -> ScenarioElement:
    declared = declared_parameters(entry)
    assigned = reference.child("ParameterAssignments")
    for one in () if assigned is None else assigned.children():
        name = one.text("parameterRef").removeprefix("$")
        if name not in declared:
            raise one.refused(f"assigns {name!r}, which the catalog's entry does not declare")
        declared[name] = one.get("value") or ""
    return ScenarioElement(entry.xml, entry.file, ScenarioParameters(declared))
