"""Whether a run passes every criterion."""

from __future__ import annotations

from resim.metrics.criteria import overall
from resim.sweeps.outcomes.definition import FinishedRun, OutcomeDefinition


def _verdict(run: FinishedRun) -> str:
    """The verdict over all criteria; a run that ended early does not pass, and one that ended at once is not judged."""
    verdict = overall(run.found.kpis) if run.found.kpis else "INVALID"
    return "INVALID" if verdict == "PASS" and run.found.end != "duration" else verdict


VERDICT = OutcomeDefinition(
    column="verdict",
    type="text",
    label="every criterion passes",
    of=_verdict,
    good="PASS",
    keeps="every criterion passes",
    final=True,
)
