"""Judge a drive: what `resim assess` does."""

from __future__ import annotations

import contextlib
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import pandas as pd

from resim.core.errors import InputError
from resim.jobs.given import File, path_of, the_criteria
from resim.jobs.resimulate import ResimulationResult
from resim.jobs.verdicts import reason_not_passed, verdict_frame
from resim.metrics.criteria import Criteria
from resim.recordings import Recording
from resim.report import write_assessment_page
from resim.report.markup import Markup
from resim.report.notebook import notebook_html
from resim.resimulation import (
    AssessmentOptions,
    Resimulation,
    ResimulationAssessment,
    assess_folder,
    assess_recording,
    assess_resimulation,
)
from resim.results import ASSESSMENT, explain_os_errors, whole_folder, write_assessment


@dataclass(frozen=True, eq=False, repr=False)
class AssessmentResult:
    """A drive, assessed. Shows itself in a notebook.

    Attributes:
        assessment: The assessment of each of GT and SD, and of rGT and rSD where the drive was re-simulated.
        drive: The folder that was assessed; None for an object.
    """

    assessment: ResimulationAssessment
    drive: Path | None

    @cached_property
    def kpis(self) -> pd.DataFrame:
        """The worst of every measure and the KPI of every criterion: a row each, by `source`."""
        return self.assessment.kpi_frame()

    @property
    def verdicts(self) -> pd.DataFrame:
        """Criteria (rows) against sources (columns): PASS, FAIL or INVALID; empty without criteria."""
        return verdict_frame(self.assessment)

    @property
    def problem(self) -> str:
        """Why the verdict is bad; "" where it is not, or nothing was judged."""
        return reason_not_passed(self.assessment)

    def write(self, out: str | Path) -> None:
        """Write what `resim assess` writes into a folder, whole or not at all.

        Args:
            out: Folder; an earlier assessment there is replaced.

        Raises:
            InputError: The folder holds something else or cannot be written, or no folder was assessed.
        """
        with whole_folder(Path(out), ASSESSMENT, () if self.drive is None else (self.drive,)) as folder:
            self.write_files(folder, Path(out))

    def write_files(self, folder: Path, out: Path) -> None:
        """Write the files into a folder that is there.

        Args:
            folder: Where to write.
            out: Its name in messages.

        Raises:
            InputError: It cannot be written, or no folder was assessed.
        """
        if self.drive is None:
            raise InputError(out, "would not state what was assessed", "Assess a folder, not an object.")
        with explain_os_errors(out):
            write_assessment(self.assessment, folder, self.drive)
            write_assessment_page(self.assessment, folder / "assessment.html")

    def __repr__(self) -> str:
        told = self.problem or ("passes" if self.assessment.criteria is not None else "not judged")
        return f"<AssessmentResult {self.assessment.name}, {', '.join(self.assessment.blocks)}: {told}>"

    def _repr_html_(self) -> str:
        return notebook_html(
            repr(self).strip("<>"), Markup(), {"verdicts": self.verdicts, "measures and criteria": self.kpis}
        )


def assess(
    drive: str | Path | Recording | Resimulation | ResimulationResult,
    options: AssessmentOptions = AssessmentOptions(),
    *,
    criteria: File | Criteria | None = None,
    accept: Collection[str] = (),
) -> AssessmentResult:
    """Compute criticality measures and the accident risk of a drive, and judge it by criteria.

    Args:
        drive: A recording or its folder, a re-simulation, or the folder that `resim run` wrote.
        options: Risk parameters, path of the EGO, prediction, scenes a second [Hz].
        criteria: Criteria to judge by, or their file; in place of those of the options.
        accept: Codes of findings to continue despite.

    Returns:
        The assessment, with tables.

    Raises:
        InputError: The drive or the criteria cannot be used.
    """
    judged = the_criteria(criteria)
    how = options if judged is None else replace(options, criteria=judged)
    with contextlib.chdir("."):
        if isinstance(drive, ResimulationResult):
            return AssessmentResult(assess_resimulation(drive.resimulation, how, model=True), None)
        if isinstance(drive, Resimulation):
            return AssessmentResult(assess_resimulation(drive, how, model=True), None)
        if isinstance(drive, Recording):
            return AssessmentResult(assess_recording(drive, how), drive.folder)
        folder = path_of(drive)
        return AssessmentResult(assess_folder(folder, how, accept), folder)
