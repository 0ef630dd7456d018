"""Parts of the recipes that tools/make_recipes.py writes: a road, objects on it, and the text of the file."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

Object = dict[str, Any]
COLORS = ("#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#8c564b")


@dataclass(frozen=True)
class Stage:
    """Where a scene plays: a stretch of road, the EGO's lane and those beside it, and the usual speed v [m/s].

    catalog: whose rows it is for. s: of the EGO's start [m]. scale: of distances, of those on the motorway.
    """

    catalog: str
    map: str
    road: str
    s: float
    via: tuple[str, ...]
    ego: int
    left: int
    right: int
    v: float

    @property
    def scale(self) -> float:
        """Distances here for one on the motorway."""
        return self.v / 30.0


HIGHWAY = Stage("highway", "motorway", "2", 340.0, (), -2, -1, -3, 30.0)
URBAN = Stage("urban", "urban", "2", 40.0, ("201",), -2, -1, -1, 12.0)
URBAN_LEFT = Stage("urban", "urban", "2", 40.0, ("201",), -1, -1, -2, 12.0)
"""In the town, on the left one of two lanes."""
CURVE = Stage("highway", "motorway", "2", 500.0, (), -2, -1, -3, 30.0)
BEND = Stage("urban", "urban", "3", 60.0, ("107",), -1, -1, -1, 9.0)


@dataclass(frozen=True)
class RecipeText:
    """A recipe: its file name, the rows of the catalogs that it is for, and what it holds."""

    name: str
    kinds: tuple[str, ...]
    description: str
    map: str
    objects: tuple[Object, ...]
    duration: float = 8.0
    accept: tuple[str, ...] = ()
    overlaps: tuple[tuple[str, str], ...] = ()
    environment: dict[str, str] = field(default_factory=dict)

    def text(self) -> str:
        """The TOML file."""
        head = {"description": self.description, "map": f"../../../networks/{self.map}.xodr", "duration": self.duration,
                "kinds": list(self.kinds)}  # fmt: skip
        if self.accept:
            head["accept"] = list(self.accept)
        if self.overlaps:
            head["overlaps"] = [list(pair) for pair in self.overlaps]
        lines = [f"{key} = {toml(value)}" for key, value in head.items()]
        for n, one in enumerate(self.objects):
            colored = {"id": one["id"], "color": COLORS[n % len(COLORS)], **one}
            lines += ["", "[[object]]", *(f"{key} = {toml(value)}" for key, value in colored.items())]
        return "\n".join(lines) + "\n"


def toml(value: Any) -> str:
    """A value in TOML, tables inline."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(v)}" for key, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml(v) for v in value) + "]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)


def on(stage: Stage, name: str, lane: int, gap: float, speed: Any, *, change: Iterable[dict[str, Any]] = (),
       offset: float = 0.0, **told: Any) -> Object:  # fmt: skip
    """An object in a lane, `gap` [m of the motorway] ahead of the EGO's start; centre to centre."""
    route: dict[str, Any] = {"road": stage.road, "lane": lane, "s": round(stage.s + stage.scale * gap, 2)}
    if offset:
        route["offset"] = offset
    if stage.via:
        route["via"] = list(stage.via)
    made: Object = {"id": name, **told, "route": route, "speed": speed}
    if changes := list(change):
        made["change"] = changes
    return made


def place(road: str, lane: int, s: float, offset: float = 0.0) -> dict[str, Any]:
    made: dict[str, Any] = {"road": road, "lane": lane, "s": s}
    return made | ({"offset": offset} if offset else {})


def across(name: str, road: str, s: float, lanes: Iterable[int], speed: Any, **told: Any) -> Object:
    """Somebody who crosses a road over these lanes, straight."""
    return {"id": name, **told, "route": {"places": [place(road, lane, s) for lane in lanes]}, "speed": speed}


def free(name: str, road: str, lane: int, s: float, speed: Any, *, via: Iterable[str] = (), against: bool = False,
         offset: float = 0.0, change: Iterable[dict[str, Any]] = (), **told: Any) -> Object:  # fmt: skip
    """An object that starts anywhere."""
    route: dict[str, Any] = place(road, lane, s, offset)
    if against:
        route["against"] = True
    if through := list(via):
        route["via"] = through
    made: Object = {"id": name, **told, "route": route, "speed": speed}
    if changes := list(change):
        made["change"] = changes
    return made


def profile(*points: tuple[float, float]) -> dict[str, list[float]]:
    """Speeds at times: (s, m/s) each."""
    return {"times": [p[0] for p in points], "values": [p[1] for p in points]}


def change(to: str, t: float, seconds: float, offset: float = 0.0, lanes: int = 1) -> dict[str, Any]:
    made: dict[str, Any] = {"to": to, "t": t, "seconds": seconds}
    return made | ({"offset": offset} if offset else {}) | ({"lanes": lanes} if lanes > 1 else {})


def shift(offset: float, t: float, seconds: float) -> dict[str, Any]:
    """To another offset within the lane."""
    return {"offset": offset, "t": t, "seconds": seconds}
