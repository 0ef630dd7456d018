"""Every outcome of a sweep's runs, besides those of its criteria: a line each, in the order of tables."""

# ruff: noqa: F401, I001  # the order is that of tables, and all are used

from __future__ import annotations

from resim.core.schema import TEXT_OUTCOMES
from resim.sweeps.outcomes.definition import ColumnType, OutcomeDefinition
from resim.sweeps.outcomes.verdict import VERDICT
from resim.sweeps.outcomes.decision import SAME_DECISION
from resim.sweeps.outcomes.collision import COLLISION
from resim.sweeps.outcomes.risk import RISK
from resim.sweeps.outcomes.reaction import REACTION_DIFFERENCE
from resim.sweeps.outcomes.end_position import END_POSITION_ERROR

OUTCOMES: tuple[OutcomeDefinition, ...] = tuple(
    value for value in vars().values() if isinstance(value, OutcomeDefinition)
)
"""All that are imported above."""


def type_of(column: str) -> ColumnType:
    """Give the type of a column of the table of runs."""
    if column in TEXT_OUTCOMES or column.startswith(("kpi ", "unit ")):
        return "text"
    return next((outcome.type for outcome in OUTCOMES if outcome.column == column), "number")


def column_of(asked: str) -> tuple[str, str | bool | None]:
    """Give the column that `adaptive.outcome` names, and the cell of a good run; else those of a criterion's name."""
    for outcome in OUTCOMES:
        if outcome.name == asked and outcome.good is not None:
            return outcome.column, outcome.good
    return f"kpi {asked}", "PASS"
