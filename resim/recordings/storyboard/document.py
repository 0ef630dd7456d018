"""Elements of a scenario or catalog file, their values with parameters put in, and errors that name the place."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from lxml import etree

from resim.core.errors import InputError
from resim.core.files import read_file
from resim.core.xml import safe_root
from resim.recordings.storyboard.expression import evaluate
from resim.recordings.tables import BIGGEST

SAVE_AGAIN = "Save the file with its tool again."
VERSIONS = ("1.0", "1.1", "1.2", "1.3")
"""Of OpenSCENARIO XML."""


@dataclass
class ScenarioParameters:
    """Parameters that a file, or an entry of a catalog, declares.

    Attributes:
        declared: The text of each, which may name others.
        asked: Names whose values are being worked out.
    """

    declared: Mapping[str, str]
    asked: list[str] = field(default_factory=list)

    def filled(self, text: str) -> str:
        """Give a text of the file with `$name` or `${expression}` worked out.

        Raises:
            ValueError: A parameter is not declared, or a value is none.
        """
        if text.startswith("${") and text.endswith("}"):
            return repr(evaluate(text[2:-1], self._value))
        return self._value(text[1:]) if text.startswith("$") else text

    def _value(self, name: str) -> str:
        if name not in self.declared:
            raise ValueError(f"names the parameter {name!r}, which is not declared")
        if name in self.asked or len(self.asked) > 50:
            raise ValueError(f"names the parameter {name!r}, which needs its own value")
        self.asked.append(name)
        try:
            return self.filled(self.declared[name])
        finally:
            self.asked.pop()


class ScenarioElement:
    """An element of a file, its children in the same way."""

    __slots__ = ("file", "parameters", "xml")

    def __init__(self, xml: etree._Element, file: Path, parameters: ScenarioParameters) -> None:
        self.xml, self.file, self.parameters = xml, file, parameters

    @property
    def tag(self) -> str:
        """Its name in the standard."""
        return str(self.xml.tag)

    @property
    def path(self) -> str:
        """Where it is below the root: `Storyboard/Init/Actions/Private[@entityRef='Ego']`."""
        line = [self.xml, *self.xml.iterancestors()][:-1]
        return "/".join(map(_step, reversed(line))) or self.tag

    def refused(self, problem: str, remedy: str = SAVE_AGAIN) -> InputError:
        """Give the error that names this element.

        Args:
            problem: What is wrong with it.
            remedy: What to do about it.
        """
        return InputError(self.file, f"line {self.xml.sourceline}: {self.path} {problem}", remedy)

    def children(self, *tags: str) -> Iterator[ScenarioElement]:
        """Give its child elements of these tags, or all."""
        for one in self.xml:
            if not tags or one.tag in tags:
                yield self._below(one)

    def child(self, *path: str) -> ScenarioElement | None:
        """Give the first element down a path of tags, None where there is none."""
        found = self
        for tag in path:
            below = next((one for one in found.xml if one.tag == tag), None)
            if below is None:
                return None
            found = found._below(below)
        return found

    def _below(self, xml: etree._Element) -> ScenarioElement:
        """A child: a parameter that it declares counts in it, before one of that name that is declared around it."""
        below = ScenarioElement(xml, self.file, self.parameters)
        if own := declared_parameters(below):
            below.parameters = ScenarioParameters({**self.parameters.declared, **own})
        return below

    def needed(self, *path: str) -> ScenarioElement:
        """Give the element down a path of tags. Raises InputError where there is none."""
        if (found := self.child(*path)) is None:
            raise self.refused(f"has no {'/'.join(path)}")
        return found

    def only(self) -> ScenarioElement:
        """Give its only child element. Raises InputError where there are others, or none."""
        found = [*self.children()]
        if len(found) != 1:
            there = ", ".join(one.tag for one in found[:8]) or "none"
            raise self.refused(f"has {len(found)} elements in it ({there}), expected one")
        return found[0]

    def get(self, attribute: str, default: str | None = None) -> str | None:
        """Give an attribute with parameters put in. Raises InputError where they cannot be."""
        text = self.xml.get(attribute)
        if text is None:
            return default
        try:
            return self.parameters.filled(text.strip())
        except ValueError as e:
            raise self.refused(f"{attribute}={text!r} {e}") from None

    def text(self, attribute: str) -> str:
        """Give an attribute that has to be there. Raises InputError."""
        found = self.get(attribute)
        if not found:
            raise self.refused(f"{attribute} is {'missing' if found is None else 'empty'}")
        return found

    def number(self, attribute: str, default: float | None = None) -> float:
        """Give a finite number of an attribute. Raises InputError for what is none."""
        text = self.get(attribute)
        if text is None and default is not None:
            return default
        try:
            value = math.nan if text is None or "_" in text else float(text)
        except ValueError:
            value = math.nan
        if not abs(value) <= BIGGEST:
            found = "missing" if text is None else repr(text)
            raise self.refused(f"{attribute} is {found}, expected a finite number up to {BIGGEST:g}")
        return value

    def flag(self, attribute: str, default: bool = False) -> bool:
        """Give a boolean of an attribute. Raises InputError for what is none."""
        text = self.get(attribute)
        if text is None:
            return default
        if text not in ("true", "false", "1", "0"):
            raise self.refused(f"{attribute} is {text!r}, expected true or false")
        return text in ("true", "1")


def open_scenario_file(file: Path) -> ScenarioElement:
    """Give the root of a scenario or catalog file, with the parameters that it declares.

    Raises:
        InputError: It is no OpenSCENARIO XML of VERSIONS.
    """
    root = safe_root(read_file(file, "Check the path."), file, remedy=SAVE_AGAIN)
    if root.tag != "OpenSCENARIO":
        problem = f"the root element is <{root.tag}>, expected <OpenSCENARIO>"
        raise InputError(file, problem, "Give an OpenSCENARIO XML file (.xosc).")
    whole = ScenarioElement(root, file, ScenarioParameters({}))
    header = whole.needed("FileHeader")
    version = f"{header.text('revMajor')}.{header.text('revMinor')}"
    if version not in VERSIONS:
        raise header.refused(f"is of version {version}, expected one of {', '.join(VERSIONS)}")
    return ScenarioElement(root, file, ScenarioParameters(declared_parameters(whole)))


def declared_parameters(of: ScenarioElement) -> dict[str, str]:
    """Give the texts of the parameters that an element declares. Raises InputError where two of a name differ."""
    found: dict[str, str] = {}
    place = next((one for one in of.xml if one.tag == "ParameterDeclarations"), ())
    for xml in place:
        one = ScenarioElement(xml, of.file, of.parameters)
        name, value = one.xml.get("name", ""), (one.xml.get("value") or "").strip()
        if found.setdefault(name, value) != value:
            raise one.refused(f"declares {name!r} a second time, as {value!r}", "Declare it once.")
    return found


def _step(xml: etree._Element) -> str:
    for key in ("name", "entityRef"):
        if (value := xml.get(key)) is not None:
            return f"{xml.tag}[@{key}={value!r}]"
    return str(xml.tag)
