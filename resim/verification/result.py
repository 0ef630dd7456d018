"""What the verification of one recording gave, and what verification.json holds of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

from resim.recordings.checked import finding_lines
from resim.resimulation.outcome import DriveOutcome, Kpi, Rms
from resim.resimulation.result import Resimulation
from resim.verification.cause import Cause
from resim.verification.compare import DriveComparison, SeedVerdict, Verdict, Way
from resim.verification.share import share
from resim.verification.validity import ValidityInterval
from resim.verification.vehicle import OpenLoop


@dataclass(frozen=True, eq=False)
class VerificationResult:
    """What the verification of a recording gave.

    outcomes: of GT, SD, rGT, rSD, as far as they are there; seeds: of the runs with the perception model, by seed.
    judged, causes: by way. recorded: the run on GT that showed the function what was recorded as perceived, beside the
    measured drive, where that was tried. driven: what it answers along the measured drive. validity: a range a
    parameter; notes say why there is none.
    """

    result: Resimulation
    outcomes: Mapping[str, DriveOutcome]
    seeds: Mapping[int, DriveOutcome]
    errors: Rms
    judged: Mapping[Way, SeedVerdict]
    causes: Mapping[Way, Cause | None]
    recorded: DriveComparison | None
    driven: OpenLoop | None
    validity: tuple[ValidityInterval, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def way(self) -> Way:
        """The way that the verdict rests on: GT with the perception model, else GT, else SD."""
        order: tuple[Way, ...] = ("rGT+M", "rGT", "rSD")
        return next(way for way in order if way in self.judged)

    @property
    def failure(self) -> str:
        """Why the function failed in any run, or ""."""
        every = [c.failure for judged in self.judged.values() for c in judged.comparisons]
        return next((failure for failure in every if failure), "")

    @property
    def verdict(self) -> Verdict:
        """That of the way that it rests on; an error where the function failed in any run."""
        return "error" if self.failure else self.judged[self.way].verdict

    def to_json(self) -> dict[str, Any]:
        """Give what verification.json holds of the recording."""
        return {
            "verdict": self.verdict,
            "way": self.way,
            "error": self.failure or None,
            "cause": _cause(self.causes[self.way]),
            "ways": {way: self._way(way) for way in self.judged},
            "kpis": {name: self._kpi(name) for name in self.outcomes["GT"].kpis},
            "decision": self._of("decision"),
            "reaction": self._of("reaction"),
            "reaction_spread": self.outcomes["GT"].reaction_spread,
            "risk": self._of("risk"),
            "comfort": self._of("comfort"),
            "errors": self.errors,
            "recorded": None if self.recorded is None else _comparison(self.recorded),
            "driven": None if self.driven is None else _driven(self.driven),
            "cases": {name: drive.case.hash for name, drive in self.result.drives.items()},
            "validity": [asdict(v) for v in self.validity],
            "findings": list(finding_lines(self.result.recording.findings)),
            "notes": list(self.notes),
        }

    def _off(self, way: Way, name: str) -> float | None:
        """How far the KPI's value is from the measured one, in its unit; over seeds the median."""
        runs = self.seeds.values() if way == "rGT+M" else [self.outcomes[way]]
        gt = self.outcomes["GT"].kpis[name].value
        values = [k.value for o in runs if (k := o.kpis.get(name)) is not None and k.value is not None]
        return None if gt is None or not values else float(median(values) - gt)

    def _of(self, name: str) -> dict[str, Any]:
        """One field of all outcomes: by source, a list over the seeds."""
        out = {source: getattr(outcome, name) for source, outcome in self.outcomes.items()}
        return out | ({"rGT+M": [getattr(o, name) for o in self.seeds.values()]} if self.seeds else {})

    def _way(self, way: Way) -> dict[str, Any]:
        judged = self.judged[way]
        out: dict[str, Any] = {"verdict": judged.verdict, "cause": _cause(self.causes[way])}
        if (test := judged.test) is None:
            return {**out, **_comparison(judged.comparisons[0])}
        each = zip(self.seeds.items(), judged.comparisons, strict=True)
        return {
            **out,
            "agreement": test.demand,
            "share": asdict(judged.share),
            "needed": judged.needed,
            "same_decision": asdict(share([c.same_decision for c in judged.comparisons])),
            "seeds": [
                {"seed": seed, **_comparison(c), "end": o.end, "errors": o.errors} for (seed, o), c in each
            ],
        }

    def _kpi(self, name: str) -> dict[str, Any]:
        """One criterion: the KPI of each drive, whether they are equal, and the share of seeds that are."""
        gt = self.outcomes["GT"].kpis[name]
        out: dict[str, Any] = {
            "unit": gt.unit,
            "weight": gt.weight,
            "difference": {way: self._off(way, name) for way in self.judged},
            **{source: _kpi_entry(outcome.kpis.get(name)) for source, outcome in self.outcomes.items()},
            "equal": {way: j.comparisons[0].kpis[name] for way, j in self.judged.items() if way != "rGT+M"},
        }
        if "rGT+M" in self.judged:
            out["rGT+M"] = [_kpi_entry(o.kpis.get(name)) for o in self.seeds.values()]
            equal = [c.kpis[name] == "equal" for c in self.judged["rGT+M"].comparisons]
            out["equal"]["rGT+M"] = asdict(share(equal))
        return out


def _kpi_entry(kpi: Kpi | None) -> dict[str, Any] | None:
    """A KPI as JSON has it; None for a run that ended before there was anything to judge."""
    if kpi is None:
        return None
    return {
        "verdict": kpi.outcome,
        "value": kpi.value,
        "t": kpi.t,
        "object": kpi.object,
        "reason": kpi.reason,
    }


def _driven(driven: OpenLoop) -> dict[str, Any]:
    return {
        "error": dict(driven.error),
        "beyond": [e.model_dump() for e in driven.beyond],
        "t": driven.t,
        "function": driven.function,
        "planned_otherwise": driven.planned,
        "blamed": driven.blamed,
        "text": str(driven),
    }


def _cause(cause: Cause | None) -> dict[str, Any] | None:
    return None if cause is None else asdict(cause)


def _comparison(c: DriveComparison) -> dict[str, Any]:
    return {
        "verdict": c.verdict,
        "same_decision": c.same_decision,
        "reaction_difference": c.reaction_difference,
        "t": c.t,
        "differences": list(c.differences),
        "beyond": [e.model_dump() for e in c.beyond],
        "failure": c.failure or None,
    }
