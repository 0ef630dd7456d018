"""Which signals are traffic lights and signs of right of way; speed limits are read by `signs`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

from lxml.etree import _Element

from resim.core.errors import InputError
from resim.road.opendrive.model import Controller, Orientation, Signal, SignalKind
from resim.road.opendrive.signs import country_of, described, lane_ranges, shown
from resim.road.opendrive.xml import Reader

LIGHTS = frozenset({"1000001", "1000009", "1000010", "1000011"})
"""Traffic lights for vehicles, in OpenDRIVE's own numbers: three lamps, two, and with arrows."""

GERMAN: Mapping[str, SignalKind] = {
    "206": "stop", "205": "give way", "301": "priority", "306": "priority",
}  # fmt: skip
NATIONAL: Mapping[str, Mapping[str, SignalKind]] = {
    "AT": {"52.24": "stop", "52.23": "give way", "52.25a": "priority"},
    "CH": {"3.01": "stop", "3.02": "give way", "3.03": "priority"},
    "ES": {"R-2": "stop", "R-1": "give way", "R-3": "priority"},
    "FR": {"AB4": "stop", "AB3a": "give way", "AB6": "priority"},
    "GB": {"601.1": "stop", "602": "give way"},
    "NL": {"B7": "stop", "B6": "give way", "B1": "priority"},
    "NO": {"204": "stop", "202": "give way", "206": "priority"},
    "SE": {"B2": "stop", "B1": "give way", "B4": "priority"},
    "US": {"R1-1": "stop", "R1-2": "give way"},
}
IN_WORDS: Mapping[str, SignalKind] = {
    "stop": "stop", "stop sign": "stop", "give way": "give way", "giveway": "give way", "yield": "give way",
    "priority road": "priority", "traffic light": "light", "trafficlight": "light",
}  # fmt: skip


def read_signals(
    reader: Reader, road: _Element, signals: Mapping[str, _Element], where: str
) -> tuple[Signal, ...]:
    """Read a road's signals and references to signals (by id) that are no fixed speed limits, in the file's order.

    One whose place cannot be read has its `problem`: maps are good for much without it.
    """
    found = []
    for element in road.iterfind("signals/*"):
        signal = element if element.tag == "signal" else signals.get(element.get("id", ""))
        if element.tag not in ("signal", "signalReference"):
            continue
        if signal is not None and signal.get("dynamic") != "yes" and shown(signal) is not None:
            continue
        at = f"{where}, signal {element.get('id', '?')}"
        found.append(_signal(reader, element, signal, at))
    return tuple(found)


def _signal(reader: Reader, element: _Element, signal: _Element | None, where: str) -> Signal:
    s, ranges, problem = 0.0, None, ""
    orientation = element.get("orientation", "none")
    try:
        s = reader.number(element, "s", where)
        ranges = lane_ranges(reader, element, where)
        if orientation not in ("+", "-", "none"):
            raise reader.error(where, f"orientation={orientation!r} is none of +, -, none")
    except InputError as error:
        problem, orientation = error.problem, "none"
    if signal is None:
        problem = "it refers to a signal that is not in the map"
    text = "" if signal is None else described(signal, ("country", "type", "subtype", "dynamic"))
    return Signal(
        element.get("id", ""), None if signal is None else kind_of(signal), s, cast(Orientation, orientation),
        ranges or (), text, element.tag == "signalReference", problem,
    )  # fmt: skip


def kind_of(signal: _Element) -> SignalKind | None:
    """Give what a signal is, None where it is none that this reader knows.

    Types of signs are the German numbers unless the country has its own here.
    """
    kind = signal.get("type", "")
    if kind in LIGHTS:
        return "light"
    signs = NATIONAL.get(country_of(signal), GERMAN)
    return signs.get(kind) or IN_WORDS.get(kind.lower())


def read_controllers(root: _Element) -> tuple[Controller, ...]:
    """Read the controllers of a map: which signals each of them switches."""
    return tuple(
        Controller(
            element.get("id", ""),
            tuple(dict.fromkeys(control.get("signalId", "") for control in element.iterfind("control"))),
        )
        for element in sorted(root.iterfind("controller"), key=sequence)
    )


def sequence(element: _Element) -> float:
    """Give a controller's place in the order of controllers; those that name none come last."""
    try:
        return float(element.get("sequence", "inf"))
    except ValueError:
        return float("inf")
