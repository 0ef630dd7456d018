"""The runs with a perception model (rGT+M), judged: a source of its own, with the share of seeds that pass."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from resim.metrics.assessment import Assessment
from resim.metrics.assessment_report import KpiRow, kpi_rows
from resim.metrics.criteria import Criteria, Outcome

MODEL = "rGT+M"
"""What the source is called."""
WORST: tuple[Outcome, ...] = ("FAIL", "INVALID", "PASS")


@dataclass(frozen=True)
class JudgedSeed:
    """The run of one seed: its verdict over all criteria, and whether the EGO collided."""

    seed: int
    verdict: Outcome
    collision: bool


@dataclass(frozen=True)
class CriterionOverSeeds:
    """One criterion over all seeds: its verdict, how many seeds have which, and the share of them that pass."""

    verdict: Outcome
    counts: Mapping[Outcome, int]
    share: float


@dataclass(frozen=True)
class ModelRunsReport:
    """What assessment.json says of the runs with a perception model: over all criteria and seeds, and one by one.

    collisions: in how many seeds the EGO collides.
    """

    model: str
    verdict: Outcome
    seeds: tuple[JudgedSeed, ...]
    counts: Mapping[Outcome, int]
    collisions: int
    criteria: Mapping[str, CriterionOverSeeds]


@dataclass(frozen=True, eq=False)
class ModelRuns:
    """The assessment of each seed, None where its run ended before there was anything to judge; and who collided."""

    model: str
    criteria: Criteria
    seeds: Mapping[int, Assessment | None]
    collided: tuple[int, ...]

    @property
    def verdict(self) -> Outcome:
        """FAIL where a seed fails, else INVALID where one cannot be judged, else PASS."""
        every = {self.verdict_of(seed) for seed in self.seeds}
        return next(outcome for outcome in WORST if outcome in every)

    def verdict_of(self, seed: int) -> Outcome:
        """Give the verdict of one seed over all criteria."""
        found = self.seeds[seed]
        return "INVALID" if found is None else found.verdict or "INVALID"

    def outcome(self, seed: int, criterion: str) -> Outcome:
        """Give the verdict of one seed by one criterion."""
        found = self.seeds[seed]
        return "INVALID" if found is None else found.verdicts[criterion].outcome

    def counts(self, criterion: str | None = None) -> dict[Outcome, int]:
        """Give how many seeds pass, fail or cannot be judged by a criterion, by all where it is None."""
        found = Counter(
            self.verdict_of(seed) if criterion is None else self.outcome(seed, criterion)
            for seed in self.seeds
        )
        return {outcome: found[outcome] for outcome in reversed(WORST)}

    def reasons(self) -> Iterator[str]:
        """Give, by criterion that does not pass in all seeds, how many do not, and why the first of them does not."""
        for name in (c.name for c in self.criteria.criteria):
            for outcome in WORST[:2]:
                if bad := [seed for seed in self.seeds if self.outcome(seed, name) == outcome]:
                    first = self.seeds[bad[0]]
                    why = "it ended at its first step" if first is None else first.verdicts[name].reason
                    yield f"{outcome} {name}: {len(bad)} of {len(self.seeds)} seeds; seed {bad[0]}: {why}"
        if self.collided:
            yield f"collides in {len(self.collided)} of {len(self.seeds)} seeds"

    def kpi_rows(self) -> Iterator[KpiRow]:
        """Give the rows of kpis.parquet: one for each seed and criterion, by source `rGT+M` and the seed."""
        for seed, found in self.seeds.items():
            if found is not None:
                yield from (row for row in kpi_rows(found, f"{MODEL}{seed}") if row.row == "criterion")

    def report(self) -> ModelRunsReport:
        """Give what assessment.json says of them."""
        return ModelRunsReport(
            model=self.model,
            verdict=self.verdict,
            seeds=tuple(
                JudgedSeed(seed, self.verdict_of(seed), seed in self.collided) for seed in self.seeds
            ),
            counts=self.counts(),
            collisions=len(self.collided),
            criteria={c.name: self._criterion(c.name) for c in self.criteria.criteria},
        )

    def _criterion(self, name: str) -> CriterionOverSeeds:
        counts = self.counts(name)
        verdict = next(outcome for outcome in WORST if counts[outcome])
        return CriterionOverSeeds(verdict, counts, counts["PASS"] / len(self.seeds))
