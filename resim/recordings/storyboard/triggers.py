"""When triggers fire that name plain times.

Source: ASAM OpenSCENARIO XML 1.3, "Trigger": a group's conditions all, one of the groups. With the edge "none" a
condition holds once its time is reached; with "rising" it does at that moment only.
"""

from __future__ import annotations

import math

from resim.recordings.storyboard.document import ScenarioElement

_TIMES = "Triggers that are read are SimulationTimeCondition, greaterThan or greaterOrEqual."
_AT_ONCE = 1e-9
"""s by which a time may be over and still be now."""


def trigger_time(trigger: ScenarioElement | None, since: float) -> float | None:
    """Give when [s] a trigger fires, None for one that is missing or has no condition.

    Args:
        trigger: StartTrigger or StopTrigger.
        since: From when on [s] its conditions are looked at.

    Raises:
        InputError: It depends on anything else than time.
    """
    groups = [] if trigger is None else [*trigger.children("ConditionGroup")]
    times = [_group_time(group, since) for group in groups]
    told = [t for t in times if t is not None]
    return min(told) if told else None


def _group_time(group: ScenarioElement, since: float) -> float | None:
    conditions = [*group.children("Condition")]
    found = [_condition_time(one, since, alone=len(conditions) == 1) for one in conditions]
    return max(found) if found else None


def _condition_time(condition: ScenarioElement, since: float, *, alone: bool) -> float:
    told = condition.only()
    while told.tag in ("ByValueCondition", "ByEntityCondition", "EntityCondition"):
        inner = told.child("EntityCondition") or told
        told = inner.only()
    if told.tag != "SimulationTimeCondition":
        raise told.refused("is not read: when it holds depends on the player", _TIMES)
    if (rule := told.text("rule")) not in ("greaterThan", "greaterOrEqual"):
        raise told.refused(f"rule is {rule!r}, expected greaterThan or greaterOrEqual", _TIMES)
    edge, delay = condition.get("conditionEdge", "none"), condition.number("delay", 0.0)
    value = told.number("value")
    if edge not in ("none", "rising", "risingOrFalling") or (edge != "none" and not alone):
        raise condition.refused(
            f"conditionEdge is {edge!r}{'' if alone else ' beside other conditions'}, expected 'none'"
        )
    if delay < 0.0:
        raise condition.refused(f"delay is {delay:g} s, expected 0 or more")
    if edge != "none" and max(value, 0.0) < since - _AT_ONCE:
        problem = f"rises at {value:g} s, before it is looked at from {since:g} s on: players differ"
        raise condition.refused(problem, "Set its conditionEdge to none.")
    return max(max(value, 0.0) + delay, since)


def never(t: float | None) -> float:
    """Give a time [s], or infinity for none."""
    return math.inf if t is None else t
