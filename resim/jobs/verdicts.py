"""What an assessment comes to."""

from __future__ import annotations

import pandas as pd

from resim.resimulation import ResimulationAssessment
from resim.resimulation.result import source_words


def reason_not_passed(found: ResimulationAssessment) -> str:
    """Say why a verdict is bad.

    Args:
        found: An assessment.

    Returns:
        Which run failed, or which criterion is not met or cannot be judged; "" where there is nothing.
    """
    if found.failures:
        return "; ".join(f"{source_words(name)}: {why}" for name, why in found.failures.items())
    failed = found.bad()
    if not failed or found.criteria is None:
        return ""
    told = ", ".join(f"{name} {verdict}" for name, verdict in failed.items())
    return f"{found.name}: does not pass the criteria {found.criteria.name!r}: {told}"


def verdict_frame(found: ResimulationAssessment) -> pd.DataFrame:
    """Give the verdicts as a table.

    Args:
        found: An assessment.

    Returns:
        Criteria (rows) against sources (columns): PASS, FAIL or INVALID; empty without criteria.
    """
    if found.criteria is None:
        return pd.DataFrame()
    columns = {name: {c: v.outcome for c, v in a.verdicts.items()} for name, a in found.blocks.items()}
    return pd.DataFrame(columns, index=[c.name for c in found.criteria.criteria]).rename_axis("criterion")
