"""Which signals are speed-limit signs, and the speed they show; where it is in force: `limits`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import cast

from lxml.etree import _Element

from resim.road.opendrive.model import Orientation, SpeedSign
from resim.road.opendrive.xml import Reader

SPEED_UNITS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704}
"""Metres per second of each unit of OpenDRIVE."""

GERMAN_BEGINS, GERMAN_ENDS = frozenset({"274", "274.1"}), frozenset({"278", "274.2", "282"})
BEGINS = {
    "AT": {"52.10a"}, "CH": {"2.30"}, "ES": {"R-301"}, "FR": {"B14"}, "GB": {"670"}, "NL": {"A1"},
    "NO": {"362"}, "SE": {"C31"}, "US": {"R2-1"},
}  # fmt: skip
ENDS = {"AT": {"52.10b"}, "CH": {"2.53"}, "ES": {"R-501"}, "FR": {"B33"}, "NL": {"A2"}, "NO": {"364"}}
IN_WORDS = frozenset({"maximum speed", "maximumspeed", "maxspeed", "speedlimit", "speed limit"})
ALPHA_2 = {"AUT": "AT", "CHE": "CH", "ESP": "ES", "FRA": "FR", "GBR": "GB", "NLD": "NL", "NOR": "NO",
           "SWE": "SE", "USA": "US"}  # fmt: skip
IN_MILES = ("US", "GB")
NEW_CODES = 2017


def read_signs(
    reader: Reader, road: _Element, signals: Mapping[str, _Element], where: str
) -> tuple[SpeedSign, ...]:
    """Read the speed-limit signs among a road's signals and references to signals (by id), in order of s.

    Signals that change (dynamic="yes") say no fixed limit and are left out. Raises InputError where a speed
    sign's place, lanes or orientation cannot be read.
    """
    found = []
    for element in road.iterfind("signals/*"):
        signal = element if element.tag == "signal" else signals.get(element.get("id", ""))
        speed = None if signal is None else shown(signal)
        if signal is None or speed is None or signal.get("dynamic") == "yes":
            continue
        at = f"{where}, signal {element.get('id', '?')}"
        orientation = element.get("orientation", "none")
        if orientation not in ("+", "-", "none"):
            raise reader.error(at, f"orientation={orientation!r} is none of +, -, none")
        found.append(SpeedSign(
            id=element.get("id", ""), s=reader.number(element, "s", at),
            orientation=cast(Orientation, orientation), lanes=lane_ranges(reader, element, at), speed=speed,
            text=described(signal, ("country", "type", "subtype", "value", "unit")),
        ))  # fmt: skip
    return tuple(sorted(found, key=lambda sign: sign.s))


def described(signal: _Element, names: Sequence[str]) -> str:
    """Give these attributes of a signal, those that it has, in words."""
    return ", ".join(f"{name}={signal.get(name)}" for name in names if signal.get(name))


def shown(signal: _Element) -> float | None:
    """Give the speed [m/s] of a speed-limit sign, inf for one that ends a limit, None for other signals.

    Types are the German numbers (274, zone 274.1; end 278, 274.2, 282) unless the country has its own here.
    The speed is `value` in `unit` (km/h if not said, mph in the US and GB). Without one it is a German
    sign's subtype: that of StVO 2017 (50 is 50 km/h), or the older (55 is 50 km/h). NaN where neither says a
    speed, or says one that no sign shows: not a whole number of km/h or mph.
    """
    country = country_of(signal)
    kind = signal.get("type", "")
    if kind in ENDS.get(country, set() if country in BEGINS else GERMAN_ENDS):
        return math.inf
    if kind not in BEGINS.get(country, GERMAN_BEGINS) and kind.lower() not in IN_WORDS:
        return None
    unit = signal.get("unit", "mph" if country in IN_MILES else "km/h")
    value = _float(signal.get("value"))
    if not value > 0.0 and kind in GERMAN_BEGINS:
        value, unit = _subtype(signal, zone=kind == "274.1"), "km/h"
    whole = unit == "m/s" or abs(value - round(value)) < 0.01 if math.isfinite(value) else False
    return value * SPEED_UNITS[unit] if value > 0.0 and whole and unit in SPEED_UNITS else math.nan


def country_of(signal: _Element) -> str:
    """Give the country whose types of signs a signal uses, in two letters where they are known."""
    country = signal.get("country", "").upper()
    return ALPHA_2.get(country, country)


def _subtype(signal: _Element, *, zone: bool) -> float:
    """The km/h that a German sign's subtype stands for, NaN where it is none."""
    code = _float(signal.get("subtype"))
    if not code > 0.0:
        return 30.0 if zone else math.nan
    old = _float(signal.get("countryRevision")) < NEW_CODES or code % 10.0 != 0.0
    return (code - 50.0) * 10.0 if old and 51.0 <= code <= 63.0 else code


def _float(text: str | None) -> float:
    try:
        return float(text) if text else math.nan
    except ValueError:
        return math.nan


def lane_ranges(reader: Reader, element: _Element, where: str) -> tuple[tuple[int, int], ...]:
    """Read the ranges of lane ids that a signal is for, () where it names none."""
    ranges = []
    for validity in element.iterfind("validity"):
        ends = reader.integer(validity, "fromLane", where), reader.integer(validity, "toLane", where)
        ranges.append((min(ends), max(ends)))
    return tuple(ranges)
