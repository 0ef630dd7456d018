"""How far a verified recording can be varied in simulation until a KPI flips (Groh 2018, III.C)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from resim.core.errors import ResimError
from resim.metrics.assessment import Assessment
from resim.perception.runtime.sensor import Sensor
from resim.resimulation.assessed import AssessmentOptions
from resim.resimulation.compute_outcome import seed_outcomes
from resim.resimulation.drive_outcome import Kpi
from resim.resimulation.result import Resimulation
from resim.resimulation.run import run_on_gt
from resim.scenario.variation import PARAMETERS, vary
from resim.verification.validity_interval import ValidityInterval, search

SEEDS = 20
"""Seeds that each change is simulated with, where a verdict took more."""
FAILED = "the function failed"
"""Stands for the criteria that flip where the function fails."""


def validity(
    result: Resimulation, measured: Mapping[str, Kpi], parameter: str, whom: str, how: AssessmentOptions
) -> ValidityInterval:
    """Search the range of a parameter of one object in which every KPI of the simulation stays that of the drive.

    Simulated on GT, with the perception model of the re-simulation if it has one: a KPI is then what most of the seeds
    give. Raises ResimError where there is nothing to vary, or a KPI is another already without a change.
    """

    def flips(amount: float) -> tuple[str, ...]:
        scenario = vary(result.described["GT"], result.network, whom, parameter, amount)
        prepared = replace(result.prepared, described={**result.described, "GT": scenario})
        return _unlike(replace(result, prepared=prepared), measured, how)

    if at_once := flips(0.0):
        raise ResimError(f"simulated on GT, {', '.join(at_once)} is not as measured without any change")
    which = PARAMETERS[parameter]
    low, high, tried = search(flips, which.most, which.resolution)
    return ValidityInterval(parameter, which.unit, whom, low, high, which.resolution, tried)


def _unlike(result: Resimulation, measured: Mapping[str, Kpi], how: AssessmentOptions) -> tuple[str, ...]:
    """Which criteria come out otherwise when GT's scenario is simulated: by most of the seeds, in a tie the first."""
    seen = result.perceiving
    bare = Resimulation(result.prepared, result.build, result.options)
    for seed in (0,) if seen is None else seen.seeds[:SEEDS]:
        bare = run_on_gt(bare, perception=None if seen is None else Sensor(seen.model), seed=seed)
    if any(drive.failure for drive in bare.drives.values()):
        return (FAILED,)
    each = [found.kpis for found in seed_outcomes([(bare, seed) for seed in bare.seeds], how)]
    out = []
    for name, kpi in measured.items():
        found = Counter(kpis[name].outcome if name in kpis else "INVALID" for kpis in each)
        if found.most_common(1)[0][0] != kpi.outcome:
            out.append(name)
    return tuple(out)


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
