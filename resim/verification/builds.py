"""One recording, two builds: what the new one does otherwise in the same scenario, with the same seeds."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from resim.core.plugins.unlisted_files import NOT_OF_HASH
from resim.metrics.criteria import Criteria
from resim.recordings import Recording
from resim.recordings.checked import finding_lines
from resim.resimulation.assessed import AssessmentOptions
from resim.resimulation.assessments import assess_resimulation
from resim.resimulation.compute_outcome import first_divergence, outcomes, seed_outcomes
from resim.resimulation.drive_outcome import DriveOutcome
from resim.resimulation.notes import HANDED_OVER
from resim.resimulation.perceived import PerceptionSetup
from resim.resimulation.result import Resimulation, ResimulationOptions, of_seed
from resim.resimulation.run import resimulate
from resim.simulation.case import SimulatedDrive
from resim.simulation.function.interface import Build
from resim.verification.entries import (
    BuildVerdict,
    ComparedRecording,
    ReactionsOfBuilds,
    RecordingSource,
)
from resim.verification.paired import NOT_COMPARED, RunPair, pair
from resim.verification.verify import COMPARED, has_plans


@dataclass(frozen=True, eq=False)
class BuildComparison:
    """Re-simulations of one recording with an old and a new build, and each pair of runs with the same seed.

    asked: what their code and that of measures asked that no hash knows.
    """

    old: Resimulation
    new: Resimulation
    pairs: tuple[RunPair, ...]
    asked: tuple[str, ...] = ()

    @property
    def verdict(self) -> BuildVerdict:
        """Whether the new build lost a KPI in any run, gained one, does something else, or none of it."""
        if any(p.failure for p in self.pairs):
            return "error"
        if any(p.lost for p in self.pairs):
            return "worse"
        if any(p.gained for p in self.pairs):
            return "better"
        return "changed" if any(p.changed for p in self.pairs) else "same"

    def entry(self, source: RecordingSource) -> ComparedRecording:
        """Give what verification.json says of the recording, which lies at `source`."""
        worst = max(self.pairs, key=lambda p: (bool(p.failure), p.weight_lost, p.risk or 0.0))
        of_code = (
            n for r in (self.old, self.new) for n in r.warnings if n.endswith(NOT_OF_HASH) or HANDED_OVER in n
        )
        return ComparedRecording(
            **vars(source),
            verdict=self.verdict,
            t=worst.t,
            differences=worst.differences,
            error=worst.failure or None,
            findings=finding_lines(self.old.recording.findings),
            weight_lost=worst.weight_lost,
            reaction=ReactionsOfBuilds(
                tuple(p.reactions[0] for p in self.pairs), tuple(p.reactions[1] for p in self.pairs)
            ),
            cases={
                when: {name: drive.case.hash for name, drive in result.drives.items()}
                for when, result in (("before", self.old), ("now", self.new))
            },
            pairs=self.pairs,
            notes=tuple(dict.fromkeys([*of_code, *self.asked, *self._open()])),
        )

    def _open(self) -> tuple[str, ...]:
        """Which criteria show nothing, in a note; none where all do."""
        names = sorted({name for pair in self.pairs for name in pair.open})
        return (f"{NOT_COMPARED} {', '.join(names)}",) if names else ()


def compare_builds(
    recording: Recording,
    builds: tuple[Build, Build],
    criteria: Criteria,
    options: ResimulationOptions = ResimulationOptions(),
    perceiving: PerceptionSetup | None = None,
    accept: Collection[str] = (),
) -> BuildComparison:
    """Re-simulate GT with both builds, the older one first; with a perception model once a seed, else once."""
    results = [
        resimulate(recording, build, options, perceiving=perceiving, accept=accept) for build in builds
    ]
    planned = all(has_plans(result) for result in results)
    how = AssessmentOptions(criteria=criteria, only=COMPARED, path="plan" if planned else "state")
    each = [_runs(result, how) for result in results]
    pairs, asked = [], list[str]()
    for seed, (one, drive) in each[0].items():
        two, other = each[1][seed]
        pairs.append(pair(seed, one, two, first_divergence(drive.truth, other.truth, recording.ego)))
        asked += [*one.asked, *two.asked]
    return BuildComparison(results[0], results[1], tuple(pairs), tuple(dict.fromkeys(asked)))


def _runs(
    result: Resimulation, how: AssessmentOptions
) -> dict[int | None, tuple[DriveOutcome, SimulatedDrive]]:
    """What each drive on GT came to, by seed, None for that without a perception model."""
    if result.perceiving is None:
        found = outcomes(result, assess_resimulation(result, how))
        return {None: (found["rGT"], result.drives["rGT"])}
    outcomes_of = seed_outcomes([(result, seed) for seed in result.seeds], how)
    return {
        seed: (found, result.drives[of_seed(seed)])
        for seed, found in zip(result.seeds, outcomes_of, strict=True)
    }
