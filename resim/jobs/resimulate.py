"""Re-simulate one recording with one build: what `resim run` does."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pandas as pd

from resim.core.plugins.frozen import files_of
from resim.jobs.given import File, refuse_without_sd, the_build, the_criteria, the_perception, the_recording
from resim.jobs.verdicts import reason_not_passed, verdict_frame
from resim.metrics.criteria import Criteria
from resim.perception.model import PerceptionModel
from resim.recordings import Recording
from resim.report import write_report
from resim.report.notebook import notebook_html
from resim.resimulation import (
    STAGES,
    AssessmentOptions,
    PerceptionSetup,
    Resimulation,
    ResimulationAssessment,
    ResimulationOptions,
    assess_resimulation,
)
from resim.resimulation import resimulate as resimulate_recording
from resim.resimulation.assessed import refuse_absent
from resim.resimulation.model_runs import MODEL
from resim.resimulation.report import RunReport
from resim.resimulation.tables import answers_frame, plans_frame, tracks_frame
from resim.resimulation.traces import speed_traces
from resim.results import explain_os_errors, whole_folder, write_assessment, write_resimulation
from resim.simulation.function.interface import Build
from resim.verification.page.speeds import measured_figure


@dataclass(frozen=True, eq=False, repr=False)
class ResimulationResult:
    """A recording, re-simulated and assessed. Shows itself in a notebook.

    Attributes:
        resimulation: What was measured, described and simulated, and the errors of every step.
        assessment: The assessment of each of GT, SD, rGT and rSD.
    """

    resimulation: Resimulation
    assessment: ResimulationAssessment

    @cached_property
    def tracks(self) -> pd.DataFrame:
        """All tracks, and what the function perceived: a row per `source`, `t` [s] and `id`; x, y [m], v [m/s]."""
        return tracks_frame(self.resimulation)

    @cached_property
    def answers(self) -> pd.DataFrame:
        """The function's answers: a row per `source` and `t` [s]; acceleration [m/s²], curvature [1/m]."""
        return answers_frame(self.resimulation)

    @cached_property
    def plans(self) -> pd.DataFrame:
        """The EGO's plans: a row per `source`, `t` and `t_plan` [s]; x, y [m], v [m/s]."""
        return plans_frame(self.resimulation)

    @cached_property
    def errors(self) -> pd.DataFrame:
        """Errors: a row per `step`, `who` (ego, to) and `quantity` (d [m], v [m/s], heading [rad]); mean, std, ..."""
        rows = [
            {"step": step, "who": who, "quantity": quantity, **numbers}
            for step, by_who in self.report.errors.items()
            for who, quantities in by_who.items()
            for quantity, numbers in quantities.items()
            if numbers is not None
        ]
        return pd.DataFrame(rows)

    @cached_property
    def kpis(self) -> pd.DataFrame:
        """The worst of every measure and the KPI of every criterion: a row each, by `source`."""
        return self.assessment.kpi_frame()

    @property
    def verdicts(self) -> pd.DataFrame:
        """Criteria (rows) against sources (columns): PASS, FAIL or INVALID; empty without criteria."""
        return verdict_frame(self.assessment)

    @property
    def report(self) -> RunReport:
        """What report.json says."""
        return self.resimulation.report

    @property
    def problem(self) -> str:
        """Why the result is bad: the function failed, or criteria are not met; "" where it is good."""
        judged = self.assessment.criteria is not None
        return self.resimulation.failure or reason_not_passed(self.assessment) * judged

    def write(self, out: str | Path) -> None:
        """Write what `resim run` writes into a folder, whole or not at all.

        Args:
            out: Folder; an earlier result there is replaced.

        Raises:
            InputError: The folder holds something else, or cannot be written.
        """
        recording, build = self.resimulation.recording, self.resimulation.build
        inputs = [one for one in (recording.folder, recording.map) if one is not None]
        inputs += files_of(build.frozen)
        with whole_folder(Path(out), inputs=inputs) as folder:
            self.write_files(folder, Path(out))

    def write_files(self, folder: Path, out: Path) -> None:
        """Write the files into a folder that is there.

        Args:
            folder: Where to write.
            out: Its name in messages.

        Raises:
            InputError: It cannot be written.
        """
        with explain_os_errors(out):
            write_resimulation(self.resimulation, folder)
            write_assessment(self.assessment, folder, folder)
            write_report(self.resimulation, self.assessment, folder / "report.html")

    def __repr__(self) -> str:
        drives = [f"{name} ended by {drive.end}" for name, drive in self.resimulation.simulated().items()]
        seeds = len(self.resimulation.seeds)
        drives += [f"{seeds} runs with a perception model"] if seeds else []
        told = self.problem or ("passes" if self.assessment.criteria is not None else "not judged")
        r = self.resimulation
        return f"<ResimulationResult {r.recording.name}, {r.build.label}: {', '.join(drives)}; {told}>"

    def _repr_html_(self) -> str:
        r = self.resimulation
        figure = measured_figure(
            r.recording.name, {k: (t,) for k, t in self.report.reaction.items()}, None, speed_traces(r)
        )
        tables = {"errors of every step": self.errors, "verdicts": self.verdicts}
        return notebook_html(repr(self).strip("<>"), figure, tables)


def stages(recording: Recording, options: ResimulationOptions, *, perceiving: bool) -> list[str]:
    """Give the stages that a re-simulation tells its progress, in order.

    Args:
        recording: The recording.
        options: Its options.
        perceiving: Whether there is a perception model.

    Returns:
        The names of the stages.
    """
    bases = [b for b in options.bases if b == "GT" or recording.sd is not None]
    out = [s for s in STAGES if not s.endswith(("GT", "SD")) or s == "fit GT" or s[-2:] in bases]
    return [s for s in out if s != "run GT+M" or perceiving]


def resimulate(
    recording: str | Path | Recording,
    build: File | Build,
    options: ResimulationOptions = ResimulationOptions(),
    *,
    criteria: File | Criteria | None = None,
    perception: File | PerceptionModel | PerceptionSetup | None = None,
    accept: Collection[str] = (),
    verdict_of: Collection[str] | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> ResimulationResult:
    """Re-simulate a recording with a build, measure the errors of every step, and assess GT, SD, rGT and rSD.

    It runs in this process: a function that ends or blocks the process does so with yours. `resim run` runs it in a
    child process.

    Args:
        recording: A recording, or its folder.
        build: A build of an AD function, or its file.
        options: Bases, vehicle model, step and lead-in [s], seed.
        criteria: Criteria to judge by, or their file.
        perception: A perception model to run GT with as well (20 seeds), its file, or a model with its seeds.
        accept: Codes of findings to continue despite.
        verdict_of: Sources whose verdict counts, of GT, SD, rGT, rSD, rGT+M; all that are simulated, if None.
        progress: Is told each stage as it begins (`stages`).

    Returns:
        What was simulated, with tables, errors and verdicts.

    Raises:
        InputError: A file cannot be used, or has findings that are not accepted.
        ResimError: The recording cannot be re-simulated so.
    """
    pinned, how = (
        the_build(build),
        AssessmentOptions(
            criteria=the_criteria(criteria), decides=None if verdict_of is None else tuple(verdict_of)
        ),
    )
    measured = the_recording(recording, accept)
    refuse_without_sd(measured, options.bases)
    seen = the_perception(perception, options.seed)
    if verdict_of is not None:
        bases = [b for b in options.bases if b == "GT" or measured.sd is not None]
        there = [
            *["GT", "SD"][: 1 + (measured.sd is not None)],
            *(f"r{b}" for b in bases),
            *[MODEL] * (seen is not None),
        ]
        refuse_absent(verdict_of, there)
    result = resimulate_recording(
        measured, pinned, options, perceiving=seen, accept=accept, progress=progress
    )
    with contextlib.chdir("."):
        assessed = assess_resimulation(result, how, model=True)
    return ResimulationResult(result, assessed)
