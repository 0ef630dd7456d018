"""The runs with a perception model (rGT+M), judged: a source of its own, with the share of seeds that pass."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from resim.metrics.assessment import Assessment
from resim.metrics.criteria import Criteria, Outcome

MODEL = "rGT+M"
"""What the source is called."""
WORST: tuple[Outcome, ...] = ("FAIL", "INVALID", "PASS")


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

    def kpis(self) -> Iterator[dict[str, Any]]:
        """Give the rows of kpis.parquet: one for each seed and criterion, by source `rGT+M` and the seed."""
        for seed, found in self.seeds.items():
            for row in () if found is None else found.kpis():
                if row["row"] == "criterion":
                    yield {"source": f"{MODEL}{seed}", **row}

    def to_json(self) -> dict[str, Any]:
        """Give what assessment.json holds of it."""
        return {
            "model": self.model,
            "verdict": self.verdict,
            "seeds": [
                {"seed": seed, "verdict": self.verdict_of(seed), "collision": seed in self.collided}
                for seed in self.seeds
            ],
            "counts": self.counts(),
            "collisions": len(self.collided),
            "criteria": {c.name: self._criterion(c.name) for c in self.criteria.criteria},
        }

    def _criterion(self, name: str) -> dict[str, Any]:
        counts = self.counts(name)
        verdict = next(outcome for outcome in WORST if counts[outcome])
        return {"verdict": verdict, "counts": counts, "share": counts["PASS"] / len(self.seeds)}
