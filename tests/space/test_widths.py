"""Nothing is ever told as an interval of width zero, wherever a number stands with one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pandas as pd
from hypothesis import given, settings
from hypothesis import strategies as st
from space.spaces import KINDS, source

from resim.space.build import build_space
from resim.space.calibration import EDGES, reliability
from resim.space.comparison import compare_spaces, together
from resim.space.described import report
from resim.space.draws import scenario_draws
from resim.space.limits import ReleaseLimits
from resim.space.members import MEMBER_COLUMNS
from resim.space.release import decide
from resim.space.release_report import ReleaseCheck
from resim.space.risk import CoverReport, cluster_risks
from resim.space.statistics.rates import IntervalEstimate

RISKS = st.sampled_from([0.0, 1e-5, 0.05, 1.0, np.nan])
HELD = st.lists(
    st.tuples(st.sampled_from([*EDGES, np.nan]), st.sampled_from([0.0, 1.0, np.nan])), max_size=30
)


def intervals(told: Any, where: str = "") -> Iterator[tuple[str, IntervalEstimate | ReleaseCheck]]:
    """All intervals of a report, with their places."""
    if isinstance(told, IntervalEstimate | ReleaseCheck):
        yield where, told
    elif is_dataclass(told):
        for one in fields(told):
            yield from intervals(getattr(told, one.name), f"{where}.{one.name}")
    elif isinstance(told, tuple | list):
        for one in told:
            yield from intervals(one, where)
    elif isinstance(told, dict):
        yield from intervals(tuple(told.values()), where)


@given(
    kinds=st.lists(st.integers(0, 3), min_size=1, max_size=8),
    hours=st.sampled_from([np.nan, 0.01, 1000.0]),
    together_=st.integers(1, 3),
    risks=st.lists(RISKS, max_size=6),
    held=HELD,
    counts=st.booleans(),
)
@settings(deadline=None, max_examples=20)
def test_no_interval_has_width_zero(
    kinds: list[int], hours: float, together_: int, risks: list[float], held: list[tuple[float, float]], counts: bool
) -> None:  # fmt: skip
    named = [KINDS[k] for k in kinds]
    space = build_space([source("one", named, 1, hours, "b", together_)])
    draws = dict(tuple(space.rows.assign(draw=scenario_draws(space.rows)).groupby("cluster")["draw"]))
    rows = [
        (f"{name}:{k}", "o", draws[name].iloc[k % len(draws[name])], name, "d", 0.1, risk, risk == 1.0, counts, "",
         "repeat")
        for name in sorted(draws) for k, risk in enumerate(risks)
    ]  # fmt: skip
    members = pd.DataFrame(rows, columns=list(MEMBER_COLUMNS)).astype(
        {"collided": "boolean", "risk": float, "counts": bool}
    )
    predicted, collided = np.array(held, dtype=float).reshape(-1, 2).T
    found = cluster_risks(space, members, "b")
    cover = CoverReport(
        {}, {}, "", "b", "f-1", "", 0.7, {}, {}, 1, 0, found, reliability(predicted, collided), ()
    )
    asked = ReleaseLimits.model_validate(
        {"name": "t", "least_seen": 0.9, "least_seen_source": "t", "least_drives": 3,
         "limit": [{"per": per, "accidents": 0.1, "source": "t"} for per in ("hour", "kilometre")]}
    )  # fmt: skip
    other = build_space([source("other", named[::2], 2)])
    told = (
        report(space, {}), cover, decide(space, cover, asked, {"space": "", "cover": "", "limits": ""}),
        compare_spaces(together(space, other), ("", ""), ("", "")),
    )  # fmt: skip
    seen = 0
    for one in told:
        for where, number in intervals(one):
            seen += 1
            no_limit = np.isnan(number.high)  # nobody says how many at most
            assert no_limit or number.low < number.high, where
            counted = np.isnan(number.low) and np.isnan(
                number.high
            )  # no estimate, and told without an interval
            assert counted or np.isnan(number.value) or number.low <= number.value, where
            assert no_limit or np.isnan(number.value) or number.value <= number.high, where
    assert seen > 10
