"""One simulated drive beside the measured one: are the KPIs equal, and does the EGO do the same?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from resim.resimulation.drive_outcome import DriveOutcome, Kpi, Rms
from resim.verification.ends import another_collision
from resim.verification.sequential import ERROR, SequentialTest, StoppingPoint
from resim.verification.share import SeedShare
from resim.verification.tolerance import Excess, Tolerances, excesses

VerificationVerdict = Literal["verified", "not verified", "undecided", "invalid", "error"]
SimulatedSource = Literal["rGT", "rSD", "rGT+M"]
"""Re-simulated on ground truth, on sensor data, and on ground truth with a perception model."""
Equality = Literal["equal", "differs", "invalid"]
NO_EVENT = "nothing"


@dataclass(frozen=True)
class DriveComparison:
    """A simulated drive beside the measured one.

    kpis: by criterion, "invalid" where either cannot be judged. same_decision: whether the EGO did the same, in the
    same order. reaction_difference [s]: simulated minus measured first braking. late: whether it is beyond tolerance.
    beyond: errors of the steps that are. whole: both ended alike, so that nothing passes for being cut short. t: when
    [s] the first difference shows, None where none does. failure: why the function failed, or "".
    """

    kpis: Mapping[str, Equality]
    same_decision: bool
    reaction_difference: float | None
    late: bool
    beyond: tuple[Excess, ...]
    t: float | None
    differences: tuple[str, ...]
    failure: str
    whole: bool = True

    @property
    def equal(self) -> frozenset[str]:
        """What is as measured, by the names of `unequal`; nothing where the function failed."""
        if self.failure:
            return frozenset()
        kpis = {name for name, equality in self.kpis.items() if equality == "equal"}
        return frozenset(kpis | {"decision", "first braking", "pipeline error", "end"} - self.unequal)

    @property
    def unequal(self) -> frozenset[str]:
        """What is not as measured: criteria by name, "decision", "first braking", "pipeline error", "end"."""
        found = {name for name, equality in self.kpis.items() if equality == "differs"}
        others = {
            "decision": not self.same_decision,
            "first braking": self.late,
            "pipeline error": any(excess.step == "pipeline" for excess in self.beyond),
            "end": not self.whole,
        }
        return frozenset(found | {name for name, differs in others.items() if differs})

    @property
    def verdict(self) -> VerificationVerdict:
        """Verified: all KPIs equal, the decision too, errors within tolerance (Groh 2018, III.B)."""
        if self.failure:
            return "error"
        if self.differences:
            return "not verified"
        return "invalid" if "invalid" in self.kpis.values() else "verified"


@dataclass(frozen=True)
class SeedVerdict:
    """All re-simulations of one way, and the verdict of the test of their share; without a test there is one run."""

    way: SimulatedSource
    comparisons: tuple[DriveComparison, ...]
    test: SequentialTest | None = None

    @property
    def share(self) -> SeedShare:
        """The share of the runs that are verified, with its interval after a test that ends when it can tell.

        A run that cannot be judged might agree or not: it counts against the lower end and for the upper one.
        """
        assert self.test is not None
        sure, best = self._stops(self.test)
        counted = self._count("verified"), len(self.comparisons)
        low, high = self.test.interval(sure)[0], self.test.interval(best)[1]
        return SeedShare(*counted, low, high, 1.0 - 2.0 * ERROR, "exact, after a sequential test")

    @property
    def verdict(self) -> VerificationVerdict:
        """Verified or not where the test tells so, whatever came of the runs that cannot be judged.

        Invalid where it hangs on these, and undecided where the test has not ended.
        """
        if self.test is None:
            return self.comparisons[0].verdict
        if self._count("error"):
            return "error"
        sure, best = self._stops(self.test)
        if sure.told == "enough":
            return "verified"
        if best.told == "too few":
            return "not verified"
        return "undecided" if sure.told is None or best.told is None else "invalid"

    @property
    def needed(self) -> int | None:
        """How many seeds would tell where it is undecided, if the share seen is the true one; else None."""
        if self.test is None or self.verdict != "undecided":
            return None
        return self.test.needed(self._stops(self.test)[0])

    @property
    def worst(self) -> DriveComparison:
        """The first run that is the reason for the verdict; where it is undecided, the first that does not agree."""
        reasons = ("not verified", "invalid") if self.verdict == "undecided" else (self.verdict,)
        return next((c for c in self.comparisons if c.verdict in reasons), self.comparisons[0])

    def _count(self, verdict: VerificationVerdict) -> int:
        return sum(c.verdict == verdict for c in self.comparisons)

    def _stops(self, test: SequentialTest) -> tuple[StoppingPoint, StoppingPoint]:
        """Where the test ends if no run that cannot be judged agrees, and if all of them do."""
        good: tuple[tuple[VerificationVerdict, ...], ...] = (("verified",), ("verified", "invalid"))
        sure, best = (test.stop([c.verdict in which for c in self.comparisons]) for which in good)
        return sure, best


def compare(
    way: SimulatedSource, measured: DriveOutcome, simulated: DriveOutcome, errors: Rms, tolerances: Tolerances
) -> DriveComparison:
    """Set a simulated drive beside the measured one. errors: of the recording's steps."""
    kpis = {name: _equality(kpi, simulated.kpis.get(name)) for name, kpi in measured.kpis.items()}
    reaction = _minus(simulated.reaction, measured.reaction)
    late = reaction is not None and tolerances.reaction is not None and abs(reaction) > tolerances.reaction
    beyond = excesses(way, errors, tolerances)
    if simulated.errors is not None:
        beyond += tolerances.beyond("pipeline", {"ego": simulated.errors})
    told = list(_differences(kpis, measured, simulated))
    alike = measured.collision == simulated.collision and (simulated.whole or measured.collision)
    if not alike:
        told.append((None, _ended(measured, simulated)))
    elif other := another_collision(measured, simulated):
        alike = False
        told.append((_sooner(measured, simulated), other))
    if late and reaction is not None and tolerances.reaction is not None:
        begun = min(t for t in (measured.reaction, simulated.reaction) if t is not None)
        off = "" if measured.reaction_spread is None else f" ± {measured.reaction_spread:.2f}"
        told.append((begun, f"first braking {reaction:+.2f}{off} s (tolerance {tolerances.reaction:g} s)"))
    times = [t for t, _ in told if t is not None]
    return DriveComparison(
        kpis=kpis,
        same_decision=measured.decision == simulated.decision,
        reaction_difference=reaction,
        late=late,
        beyond=tuple(beyond),
        t=min(times, default=None),
        differences=(*(text for _, text in told), *(f"{e.step} error: {e}" for e in beyond)),
        failure=simulated.failure,
        whole=alike,
    )


def _sooner(measured: DriveOutcome, simulated: DriveOutcome) -> float:
    """When [s] the first of two collisions is."""
    return min(end.t for end in (measured.bad, simulated.bad) if end is not None)


def _ended(measured: DriveOutcome, simulated: DriveOutcome) -> str:
    """How the simulation ended differently from the drive."""
    if measured.collision != simulated.collision:
        return (
            "the EGO collides only in the drive"
            if measured.collision
            else "the EGO collides only in simulation"
        )
    return f"the simulation ended early: {simulated.end.replace('_', ' ')}"


def _equality(measured: Kpi, simulated: Kpi | None) -> Equality:
    if simulated is None or "INVALID" in (measured.outcome, simulated.outcome):
        return "invalid"
    return "equal" if measured.outcome == simulated.outcome else "differs"


def _differences(
    kpis: Mapping[str, Equality], measured: DriveOutcome, simulated: DriveOutcome
) -> Iterator[tuple[float | None, str]]:
    """When [s] they differ, and in what."""
    if measured.decision != simulated.decision:
        diverged = _first_divergence(measured.events, simulated.events)
        did = (", ".join(o.decision).replace("_", " ") or NO_EVENT for o in (measured, simulated))
        yield diverged, "decision: {} measured, {} simulated".format(*did)
    for name, equality in kpis.items():
        if equality == "differs":
            both = measured.kpis[name], simulated.kpis[name]
            broken = next(k for k in both if k.outcome == "FAIL")
            yield broken.t, f"{name}: {kpi_text(both[0])} measured, {kpi_text(both[1])} simulated"


def kpi_text(kpi: Kpi) -> str:
    """Give a KPI in words: `FAIL (-4.2 m/s² at 7.3 s)`."""
    if kpi.value is None or kpi.t is None:
        return kpi.outcome
    unit = "" if kpi.unit == "1" else f" {kpi.unit}"
    return f"{kpi.outcome} ({kpi.value:.3g}{unit} at {kpi.t:.1f} s)"


def _first_divergence(one: Sequence[tuple[float, str]], two: Sequence[tuple[float, str]]) -> float:
    """When the first event is that only one of both has there."""
    for (t, name), (u, other) in zip(one, two, strict=False):
        if name != other:
            return min(t, u)
    longer = max(one, two, key=len)
    return longer[min(len(one), len(two))][0]


def _minus(later: float | None, earlier: float | None) -> float | None:
    return None if later is None or earlier is None else round(later - earlier, 9)
