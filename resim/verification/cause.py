"""Why simulation and measured drive differ: the first step in the chain whose error explains it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from resim.resimulation.drive_outcome import Rms
from resim.verification.blame import OpenLoopFinding
from resim.verification.compare import DriveComparison, SeedVerdict
from resim.verification.tolerance import Excess, Tolerances

Step = Literal[
    "sensor",
    "sensor and vehicle",
    "fit",
    "simulation",
    "vehicle",
    "function",
    "function or vehicle",
    "criteria",
    "seeds",
]


@dataclass(frozen=True)
class Cause:
    """The step, why it is held for the cause, and when [s] the first difference shows."""

    step: Step
    text: str
    t: float | None


def cause(
    judged: SeedVerdict,
    errors: Rms,
    tolerances: Tolerances,
    recorded: DriveComparison | None,
    shown: str = "the truth",
    driven: OpenLoopFinding | None = None,
    *,
    oracle: bool = False,
) -> Cause | None:
    """Give the cause of a verdict that is not good, None for a good one.

    recorded: the re-simulation on ground truth in which the function was shown what was recorded as perceived, None
    where nothing was. shown: what the function was shown in the runs of the verdict. driven: what it answers along the
    measured drive, None where that is not known. oracle: it places the EGO where it was measured, whatever it is shown.
    In the order of the chain (Wagner 2021, 5.3.2): the sensor's error is the cause where most of what differs is as
    measured once the function is shown what was recorded, and the vehicle's as well where something is left and it
    moves differently from its model; where that cannot be tried, or mends little, it is the first step whose error is
    beyond tolerance, the vehicle's among them; where none is, the function itself.
    """
    if judged.verdict in ("verified", "error"):
        return None
    worst = judged.worst
    if judged.verdict == "invalid":
        return Cause("criteria", f"cannot be judged: {', '.join(_invalid(worst))}", worst.t)
    if judged.verdict == "undecided":
        return Cause("seeds", _undecided(judged), worst.t)
    sensor = [] if oracle else list(tolerances.beyond("sensor", errors.get("S", {})))
    tried = []
    if recorded is not None:
        mended = sorted(worst.unequal & recorded.equal)
        left = sorted(worst.unequal - recorded.equal)
        if len(mended) > len(left):
            blamed = driven.blamed if left and driven is not None else None
            text = "; ".join([_sensor(sensor, shown, mended, left), *([str(driven)] if blamed else [])])
            return Cause("sensor and vehicle" if blamed == "vehicle" else "sensor", text, worst.t)
        tried = (
            [f"shown what was recorded as perceived, {_list(left)} not as measured either"] if left else []
        )
        if recorded.failure:
            tried = [f"shown what was recorded as perceived, the function failed: {recorded.failure}"]
    if recorded is None and sensor:
        return Cause("sensor", f"{_excess_in_words(sensor)}; not tested", worst.t)
    steps: tuple[Step, ...] = ("sensor", "fit", "simulation")
    for step in steps:
        if far := [excess for excess in worst.beyond if excess.step == step]:
            return Cause(step, "; ".join([_excess_in_words(far), *tried]), worst.t)
    if oracle:
        return Cause("criteria", "a KPI is at its limit: the EGO was placed where it was measured", worst.t)
    if driven is not None and driven.blamed is not None:
        since = worst.t if driven.blamed == "function" else driven.t
        return Cause(driven.blamed, "; ".join([str(driven), *tried]), since)
    if recorded is None:
        tried = ["there are no sensor data: errors of perception cannot be separated from the function's own"]
    own = "no step before it is beyond tolerance: it acts differently itself, or a KPI is at its limit"
    moved = [] if driven is None else [str(driven)]
    return Cause("function", "; ".join([own, *tried, *moved]), worst.t)


def _undecided(judged: SeedVerdict) -> str:
    """What the seeds leave open, and how many would tell."""
    told = judged.share
    return (
        f"{told.count} of {told.of} seeds agree, [{told.low:.3f}, {told.high:.3f}] at {told.confidence:.0%}: neither "
        f"enough nor too few; some {judged.needed} seeds would decide, if this is the true share"
    )


def _sensor(beyond: list[Excess], shown: str, mended: list[str], left: list[str]) -> str:
    """What the function was shown, and what becomes as measured when it is shown what was recorded."""
    text = (
        f"the function was shown {shown}; shown what was recorded as perceived, {_list(mended)} as measured"
    )
    text += f", but not {', '.join(left)}" if left else ""
    return f"{text}. Sensor error: {_excess_in_words(beyond)}" if beyond else text


def _list(names: list[str]) -> str:
    return f"{', '.join(names)} {'is' if len(names) == 1 else 'are'}"


def _excess_in_words(beyond: list[Excess]) -> str:
    return ", ".join(map(str, beyond))


def _invalid(comparison: DriveComparison) -> list[str]:
    return [name for name, equality in comparison.kpis.items() if equality == "invalid"]
