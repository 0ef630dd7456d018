"""Reads OpenDRIVE XML safely, and its attributes with errors that name the place."""

from __future__ import annotations

import math
from pathlib import Path

from lxml import etree

from resim.core import remedies
from resim.core.errors import InputError
from resim.core.files import read_file
from resim.core.xml import safe_root

OPEN_IT = "Give an ASAM OpenDRIVE 1.4 to 1.8 file (.xodr)"
MEND = "Correct the map in its editor, or export it again"
CUT = "Give only the part of the map that was driven"
LARGEST = 100_000_000
BIGGEST = 1e12


def parse(path: Path) -> etree._Element:
    """Give the <OpenDRIVE> element of the file, its XML namespace taken off every tag.

    No entity is resolved and nothing is fetched. Raises InputError where the file is missing, empty, larger
    than 100 MB, not XML, has a DOCTYPE, or another root.
    """
    text = read_file(path, remedies.MAP, largest=LARGEST, too_large=CUT)
    return parse_bytes(text, path)


def parse_bytes(text: bytes, path: Path) -> etree._Element:
    """Give the <OpenDRIVE> element of the text as `parse` does; `path` names it in errors."""
    if not text.strip():
        raise InputError(path, "the file is empty", OPEN_IT)
    root = safe_root(text, path, remedy=OPEN_IT)
    for element in root.iter():
        if isinstance(element.tag, str) and element.tag.startswith("{"):
            element.tag = element.tag.partition("}")[2]
    if root.tag != "OpenDRIVE":
        raise InputError(path, f"the root element is <{root.tag}>, expected <OpenDRIVE>", OPEN_IT)
    return root


class Reader:
    """Reads attributes of elements; `path` and the caller's `where` make the error text."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def error(self, where: str, problem: str) -> InputError:
        """Give the error to raise for a problem at a place of the file."""
        return InputError(self.path, f"{where}: {problem}", MEND)

    def text(self, element: etree._Element, name: str, where: str) -> str:
        """Give the attribute; raises InputError where it is missing."""
        value = element.get(name)
        if value is None:
            raise self.error(where, f"<{element.tag}> lacks the attribute {name}")
        return value

    def number(self, element: etree._Element, name: str, where: str, default: float | None = None) -> float:
        """Give the attribute as a number; raises InputError where it is none, or beyond 1e12."""
        if default is not None and name not in element.attrib:
            return default
        text = self.text(element, name, where)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(where, f"{name}={text!r} of <{element.tag}> is not a finite number")
        if abs(value) > BIGGEST:
            raise self.error(where, f"{name}={text!r} of <{element.tag}> is beyond {BIGGEST:g}")
        return value

    def integer(self, element: etree._Element, name: str, where: str) -> int:
        """Give the attribute as an integer; raises InputError where it is none."""
        text = self.text(element, name, where)
        try:
            return int(text)
        except ValueError:
            raise self.error(where, f"{name}={text!r} of <{element.tag}> is not an integer") from None
