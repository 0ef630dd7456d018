"""What the verification of one recording gave, and what verification.json holds of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import median
from typing import TypeVar

from resim.recordings.checked import finding_lines
from resim.resimulation.assessed import ResimulationAssessment
from resim.resimulation.drive_outcome import DriveOutcome, Kpi, Rms
from resim.resimulation.result import Resimulation
from resim.verification.blame import OpenLoopFinding
from resim.verification.cause import Cause
from resim.verification.compare import (
    DriveComparison,
    Equality,
    SeedVerdict,
    SimulatedSource,
    VerificationVerdict,
)
from resim.verification.entries import (
    MODEL,
    ComparedRun,
    KpiComparison,
    KpiEntry,
    OpenLoopEntry,
    PerDrive,
    RecordingSource,
    SeedRun,
    SeedRuns,
    SingleRun,
    VerifiedRecording,
    WayRuns,
)
from resim.verification.share import SeedShare, share
from resim.verification.validity_interval import ValidityInterval

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class VerificationResult:
    """What the verification of a recording gave.

    played: what a player shows, with one seed of a perception model, and how it was assessed.
    outcomes: of GT, SD, rGT, rSD, as far as they are there; seeds: of the runs with the perception model, by seed.
    judged, causes: by way. recorded: the run on GT that showed the function what was recorded as perceived, beside the
    measured drive, where that was tried. driven: what it answers along the measured drive. validity: a range a
    parameter; notes say why there is none.
    """

    result: Resimulation
    played: tuple[Resimulation, ResimulationAssessment]
    outcomes: Mapping[str, DriveOutcome]
    seeds: Mapping[int, DriveOutcome]
    errors: Rms
    judged: Mapping[SimulatedSource, SeedVerdict]
    causes: Mapping[SimulatedSource, Cause | None]
    recorded: DriveComparison | None
    driven: OpenLoopFinding | None
    validity: tuple[ValidityInterval, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def way(self) -> SimulatedSource:
        """The basis that the verdict is judged by: GT with the perception model, else GT, else SD."""
        order: tuple[SimulatedSource, ...] = ("rGT+M", "rGT", "rSD")
        return next(way for way in order if way in self.judged)

    @property
    def failure(self) -> str:
        """Why the function failed in any run, or ""."""
        every = [c.failure for judged in self.judged.values() for c in judged.comparisons]
        return next((failure for failure in every if failure), "")

    @property
    def verdict(self) -> VerificationVerdict:
        """That of the basis that it is judged by; an error where the function failed in any run."""
        return "error" if self.failure else self.judged[self.way].verdict

    def entry(self, source: RecordingSource) -> VerifiedRecording:
        """Give what verification.json says of the recording, which lies at `source`."""
        return VerifiedRecording(
            **vars(source),
            verdict=self.verdict,
            way=self.way,
            error=self.failure or None,
            cause=self.causes[self.way],
            ways={way: self._way(way) for way in self.judged},
            kpis={name: self._kpi(name) for name in self.outcomes["GT"].kpis},
            decision=self._per_drive(lambda o: tuple(o.decision)),
            reaction=self._per_drive(lambda o: o.reaction),
            reaction_spread=self.outcomes["GT"].reaction_spread,
            risk=self._per_drive(lambda o: o.risk),
            comfort=self._per_drive(lambda o: o.comfort),
            errors=self.errors,
            recorded=None if self.recorded is None else _compared(self.recorded),
            driven=None if self.driven is None else _driven(self.driven),
            cases={name: drive.case.hash for name, drive in self.result.drives.items()},
            validity=self.validity,
            findings=finding_lines(self.result.recording.findings),
            notes=self.notes,
        )

    def _off(self, way: SimulatedSource, name: str) -> float | None:
        """How far the KPI's value is from the measured one, in its unit; over seeds the median."""
        runs = self.seeds.values() if way == MODEL else [self.outcomes[way]]
        gt = self.outcomes["GT"].kpis[name].value
        values = [k.value for o in runs if (k := o.kpis.get(name)) is not None and k.value is not None]
        return None if gt is None or not values else float(median(values) - gt)

    def _per_drive(self, of: Callable[[DriveOutcome], T]) -> PerDrive[T]:
        """Something of all outcomes, by drive."""
        single = {source: of(outcome) for source, outcome in self.outcomes.items()}
        seeds = {"over_seeds": tuple(of(o) for o in self.seeds.values())} if self.seeds else {}
        return PerDrive(**single, **seeds)  # type: ignore[arg-type]

    def _way(self, way: SimulatedSource) -> WayRuns:
        judged, cause = self.judged[way], self.causes[way]
        if (test := judged.test) is None:
            return SingleRun(cause=cause, **vars(_compared(judged.comparisons[0])))
        each = zip(self.seeds.items(), judged.comparisons, strict=True)
        return SeedRuns(
            verdict=judged.verdict,
            cause=cause,
            agreement=test.demand,
            share=judged.share,
            needed=judged.needed,
            same_decision=share([c.same_decision and c.whole and not c.failure for c in judged.comparisons]),
            seeds=tuple(
                SeedRun(seed=seed, **vars(_compared(c)), end=o.end, errors=o.errors) for (seed, o), c in each
            ),
        )

    def _kpi(self, name: str) -> KpiComparison:
        """One criterion: the KPI of each drive, whether they are equal, and the share of seeds that are."""
        gt = self.outcomes["GT"].kpis[name]
        equal: dict[SimulatedSource, Equality | SeedShare] = {
            way: j.comparisons[0].kpis[name] for way, j in self.judged.items() if way != MODEL
        }
        single = {source: _kpi_entry(o.kpis.get(name)) for source, o in self.outcomes.items()}
        over_seeds: dict[str, tuple[KpiEntry | None, ...]] = {}
        if MODEL in self.judged:
            over_seeds["over_seeds"] = tuple(_kpi_entry(o.kpis.get(name)) for o in self.seeds.values())
            equal[MODEL] = share([c.kpis[name] == "equal" for c in self.judged[MODEL].comparisons])
        off = {way: self._off(way, name) for way in self.judged}
        return KpiComparison(
            unit=gt.unit, weight=gt.weight, difference=off, equal=equal,
            **single, **over_seeds,  # type: ignore[arg-type]
        )  # fmt: skip


def _kpi_entry(kpi: Kpi | None) -> KpiEntry | None:
    """A KPI without what all of its criterion share; None for a run that ended before there was anything to judge."""
    return None if kpi is None else KpiEntry(kpi.outcome, kpi.value, kpi.t, kpi.object, kpi.reason)


def _driven(driven: OpenLoopFinding) -> OpenLoopEntry:
    return OpenLoopEntry(
        error=driven.error,
        beyond=driven.beyond,
        t=driven.t,
        function=driven.function,
        planned_otherwise=driven.planned,
        blamed=driven.blamed,
        text=str(driven),
    )


def _compared(c: DriveComparison) -> ComparedRun:
    return ComparedRun(
        verdict=c.verdict,
        same_decision=c.same_decision,
        reaction_difference=c.reaction_difference,
        t=c.t,
        differences=c.differences,
        beyond=c.beyond,
        failure=c.failure or None,
    )
