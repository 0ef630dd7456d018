"""Outcomes of sweeps: which column an adaptive plan looks at, and what columns hold."""

from __future__ import annotations

import pytest

from resim.sweeps.outcomes.registry import OUTCOMES, column_of, type_of
from resim.sweeps.sweep_file import Adaptive

KPI = "kpi collision"


def test_no_two_outcomes_have_one_column_or_one_name() -> None:
    assert len({o.column for o in OUTCOMES}) == len({o.name for o in OUTCOMES}) == len(OUTCOMES)


@pytest.mark.parametrize(
    ("asked", "column", "good"),
    [("verdict", "verdict", "PASS"), ("no collision", "collision", False), ("collision", KPI, "PASS")],
)
def test_an_adaptive_plan_names_an_outcome_or_a_criterion(asked: str, column: str, good: object) -> None:
    assert column_of(asked) == (column, good)
    bad = {"verdict": "FAIL", "collision": True, KPI: "FAIL"}
    plan = Adaptive(outcome=asked)
    assert plan.good({**bad, column: good, "end": "duration", "failure": None})
    assert not plan.good({**bad, "end": "duration", "failure": None})
    assert not plan.good({**bad, column: good, "end": "failed", "failure": "so"})


def test_columns_hold_what_their_outcome_says() -> None:
    told = {
        name: type_of(name)
        for name in ("end", "verdict", "collision", "risk", "reaction", KPI, "value collision")
    }
    assert list(told.values()) == ["text", "text", "flag", "number", "number", "text", "number"]
