"""How far a verified recording can be varied in simulation until a KPI flips (Groh 2018, III.C)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from resim.assess.assessment import Assessment
from resim.core.errors import ResimError
from resim.perception.sensor import Sensor
from resim.pipeline.assessments import How
from resim.pipeline.outcomes import perceived_outcome
from resim.pipeline.result import Resimulation
from resim.pipeline.run import run_on_gt
from resim.variation import PARAMETERS, vary
from resim.verification.validity import Validity, search


def validity(result: Resimulation, parameter: str, whom: str, how: How) -> Validity:
    """Search the range of a parameter of one object in which every KPI of the simulation stays.

    Simulated on GT, with the perception model of the re-simulation if it has one: a KPI is then what most of the seeds
    give. Raises ResimError where there is nothing to vary.
    """
    base = _kpis(result, how)

    def flips(amount: float) -> tuple[str, ...]:
        scenario = vary(result.described["GT"], result.network, whom, parameter, amount)
        found = _kpis(replace(result, described={**result.described, "GT": scenario}), how)
        return tuple(name for name, outcome in base.items() if found.get(name) != outcome)

    which = PARAMETERS[parameter]
    low, high, tried = search(flips, which.most, which.resolution)
    return Validity(parameter, which.unit, whom, low, high, which.resolution, tried)


def _kpis(result: Resimulation, how: How) -> Mapping[str, str]:
    """The outcome of each criterion when GT's scenario is simulated: over seeds that of most, in a tie the first."""
    seen = result.perceiving
    runs = [run_on_gt(result)] if seen is None else [
        run_on_gt(result, perception=Sensor(seen.model), seed=seed) for seed in seen.seeds
    ]  # fmt: skip
    each = [perceived_outcome(run, result, how).kpis for run in runs]
    names = dict.fromkeys(name for kpis in each for name in kpis)
    return {
        name: Counter(kpis[name].outcome for kpis in each if name in kpis).most_common(1)[0][0]
        for name in names
    }


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
