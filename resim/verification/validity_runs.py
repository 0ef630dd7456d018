"""How far a verified recording can be varied in simulation until a KPI flips (Groh 2018, III.C)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from resim.core.errors import ResimError
from resim.metrics.assessment import Assessment
from resim.perception.runtime.sensor import Sensor
from resim.resimulation.assessed import AssessmentOptions
from resim.resimulation.compute_outcome import seed_outcome, seed_outcomes
from resim.resimulation.drive_outcome import DriveOutcome, Kpi
from resim.resimulation.result import Resimulation
from resim.resimulation.run import run_on_gt, runs_on_gt
from resim.scenario.variation import PARAMETERS, vary
from resim.verification.ends import another_collision
from resim.verification.sequential import SequentialTest
from resim.verification.validity_interval import Unlike, ValidityInterval, search

BATCH = 10
"""Seeds that are simulated together, before it is looked whether they are enough."""
FAILED = "the function fails"
ENDS = {"off_road": "the EGO leaves the road", "collision": "the EGO collides", "function_failed": FAILED}
"""How the end of a run is told, by `SimulatedDrive.end`."""


@dataclass(frozen=True)
class DemandedShare:
    """The seeds that a change may take, in their order, and the test of the verdict that their share has to pass."""

    seeds: Sequence[int]
    test: SequentialTest


def validity(
    result: Resimulation, measured: DriveOutcome, parameter: str, whom: str, how: AssessmentOptions,
    demanded: DemandedShare | None = None,
) -> ValidityInterval:  # fmt: skip
    """Search the range of a parameter of one object in which every KPI of the simulation stays that of the drive.

    Simulated on GT, with the perception model of the re-simulation if it has one: then each change has to pass the
    test of the verdict (`demanded`). Raises ResimError where there is nothing to vary, or the simulation
    is not as measured already without a change.
    """

    def unlike(amount: float) -> Unlike:
        scenario = vary(result.described["GT"], result.network, whom, parameter, amount)
        prepared = replace(result.prepared, described={**result.described, "GT": scenario})
        changed = Resimulation(prepared, result.build, result.options)
        if result.perceiving is None or demanded is None:
            return _unlike(seed_outcome(run_on_gt(changed), 0, how), measured)
        return unlike_over_seeds(changed, Sensor(result.perceiving.model), measured, how, demanded)

    if at_once := unlike(0.0):
        told = [*(f"{name} is not as measured" for name in at_once.flips), *at_once.others]
        raise ResimError(f"simulated on GT without any change, {', '.join(told)}")
    which = PARAMETERS[parameter]
    low, high, tried = search(unlike, which.most, which.resolution)
    return ValidityInterval(
        parameter, which.unit, whom, low, high, which.resolution, tried,
        None if demanded is None else demanded.test.demand,
    )  # fmt: skip


def _unlike(found: DriveOutcome, measured: DriveOutcome) -> Unlike:
    """What is not as measured in one run: KPIs, and that it lasts to the end, and collides where the drive does.

    A run that broke off has shown its KPIs up to there alone (`resim.verification.compare.compare` asks the same).
    """
    if found.failure:
        return Unlike(others=(FAILED,))
    none = Kpi("INVALID", None, "", None, "", 1.0, "")
    flips = tuple(n for n, kpi in measured.kpis.items() if found.kpis.get(n, none).outcome != kpi.outcome)
    if found.collision != measured.collision:
        return Unlike(flips, (ENDS["collision"] if found.collision else "the EGO does not collide",))
    if other := another_collision(measured, found):
        return Unlike(flips, (other,))
    if not found.whole and not measured.collision:
        return Unlike(flips, (ENDS.get(found.end, f"the run ends by {found.end}"),))
    return Unlike(flips)


def unlike_over_seeds(
    changed: Resimulation, sensor: Sensor, measured: DriveOutcome, how: AssessmentOptions,
    demanded: DemandedShare,
) -> Unlike:  # fmt: skip
    """What keeps the share of seeds that are as measured from being told enough: nothing where it is.

    Seeds that cannot be judged do not agree. Where the test cannot tell, nothing is shown, which ends the range too.
    """
    found: list[Unlike] = []
    seeds, test = demanded.seeds, demanded.test
    for first in range(0, len(seeds), BATCH):
        some = seeds[first : first + BATCH]
        runs = runs_on_gt(changed, [(sensor, seed) for seed in some])
        each = seed_outcomes(list(zip(runs, some, strict=True)), how)
        if any(one.failure for one in each):  # as in the verdict, whatever the others do
            return Unlike(others=(FAILED,))
        found += [_unlike(one, measured) for one in each]
        stop = test.stop([not one for one in found])
        if stop.told is not None:
            break
    if stop.told == "enough":
        return Unlike()
    said = f"{stop.agreed} of {stop.of} seeds are as measured, which does not show more than {test.demand:g} of all"
    flips, others = (
        tuple(dict.fromkeys(name for one in found[: stop.of] for name in getattr(one, which)))
        for which in ("flips", "others")
    )
    return Unlike(flips, (*others, said))


def critical(assessment: Assessment) -> str:
    """Give the object of the largest accident risk; where none has any, the one that comes nearest.

    Raises ResimError for a drive without traffic objects.
    """
    drive, tracks = assessment.drive, assessment.drive.tracks
    if not drive.ids:
        raise ResimError("there is no traffic object to vary")
    largest = np.nan_to_num(assessment.risk.r_to).max(axis=0)
    if largest.max() > 0.0:
        return drive.ids[int(largest.argmax())]
    others = tracks.select(drive.ids)
    apart = np.hypot(others.x - drive.own.x, others.y - drive.own.y)
    return drive.ids[int(np.nanmin(np.where(np.isfinite(apart), apart, np.inf), axis=1).argmin())]
