"""What is assessed and how, and what is found: of each of GT, SD, rGT, rSD."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import pandas as pd

from resim.core.errors import InputError
from resim.metrics.assessment import Assessment
from resim.metrics.assessment_report import kpi_rows
from resim.metrics.criteria import Criteria
from resim.metrics.drive import PathSource
from resim.metrics.risk import DEFAULTS, RiskParameters
from resim.metrics.risk.prediction import Prediction
from resim.resimulation.model_runs import MODEL, ModelRuns
from resim.road.opendrive import RoadNetwork

SIMULATED = ("rGT", "rSD")
"""Sources that are simulations of one seed."""
RATE = 10.0
"""Scenes a second [Hz] that are assessed, if nothing else is said."""


@dataclass(frozen=True, eq=False)
class AssessmentOptions:
    """How to assess.

    Attributes:
        parameters: Of the accident risk.
        path: Where the EGO's path comes from: its plan (where there is none its state), its state, or where it drove.
        prediction: How objects may go on; None: as published.
        road_aware: Whether objects are predicted along their lanes.
        criteria: What to judge by, if anything.
        only: Measures to compute besides those that criteria ask for, None for all.
        rate: Scenes a second [Hz].
        decides: Sources whose verdict is that on the drive; None: all that were simulated, or else measured.
    """

    parameters: RiskParameters = DEFAULTS
    path: PathSource = "plan"
    prediction: Prediction | None = None
    road_aware: bool = False
    criteria: Criteria | None = None
    only: tuple[str, ...] | None = None
    rate: float = RATE
    decides: tuple[str, ...] | None = None


def refuse_absent(decides: Collection[str], there: Collection[str]) -> None:
    """Raise InputError for a source that is to decide and is not there."""
    if absent := [name for name in decides if name not in there]:
        problem = f"{absent[0]} is not judged here; there are: {', '.join(there)}"
        raise InputError("--verdict-of", problem, "Name one of these.")


@dataclass(frozen=True, eq=False)
class ResimulationAssessment:
    """The assessment of each of GT, SD, rGT, rSD, as far as they are there.

    Attributes:
        name: Of the recording.
        network: The roads.
        run: Whether it is of a re-simulation.
        blocks: The assessments, by source.
        criteria: What they were judged by, None where there were none.
        failures: Of runs that failed, and why, by source (`rGT+M3` is of seed 3); also of those that have no
            assessment, as there was nothing to assess.
        findings: What is wrong with the recording, worst first, notes left out.
        model: The runs with a perception model, where there are any, and criteria to judge them by.
        misfits: Lines that name objects whose traces, by which they are assessed, are not where they were.
        decides: Sources whose verdict is that on the drive, None as in `AssessmentOptions`.
    """

    name: str
    network: RoadNetwork
    run: bool
    blocks: Mapping[str, Assessment]
    criteria: Criteria | None
    failures: Mapping[str, str]
    findings: tuple[str, ...] = ()
    model: ModelRuns | None = None
    misfits: tuple[str, ...] = ()
    decides: tuple[str, ...] | None = None

    def notes(self) -> list[str]:
        """Give what one has to know to compare the blocks and to believe them."""
        kinds = {name: sorted(set(a.drive.path)) for name, a in self.blocks.items()}
        out = []
        if len({tuple(k) for k in kinds.values()}) > 1:
            told = "; ".join(f"{name} by its {' and '.join(k)}" for name, k in kinds.items())
            folder = "RESULTS" if self.run else "RECORDING"
            out.append(
                f"the EGO's path differs: {told}; `resim assess {folder} --path state` makes them comparable"
            )
        out += [f"{name}: {why}" for name, why in self._lost().items()]
        out += self.misfits
        deciding = self.deciding()
        if others := [f"{name} {verdict}" for name, verdict in self._bad().items() if name not in deciding]:
            out.append(f"{', '.join(others)}: reported only; the verdict is decided by {', '.join(deciding)}")
        out += [f"{name}: {note}" for name, a in self.blocks.items() for note in a.notes()]
        seeds = [] if self.model is None else [a for a in self.model.seeds.values() if a is not None]
        asked = dict.fromkeys(m.note for a in seeds for m in a.measures.values() if m.note)
        return out + [f"{MODEL}: {note}" for note in asked]

    def deciding(self) -> tuple[str, ...]:
        """Give the sources whose verdict is that on the drive. Raises InputError for one that is not there."""
        model = () if self.model is None else (MODEL,)
        there = (*self.blocks, *model)
        if self.decides is None:
            return (*(name for name in self.blocks if name in SIMULATED), *model) or there
        refuse_absent(self.decides, (*there, *self._lost()))
        return self.decides

    def _lost(self) -> dict[str, str]:
        """The runs without a perception model that have no assessment, and why."""
        return {
            name: why
            for name, why in self.failures.items()
            if name not in self.blocks and not name.startswith(MODEL)
        }

    def bad(self) -> dict[str, str]:
        """Give the verdict of each source that decides and does not pass."""
        deciding = self.deciding()
        return {name: verdict for name, verdict in self._bad().items() if name in deciding}

    def _bad(self) -> dict[str, str]:
        out = {name: str(a.verdict) for name, a in self.blocks.items() if a.verdict not in (None, "PASS")}
        if self.model is not None and self.model.verdict != "PASS":
            counts = self.model.counts()
            out[MODEL] = f"{self.model.verdict} ({counts['PASS']} of {sum(counts.values())} seeds pass)"
        return out

    def kpi_frame(self) -> pd.DataFrame:
        """Give the worst of every measure and the KPI of every criterion, one row each, by source."""
        rows = [row for name, a in self.blocks.items() for row in kpi_rows(a, name)]
        rows += [] if self.model is None else self.model.kpi_rows()
        frame = pd.DataFrame(rows)
        numbers = ["value", "t", "limit", "weight"]
        return frame.assign(**{column: frame[column].astype(float) for column in numbers})
