"""Scenarios as OpenSCENARIO XML: everybody follows its trace, as a polyline over time, or drives its route.

Source: ASAM OpenSCENARIO XML 1.1 to 1.3. The reference point of a vehicle is the middle of its rear axle.
"""

from __future__ import annotations

import datetime
import importlib.util
import re
from typing import Any, NamedTuple

import numpy as np

from resim.core.errors import InputError
from resim.road.opendrive import RoadNetwork
from resim.scenario.openscenario_route import TimedAction, route_actions
from resim.scenario.scenario import Scenario, ScenarioObject
from resim.scenario.trace import STEP, Trace

VERSIONS = ("1.1", "1.2", "1.3")
"""Of OpenSCENARIO."""
STYLES = ("trajectory", "route")
"""How drives are written: as a polyline over time, or as waypoints and a speed over time."""
REAR_AXLE = 0.3
"""How far the rear axle is behind the middle of a vehicle, in lengths of it."""
WHEELBASE = 0.6
"""Between its axles, in lengths of it."""
HEIGHTS = {"truck": 3.5, "bus": 3.2, "van": 2.2, "trailer": 3.0, "pedestrian": 1.75, "bicycle": 1.7}
HEIGHT = 1.5
"""Heights [m] of objects by kind, and of all others: no recording says them."""
_CATEGORIES = {"unknown": "car", "motorcycle": "motorbike"}
_FASTEST, _STRONGEST, _WEIGHT = 70.0, 12.0, 75.0
"""Limits of a vehicle [m/s, m/s²] that no trace reaches; mass [kg] of a pedestrian."""
_LAST = 1e-6
"""s of a trace by which it may be shorter than the scenario and still last to its end."""
_UNWRITABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML cannot hold."""
_WRITTEN = datetime.datetime(1970, 1, 1)
"""The header needs a date, and the same scenario gives the same bytes."""


def refuse_without_openscenario() -> None:
    """Raise InputError where scenariogeneration is missing."""
    if importlib.util.find_spec("scenariogeneration") is None:
        remedy = "In resim's own folder: pip install '.[openscenario]'"
        raise InputError("export openscenario", "needs scenariogeneration", remedy)


def openscenario(
    scenario: Scenario, network: RoadNetwork, *, name: str, version: str = "1.2", style: str = "trajectory"
) -> bytes:
    """Give a scenario as an OpenSCENARIO file.

    The road is the file that the scenario names, beside it. Times count from the scenario's start. Who comes later than
    that is added then, and who ends before the end is deleted. name: for the header. style: of STYLES.
    """
    from lxml import etree
    from scenariogeneration import xosc

    xosc.VersionBase().setVersion(minor=int(version.partition(".")[2]))
    everyone = (scenario.ego, *scenario.objects)
    names = _names(everyone)
    ways = [
        _Way(one, trace, scenario.ego.spawn_time, scenario.duration)
        for one, trace in zip(everyone, scenario.traces(network), strict=True)
    ]
    kept = [way for way in ways if len(way.t)]
    entities, init = xosc.Entities(), xosc.Init()
    act = xosc.Act("drive", _at(xosc, "start", 0.0))
    _set_environment(xosc, init, scenario)
    for way in kept:
        own = names[way.of.id]
        entities.add_scenario_object(own, _entity(xosc, way.of))
        if style == "route":
            driven = route_actions(xosc, network, own, way.t, way.states)
        else:
            driven = _trajectory(xosc, way, own)
        _put(xosc, init, act, _Part(own, way, driven), scenario.duration)
    story = xosc.Story("story")
    story.add_act(act)
    board = xosc.StoryBoard(init, _at(xosc, "end", scenario.duration, "stop"))
    board.add_story(story)
    file = xosc.Scenario(
        _writable(name), "resim", xosc.ParameterDeclarations(), entities, board, xosc.RoadNetwork(scenario.map),
        xosc.Catalog(), osc_minor_version=int(version.partition(".")[2]), creation_date=_WRITTEN,
    )  # fmt: skip
    text = etree.fromstring(_serialized(file.get_element()))
    etree.indent(text)
    return bytes(etree.tostring(text, xml_declaration=True, encoding="utf-8")) + b"\n"


class _Way:
    """Times t (T,) [s] of an object from the scenario's `first` on, and the states (4, T) of its reference point: x, y,
    heading, v."""

    def __init__(self, of: ScenarioObject, trace: Trace, first: float, duration: float) -> None:
        begin, end = max(float(of.v.x[0]) - first, 0.0), min(float(of.v.x[-1]) - first, duration)
        self.of = of
        self.back = 0.0 if of.kind == "pedestrian" else REAR_AXLE * of.length
        steps = int(np.floor((end - begin + _LAST) / STEP)) + 1 if end >= begin else 0
        own = begin + STEP * np.arange(steps, dtype=float)
        self.t = np.append(own, end) if steps and end - own[-1] > _LAST else own
        s = trace.states(first + self.t) if len(self.t) else None
        if s is not None:
            x, y = s.x - self.back * np.cos(s.heading), s.y - self.back * np.sin(s.heading)
            self.states = np.stack([x, y, np.unwrap(s.heading), s.v])


def _names(everyone: tuple[ScenarioObject, ...]) -> dict[str, str]:
    """A name for each id, the EGO's "Ego": without what names of entities may not have, and each once."""
    found: dict[str, str] = {}
    taken = set[str]()
    for k, one in enumerate(everyone):
        name = "Ego" if k == 0 else re.sub(r"[^\w.-]", "_", f"object_{one.id}")
        while name.lower() in taken:
            name += "_"
        taken.add(name.lower())
        found[one.id] = name
    return found


def _writable(text: str) -> str:
    """A text with _ for each character that XML cannot hold."""
    return _UNWRITABLE.sub("_", text)


def _entity(xosc: Any, one: ScenarioObject) -> Any:
    """A vehicle or pedestrian, its box before its rear axle."""
    height, length = HEIGHTS.get(one.kind, HEIGHT), one.length
    if one.kind == "pedestrian":
        box = xosc.BoundingBox(one.width, length, height, 0.0, 0.0, 0.5 * height)
        return xosc.Pedestrian(_writable(one.id), _WEIGHT, xosc.PedestrianCategory.pedestrian, box)
    box = xosc.BoundingBox(one.width, length, height, REAR_AXLE * length, 0.0, 0.5 * height)
    front, rear = (xosc.Axle(0.6, 0.6, 0.8 * one.width, at, 0.3) for at in (WHEELBASE * length, 0.0))
    kind = getattr(xosc.VehicleCategory, _CATEGORIES.get(one.kind, one.kind))
    return xosc.Vehicle(_writable(one.id), kind, box, front, rear, _FASTEST, _STRONGEST, _STRONGEST)


class _Part(NamedTuple):
    """An entity's name, its states, and the actions by which it drives them."""

    own: str
    way: _Way
    driven: list[TimedAction]


def _trajectory(xosc: Any, way: _Way, own: str) -> list[TimedAction]:
    """Follow its trace, a vertex for each state."""
    if len(way.t) < 2:
        return []
    places = zip(*way.states[:3].tolist(), strict=True)
    points = [xosc.WorldPosition(x, y, h=heading) for x, y, heading in places]
    trajectory = xosc.Trajectory(f"trace {own}", False)
    trajectory.add_shape(xosc.Polyline(way.t.tolist(), points))
    follow = xosc.FollowTrajectoryAction(
        trajectory, xosc.FollowingMode.position, xosc.ReferenceContext.absolute, 1.0, 0.0
    )
    return [TimedAction(float(way.t[0]), f"{own} drives", follow)]


def _put(xosc: Any, init: Any, act: Any, part: _Part, duration: float) -> None:
    """Let an entity be where it is at its first time, drive, and be deleted where its trace ends early."""
    own, way, driven = part
    x, y, heading, v = way.states
    first = xosc.WorldPosition(float(x[0]), float(y[0]), h=float(heading[0]))
    group = xosc.ManeuverGroup(f"group {own}")
    group.add_actor(own)
    maneuver = xosc.Maneuver(f"maneuver {own}")
    begin = float(way.t[0])
    if begin > 0.0:
        _add_event(xosc, maneuver, f"{own} appears", begin, xosc.AddEntityAction(own, first))
    else:
        init.add_init_action(own, xosc.TeleportAction(first))
        still = xosc.TransitionDynamics(xosc.DynamicsShapes.step, xosc.DynamicsDimension.time, 0.0)
        init.add_init_action(own, xosc.AbsoluteSpeedAction(max(float(v[0]), 0.0), still))
    for one in driven:
        if one.t <= 0.0 and isinstance(one.action, xosc.AssignRouteAction):
            init.add_init_action(own, one.action)
        else:
            _add_event(xosc, maneuver, one.name, one.t, one.action)
    end = float(way.t[-1])
    if end < duration - _LAST:
        _add_event(xosc, maneuver, f"{own} vanishes", end, xosc.DeleteEntityAction(own))
    if maneuver.events:
        group.add_maneuver(maneuver)
        act.add_maneuver_group(group)


def _add_event(xosc: Any, maneuver: Any, name: str, t: float, action: Any) -> None:
    event = xosc.Event(name, xosc.Priority.parallel)
    event.add_trigger(_at(xosc, name, t))
    event.add_action(name, action)
    maneuver.add_event(event)


def _at(xosc: Any, name: str, t: float, point: str = "start") -> Any:
    """A trigger at a time [s], whichever step comes first there."""
    reached = xosc.SimulationTimeCondition(t, xosc.Rule.greaterOrEqual)
    return xosc.ValueTrigger(f"{name} at {t:.3f} s", 0, xosc.ConditionEdge.none, reached, point)


def _set_environment(xosc: Any, init: Any, scenario: Scenario) -> None:
    """Time of day and weather, as far as they are known in OpenSCENARIO's terms."""
    told = scenario.environment
    time, weather = None, None
    try:
        at = datetime.datetime.fromisoformat(told.get("dateTime", ""))
        time = xosc.TimeOfDay(True, at.year, at.month, at.day, at.hour, at.minute, at.second)
    except ValueError:
        pass
    if told.get("precipitationDensity", "").lower() == "none":
        dry = xosc.Precipitation(xosc.PrecipitationType.dry, 0.0)
        weather = xosc.Weather(precipitation=dry)
    if time is not None or weather is not None:
        init.add_global_action(xosc.EnvironmentAction(xosc.Environment("environment", time, weather)))


def _serialized(element: Any) -> bytes:
    from xml.etree import ElementTree

    text: bytes = ElementTree.tostring(element)
    return text
