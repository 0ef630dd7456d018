"""Whether a run makes the measured decision, and what is known of it where the run broke off."""

from __future__ import annotations

import pytest

from resim.resimulation.perceived import decides_as, same_decision
from resim.sweeps.sweep_file import Adaptive

BRAKE, LEFT = "brake", "lane_change_left"


@pytest.mark.parametrize(
    ("did", "end", "expected"),
    [
        ((BRAKE, LEFT), "duration", True),
        ((BRAKE,), "duration", False),
        ((), "duration", False),
        ((BRAKE, LEFT), "collision", None),
        ((BRAKE,), "off_road", None),
        ((), "collision", None),
        ((LEFT,), "collision", False),
        ((BRAKE, LEFT, BRAKE), "off_road", False),
    ],
)
def test_a_run_that_broke_off_decides_as_measured_only_if_it_cannot_be_otherwise(
    did: tuple[str, ...], end: str, expected: bool | None
) -> None:
    assert decides_as(did, [BRAKE, LEFT], end) is expected


def test_seeds_that_broke_off_or_failed_do_not_count_as_deciding_alike() -> None:
    runs = [((BRAKE,), "duration", None), ((BRAKE,), "collision", None), ((BRAKE,), "duration", "boom")]
    assert same_decision(runs, (BRAKE,)) == 1  # type: ignore[arg-type]
    assert same_decision(runs, None) == 0  # type: ignore[arg-type]


def test_an_adaptive_plan_does_not_take_what_is_not_known_for_good() -> None:
    plan = Adaptive(outcome="same_decision")
    assert plan.good({"end": "duration", "failure": None, "same_decision": True})
    assert not plan.good({"end": "collision", "failure": None, "same_decision": None})
