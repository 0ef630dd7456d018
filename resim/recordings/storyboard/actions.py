"""A storyboard as what is done with each entity, and when: what the file says of motion; the rest is refused.

Source: ASAM OpenSCENARIO XML 1.3, "Storyboard".
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass

from resim.core.clock import TICK
from resim.core.errors import InputError
from resim.recordings.storyboard.catalogs import ScenarioCatalogs
from resim.recordings.storyboard.curves import ScenarioCurve, scenario_curve
from resim.recordings.storyboard.document import ScenarioElement
from resim.recordings.storyboard.places import RELATIVE, ScenarioPlace, ScenarioPlaces
from resim.recordings.storyboard.speeds import SpeedChange, speed_change
from resim.recordings.storyboard.triggers import never, trigger_time

TRAJECTORIES = "Write the drive as FollowTrajectoryActions with times instead."
_STILL = ("VisibilityAction", "AppearanceAction")
"""Private actions that move nobody."""
_GLOBAL = (
    "EnvironmentAction",
    "InfrastructureAction",
    "ParameterAction",
    "VariableAction",
    "SetMonitorAction",
)
"""Global actions that move nobody: triggers that would wait for them are refused."""


class Removal:
    """An entity is deleted."""


@dataclass(frozen=True)
class Deed:
    """What an action does with an entity.

    Attributes:
        at: When it begins [s].
        until: When it is stopped at the latest [s].
        element: The action.
        what: Where the entity is put, how its speed changes, which curve it follows, or that it is deleted.
    """

    at: float
    until: float
    element: ScenarioElement
    what: ScenarioPlace | SpeedChange | ScenarioCurve | Removal


class StoryboardReader:
    """Reads the deeds of a storyboard.

    Attributes:
        deeds: Of each entity, in the order of their times.
        end: When the storyboard stops [s], None where it does not say.
    """

    def __init__(
        self, scenario: ScenarioElement, entities: list[str], catalogs: ScenarioCatalogs,
        places: ScenarioPlaces, horizon: float | None,
    ) -> None:  # fmt: skip
        """Read it; of events from the horizon [s] on, if there is one, only the triggers are. Raises InputError."""
        self._catalogs, self._places = catalogs, places
        self._horizon = math.inf if horizon is None else horizon - TICK
        self.deeds: dict[str, list[Deed]] = {name: [] for name in entities}
        self._placed: dict[str, ScenarioPlace] = {}
        self._speeds: dict[str, float] = {}
        board = scenario.needed("Storyboard")
        self.end = self._stop(board)
        self._horizon = min(self._horizon, never(self.end) - TICK)
        self._read_init(board.needed("Init"))
        self._placed, self._speeds = {}, {}
        begun = {name: len(own) for name, own in self.deeds.items()}
        for story in board.children("Story"):
            for act in story.children("Act"):
                self._read_act(act)
        for name, own in self.deeds.items():
            _refuse_rivals(sorted(own[begun[name] :], key=lambda deed: deed.at))
            own.sort(key=lambda deed: deed.at)

    def _stop(self, board: ScenarioElement) -> float | None:
        """When the storyboard stops; who names the end need not know."""
        try:
            return trigger_time(board.child("StopTrigger"), 0.0)
        except InputError as e:
            if math.isfinite(self._horizon):
                return None
            raise InputError(e.source, e.problem, "Name the end by --end.") from None

    def _read_init(self, init: ScenarioElement) -> None:
        """What depends on others comes after them, wherever it stands."""
        actions = init.child("Actions")
        waiting: list[tuple[ScenarioElement, str]] = []
        for one in () if actions is None else actions.children():
            if one.tag != "Private":
                self._do(one, [], 0.0, math.inf)
                continue
            name = self._known(one)
            for action in one.children():
                if _reference(action) is None:
                    self._begin(action, name)
                else:
                    waiting.append((action, name))
        while waiting:
            late = {name for _, name in waiting}
            ready = [(action, name) for action, name in waiting if _reference(action) not in late] or waiting
            for action, name in ready:
                self._begin(action, name)
            waiting = [one for one in waiting if one not in ready]

    def _begin(self, action: ScenarioElement, name: str) -> None:
        """What an entity is at the start is what others may be put by."""
        self._do(action, [name], 0.0, math.inf)
        what = self.deeds[name][-1].what if self.deeds[name] else None
        if isinstance(what, ScenarioPlace):
            self._placed[name] = what
        elif isinstance(what, SpeedChange) and what.shape == "step":
            self._speeds[name] = what.target

    def _read_act(self, act: ScenarioElement) -> None:
        groups = [*act.children("ManeuverGroup")]
        if not any(_moves(action) for group in groups for action in self._actions(group)):
            return
        begin = trigger_time(act.child("StartTrigger"), 0.0) or 0.0
        if begin >= self._horizon:
            return
        until = never(trigger_time(act.child("StopTrigger"), begin))
        for group in groups:
            actors = self._actors(group)
            _refuse_repeated(group)
            for maneuver in self._maneuvers(group):
                self._read_maneuver(maneuver, actors, begin, until)

    def _read_maneuver(
        self, maneuver: ScenarioElement, actors: list[str], begin: float, until: float
    ) -> None:
        """An event that overrides stops the others of its maneuver."""
        events = [one for one in maneuver.children("Event") if any(_moves(a) for a in one.children("Action"))]
        starts = [trigger_time(one.child("StartTrigger"), begin) for one in events]
        times = [begin if t is None else t for t in starts]
        stops = sorted(
            t
            for one, t in zip(events, times, strict=True)
            if one.get("priority") in ("overwrite", "override")
        )
        for one, t in zip(events, times, strict=True):
            if t >= min(self._horizon, until):
                continue
            _refuse_repeated(one)
            if one.get("priority") == "skip" and len(events) > 1:
                raise one.refused("has priority 'skip' beside other events", "Expected parallel or override.")
            later = bisect_right(stops, t + TICK)
            stopped = stops[later] if later < len(stops) else math.inf
            for action in one.children("Action"):
                self._do(action.only(), actors, t, min(until, stopped))

    def _maneuvers(self, group: ScenarioElement) -> Iterator[ScenarioElement]:
        for one in group.children("Maneuver", "CatalogReference"):
            yield self._catalogs.resolved(one)

    def _actions(self, group: ScenarioElement) -> Iterator[ScenarioElement]:
        for maneuver in self._maneuvers(group):
            for event in maneuver.children("Event"):
                yield from event.children("Action")

    def _actors(self, group: ScenarioElement) -> list[str]:
        told = group.child("Actors")
        if told is None:
            return []
        if told.flag("selectTriggeringEntities"):
            raise told.refused("selects the entities that trigger it", "Name the actors.")
        return [self._known(one) for one in told.children("EntityRef")]

    def _known(self, one: ScenarioElement) -> str:
        name = one.text("entityRef")
        if name not in self.deeds:
            some = ", ".join([*self.deeds][:8])
            raise one.refused(f"names {name!r}, which is no ScenarioObject", f"Those of the file are {some}.")
        return name

    def _do(self, action: ScenarioElement, actors: list[str], at: float, until: float) -> None:
        """Keep what a PrivateAction or GlobalAction does. Raises InputError for what depends on the player."""
        told = action.only() if action.tag in ("PrivateAction", "GlobalAction") else action
        if told.tag in (*_STILL, *_GLOBAL):
            return
        if told.tag == "EntityAction":
            actors, told = [self._known(told)], told.only()
        for name in actors:
            if (what := self._deed(told, at)) is not None:
                self.deeds[name].append(Deed(at, until, told, what))
        if not actors and action.tag != "PrivateAction":
            raise self._refused(told, at)

    def _deed(
        self, told: ScenarioElement, at: float
    ) -> ScenarioPlace | SpeedChange | ScenarioCurve | Removal | None:
        if told.tag in ("TeleportAction", "AddEntityAction"):
            return self._places.of(told.needed("Position"), self._placed)
        if told.tag == "DeleteEntityAction":
            return Removal()
        if told.tag == "LongitudinalAction" and (change := told.child("SpeedAction")) is not None:
            return speed_change(change, self._speeds)
        if told.tag == "RoutingAction" and (follow := told.child("FollowTrajectoryAction")) is not None:
            return self._curve(follow, at)
        if told.tag in ("ControllerAction", "ActivateControllerAction"):
            for one in (told,) if told.tag == "ActivateControllerAction" else told.children():
                if not _is_off(one):
                    raise self._refused(one, at)
            return None
        raise self._refused(told, at)

    def _curve(self, follow: ScenarioElement, at: float) -> ScenarioCurve:
        mode = follow.child("TrajectoryFollowingMode") or follow.child("FollowingMode")
        if mode is not None and mode.get("followingMode") != "position":
            raise mode.refused(
                f"followingMode is {mode.get('followingMode')!r}: how near it comes depends on the player",
                "Set it to position if it drove on its trajectory.",
            )
        if follow.number("initialDistanceOffset", 0.0) != 0.0:
            raise follow.refused("begins within its trajectory (initialDistanceOffset)", TRAJECTORIES)
        holder = follow.child("TrajectoryRef") or follow
        told = next(holder.children("Trajectory", "CatalogReference"), None)
        if told is None:
            raise follow.refused("has no Trajectory")
        reference = follow.child("TimeReference")
        timing = None if reference is None else reference.child("Timing")
        curve = scenario_curve(self._catalogs.resolved(told), self._places, timed=timing is not None)
        if timing is None:
            return curve
        domain, scale = timing.text("domainAbsoluteRelative"), timing.number("scale", 1.0)
        if domain not in ("absolute", "relative") or scale <= 0.0:
            raise timing.refused(
                f"is {domain!r} with scale {scale:g}, expected 'absolute' or 'relative', above 0"
            )
        offset = timing.number("offset", 0.0) + (at if domain == "relative" else 0.0)
        return curve.over(scale, offset)

    def _refused(self, told: ScenarioElement, at: float) -> InputError:
        """The error for what moves as the player has it, naming the innermost action."""
        while told.tag in ("LongitudinalAction", "LateralAction", "RoutingAction", "ControllerAction"):
            if (inner := next(told.children(), None)) is None:
                break
            told = inner
        remedy = f"--end {at:g} imports what is before it" if at > 0.0 else TRAJECTORIES
        return told.refused(f"is not read: from {at:g} s on the player decides how it moves", remedy)


def _reference(action: ScenarioElement) -> str | None:
    """The entity on which an action of Init depends, None for none."""
    place = action.child("TeleportAction", "Position")
    speed = action.child("LongitudinalAction", "SpeedAction", "SpeedActionTarget")
    told = [*([] if place is None else place.children(*RELATIVE))]
    told += [*([] if speed is None else speed.children("RelativeTargetSpeed"))]
    return told[0].text("entityRef") if told else None


def _moves(action: ScenarioElement) -> bool:
    """Whether an Action may move somebody."""
    inner = [one for kind in action.children() for one in ([*kind.children()] or [kind])]
    return any(one.tag not in (*_STILL, *_GLOBAL) for one in inner)


def _is_off(controller: ScenarioElement) -> bool:
    """Whether an action of controllers lets none drive."""
    if controller.tag == "ActivateControllerAction":
        return not (controller.flag("lateral", False) or controller.flag("longitudinal", False))
    if controller.tag == "AssignControllerAction":
        return not (controller.flag("activateLateral", True) or controller.flag("activateLongitudinal", True))
    if controller.tag == "OverrideControllerValueAction":
        return not any(one.flag("active", True) for one in controller.children())
    return False


def _refuse_rivals(deeds: list[Deed]) -> None:
    """Of two actions of a story of one kind that begin at once, the player says which one drives.

    deeds: of one entity, in the order of their times.
    """
    last: dict[type, Deed] = {}
    for deed in deeds:
        before = last.get(type(deed.what))
        if before is not None and deed.at - before.at < TICK and before.element.xml is not deed.element.xml:
            raise deed.element.refused(
                f"begins at {deed.at:g} s, as another of its entity does (line {before.element.xml.sourceline}): the "
                "player decides", "Keep one of the two.",
            )  # fmt: skip
        last[type(deed.what)] = deed


def _refuse_repeated(one: ScenarioElement) -> None:
    count = one.number("maximumExecutionCount", 1.0)
    if count != 1.0:
        raise one.refused(
            f"maximumExecutionCount is {count:g}, expected 1", "Give each time an event of its own."
        )
