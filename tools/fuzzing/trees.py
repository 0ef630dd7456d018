"""Damages the structure of XML, JSON and TOML: the text stays well-formed, what it says does not."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from random import Random
from typing import Any

from lxml import etree

from fuzzing.values import NUMBERS, TEXTS, WORDS


def value(rng: Random, old: str) -> str:
    """Give another value for an attribute or field."""
    way = rng.random()
    if way < 0.45:
        return rng.choice(NUMBERS)
    if way < 0.6:
        return rng.choice(WORDS)
    if way < 0.75:
        return rng.choice(TEXTS).replace("\0", "")
    try:
        return repr(
            float(old) * rng.choice((-1.0, 10.0, 1e3, 1e-3, 0.5, 1.0001)) + rng.choice((0.0, 0.0, 1.0))
        )
    except ValueError:
        return old[: len(old) // 2]


def xml(rng: Random, data: bytes) -> bytes:
    """Give the XML with one to five of its elements or attributes damaged."""
    root = etree.fromstring(data)
    for _ in range(rng.choice((1, 1, 2, 3, 5))):
        elements = [e for e in root.iter() if isinstance(e.tag, str) and e is not root]
        if not elements:
            break
        tag = rng.choice(sorted({str(e.tag) for e in elements}))  # rare elements as often as common ones
        rng.choice(XML)(rng, rng.choice([e for e in elements if e.tag == tag]), elements)
    return etree.tostring(root)


def _copy(element: etree._Element) -> etree._Element:
    return copy.deepcopy(element)


def _drop(rng: Random, element: etree._Element, elements: list[etree._Element]) -> None:
    parent = element.getparent()
    if parent is not None:
        parent.remove(element)


def _repeat(rng: Random, element: etree._Element, elements: list[etree._Element]) -> None:
    parent = element.getparent()
    if parent is not None:
        for _ in range(rng.choice((1, 1, 3, 30))):
            parent.insert(rng.randrange(len(parent) + 1), _copy(element))


def _move(rng: Random, element: etree._Element, elements: list[etree._Element]) -> None:
    rng.choice(elements).append(_copy(element))
    if rng.random() < 0.5:
        _drop(rng, element, elements)


def _rename(rng: Random, element: etree._Element, elements: list[etree._Element]) -> None:
    element.tag = rng.choice(elements).tag


def _lose(rng: Random, element: etree._Element, elements: list[etree._Element]) -> None:
    if element.attrib:
        del element.attrib[rng.choice(list(element.attrib))]


def _set(rng: Random, element: etree._Element, elements: list[etree._Element]) -> None:
    if element.attrib:
        name = rng.choice(list(element.attrib))
        element.set(name, value(rng, str(element.get(name))))


def _borrow(rng: Random, element: etree._Element, elements: list[etree._Element]) -> None:
    """Take the value of another element's attribute of this name: ids that clash, links that lead elsewhere."""
    if element.attrib:
        name = rng.choice(list(element.attrib))
        element.set(name, str(rng.choice([e for e in elements if name in e.attrib]).get(name)))


def _nest(rng: Random, element: etree._Element, elements: list[etree._Element]) -> None:
    inner = element
    for _ in range(rng.choice((3, 200, 400))):
        inner = etree.SubElement(inner, element.tag, element.attrib)


XML: tuple[Callable[[Random, etree._Element, list[etree._Element]], None], ...] = (
    _drop, _repeat, _move, _rename, _lose, _set, _set, _set, _set, _borrow, _borrow, _nest
)  # fmt: skip


def tree(rng: Random, data: Any) -> Any:
    """Give the JSON or TOML data with one to four of its values damaged, in place."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        places = list(_places(data))
        if places:
            parent, key = rng.choice(places)
            _tear(rng, parent, key)
    return data


def _places(data: Any, depth: int = 0) -> list[tuple[Any, Any]]:
    if depth > 40:
        return []
    keys: Any = data.keys() if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else ()
    found = [(data, key) for key in keys]
    return found + [place for key in keys for place in _places(data[key], depth + 1)]


def _tear(rng: Random, parent: Any, key: Any) -> None:
    old = parent[key]
    way = rng.randrange(7)
    if way == 0:
        del parent[key]
    elif way == 1 and isinstance(parent, list):
        parent.insert(rng.randrange(len(parent) + 1), old)
    elif way == 1:
        parent[rng.choice((key.upper(), f"{key} ", "extra", ""))] = old
    elif way == 2:
        parent[key] = rng.choice((None, True, [], {}, [old], {"x": old}, "x", 0, -1, [[]] * 3))
    elif way == 3 and isinstance(old, list):
        rng.shuffle(old)
    elif way == 3:
        for _ in range(rng.choice((2, 50, 3000))):
            old = [old]
        parent[key] = old
    else:
        parent[key] = other(rng, old) if isinstance(old, str | int | float) else rng.choice(("", 1, None))


def other(rng: Random, old: Any) -> Any:
    """Give a number for a number, a text for a text, now and then the other."""
    text = value(rng, str(old))
    if isinstance(old, str) == (rng.random() < 0.85):
        return text
    try:
        return int(text) if text.lstrip("-").isdigit() and len(text) < 4000 else float(text)
    except ValueError:
        return 1e300


def jsonised(rng: Random, data: bytes) -> bytes:
    """Give the JSON text with its structure damaged."""
    torn = tree(rng, json.loads(data))
    try:
        return json.dumps(torn).encode()
    except RecursionError:
        return b"[" * 100_000


def toml(rng: Random, data: bytes) -> bytes:
    """Give the TOML text with lines dropped, doubled, exchanged, and other values in them."""
    lines = data.decode().splitlines()
    for _ in range(rng.choice((1, 1, 2, 3))):
        at = rng.randrange(len(lines)) if lines else 0
        way = rng.randrange(6)
        if way == 0:
            del lines[at : at + 1]
        elif way == 1:
            lines[at:at] = lines[at : at + 1]
        elif way == 2:
            rng.shuffle(lines)
        elif lines and "=" in lines[at]:
            lines[at] = f"{lines[at].partition('=')[0]}= {_literal(rng, lines[at])}"
    return "\n".join(lines).encode()


def _literal(rng: Random, line: str) -> str:
    text = value(rng, line.partition("=")[2].strip(' "'))
    plain = json.dumps(text, ensure_ascii=False)
    return rng.choice((
        text, text, plain, plain, plain, "true", "[]", "{}", f"[{plain}]", f"{{a = {plain}}}", "1979-05-27T07:32:00Z",
        "[" * 500 + "]" * 500, "[" * 5000, '"adfunc.idm:Idm"', '"os:abort_"', '"this:c"', '"own:DriveOn"', "1e999",
    ))  # fmt: skip
