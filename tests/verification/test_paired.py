"""Two builds in the same runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import bootstrap

from resim.resimulation.drive_outcome import COMFORT, BadEnd, DriveOutcome, Kpi
from resim.verification.entries import BuildVerdict, ComparedRecording, ReactionsOfBuilds
from resim.verification.limits import RegressionLimits
from resim.verification.paired import RunPair, difference, pair
from resim.verification.report import ComparisonSummary, LimitCheck
from resim.verification.summary import summary


def drive(outcome: str, *, risk: float = 0.01, braking: float = 2.0, **other: object) -> DriveOutcome:
    kpis = {"gap": Kpi(outcome, 1.0, "s", 4.0, "1", 3.0, "")}  # type: ignore[arg-type]
    comfort = dict.fromkeys(COMFORT, braking)
    return replace(DriveOutcome(kpis, ((3.0, "brake"),), 3.0, risk, comfort, False), **other)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("old", "new", "gained", "lost"),
    [("PASS", "FAIL", (), ("gap",)), ("FAIL", "PASS", ("gap",), ()), ("PASS", "PASS", (), ()),
     ("PASS", "INVALID", (), ("gap",)), ("FAIL", "INVALID", (), ()), ("INVALID", "FAIL", (), ("gap",)),
     ("INVALID", "PASS", ("gap",), ()), ("INVALID", "INVALID", (), ())],
)  # fmt: skip
def test_kpis_gained_and_lost(old: str, new: str, gained: tuple[str, ...], lost: tuple[str, ...]) -> None:
    found = pair(0, drive(old), drive(new, risk=0.03, braking=3.0), 2.5)
    assert (found.gained, found.lost, found.weight_lost) == (gained, lost, 3.0 if lost else 0.0)
    assert found.risk == pytest.approx(0.02)
    assert found.comfort["longitudinal acceleration"] == pytest.approx(1.0)
    assert found.open == (("gap",) if "INVALID" in (old, new) and not gained and not lost else ())


def test_what_weighs_nothing_is_a_number_as_what_weighs() -> None:
    """A table would tell 0 otherwise than 0.0, by which builds it has."""
    assert isinstance(pair(0, drive("PASS"), drive("PASS"), None).weight_lost, float)


def test_a_run_that_is_cut_short_loses_and_gains_nothing() -> None:
    short = drive("PASS", end="collision", collision=True)
    found = pair(0, drive("FAIL", end="duration"), short, 2.5)
    assert (found.gained, found.lost, found.weight_lost) == ((), ("lasts to the end",), 3.0)
    assert "it ends by collision now" in found.differences
    assert pair(0, short, short, None).lost == ()


OFF, HIT = "off_road", "collision"


@pytest.mark.parametrize(
    ("old", "new", "lost", "told"),
    [
        (BadEnd(OFF, 9.0), BadEnd(OFF, 2.0), ("ends no sooner",), "off road at 9.0 s before, off road at 2.0 s now"),
        (BadEnd(OFF, 9.0), BadEnd(OFF, 8.9), (), ""),
        (BadEnd(OFF, 9.0), BadEnd(OFF, 11.0), (), "off road at 9.0 s before, off road at 11.0 s now"),
        (BadEnd(OFF, 9.0), BadEnd(HIT, 9.0, 3.0), ("does not collide",), "collision at 9.0 s, 3.0 m/s now"),
        (BadEnd(HIT, 9.0, 3.0), BadEnd(OFF, 9.0), (), "off road at 9.0 s now"),
        (BadEnd(HIT, 9.0, 3.0), BadEnd(HIT, 9.1, 6.0), ("collides no harder",), "9.1 s, 6.0 m/s now"),
        (BadEnd(HIT, 9.0, 3.0), BadEnd(HIT, 4.0, 6.0), ("ends no sooner", "collides no harder"), "4.0 s, 6.0 m/s now"),
        (BadEnd(HIT, 9.0, 3.0), BadEnd(HIT, 9.1, 3.4), (), ""),
    ],
)  # fmt: skip
def test_a_worse_end_is_a_loss_where_the_old_one_was_bad_too(
    old: BadEnd, new: BadEnd, lost: tuple[str, ...], told: str
) -> None:
    before, now = (drive("PASS", end=end.by, collision=end.by == HIT, bad=end) for end in (old, new))
    found = pair(0, drive("FAIL", end=old.by, bad=old) if lost else before, now, None)
    assert (found.lost, found.weight_lost) == (lost, 3.0 * len(lost))
    assert found.gained == ()
    assert told in "; ".join(found.differences)
    assert bool(found.differences) == bool(told)
    assert found.t == (new.t if lost else None)


def test_a_collision_that_does_not_end_the_run_is_a_loss() -> None:
    now = drive("PASS", end="duration", collision=True, bad=BadEnd(HIT, 4.0, 3.0))
    assert pair(0, drive("PASS", end="duration"), now, None).lost == ("does not collide",)


def test_a_loss_is_told_from_where_the_drives_part() -> None:
    assert pair(0, drive("PASS"), drive("FAIL"), 2.5).t == 2.5
    assert pair(0, drive("PASS"), drive("PASS"), 2.5).t is None


def test_differences_have_intervals_over_recordings_not_over_seeds() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(0.5, 1.0, 30)
    found = difference([[v - 0.1, v + 0.1, None] for v in values])
    assert found is not None
    assert found.of == 30
    assert found.mean == pytest.approx(values.mean())
    known = bootstrap((values,), np.mean, method="percentile", rng=rng).confidence_interval
    assert found.low is not None
    assert found.high is not None
    assert found.low < known.low < known.high < found.high
    assert found.high - found.low < 2.0 * (known.high - known.low)
    single = difference([[0.3, 0.5]])
    assert single is not None
    assert (single.mean, single.low) == (pytest.approx(0.4), None)
    assert difference([[None]]) is None


def lognormal(n: int, rng: np.random.Generator) -> np.ndarray:
    return rng.lognormal(0.0, 1.0, n) - np.exp(0.5)


def rare(n: int, rng: np.random.Generator) -> np.ndarray:
    """+1 in 10 % of recordings, nothing in the others."""
    return (rng.random(n) < 0.1) - 0.1


@pytest.mark.parametrize("n", [2, 3, 5, 8, 12, 20, 40])
@pytest.mark.parametrize(
    "drawn", [lambda n, rng: rng.normal(0.0, 1.0, n), lognormal, lambda n, rng: -lognormal(n, rng), rare]
)
def test_intervals_of_means_hold_what_they_promise(n: int, drawn) -> None:  # type: ignore[no-untyped-def]
    """95 % less 2 points where an interval is told; the truth is 0."""
    rng = np.random.default_rng(n)
    every = [difference([[x] for x in drawn(n, rng)]) for _ in range(800)]
    told = [d for d in every if d is not None and d.low is not None and d.high is not None]
    assert bool(told) <= (n >= 5)
    if len(told) > 50:
        assert np.mean([d.low <= 0.0 <= d.high for d in told]) >= 0.93  # type: ignore[operator]


def test_equal_values_claim_no_equality_beyond_the_data() -> None:
    for values in ([0.0] * 40, [0.0] * 38 + [1.0] * 2):
        found = difference([[x] for x in values])
        assert found is not None
        assert (found.low, found.high) == (None, None)


def entry(name: str, *pairs: RunPair) -> ComparedRecording:
    verdict: BuildVerdict = "worse" if any(p.lost for p in pairs) else "same"
    return ComparedRecording(
        name, name, None, verdict, None, (), None, (), 0.0, ReactionsOfBuilds((), ()), {}, pairs, ()
    )


def test_limits_decide_and_the_worst_come_first() -> None:
    bad = entry("bad", pair(None, drive("PASS"), drive("FAIL", risk=0.03), 2.0))
    worse = entry("worse", pair(None, drive("PASS"), drive("FAIL", risk=0.5), 2.0))
    fine = entry("fine", pair(None, drive("PASS"), drive("PASS"), None))
    told = summary([bad, fine, worse], RegressionLimits())
    assert isinstance(told, ComparisonSummary)
    assert told.worst == ("worse", "bad")
    assert told.limits["lost"] == LimitCheck(2, 0, kept=False)
    assert not told.good
    assert summary([bad, fine], RegressionLimits(lost=1)).good
    assert not summary([worse], RegressionLimits(lost=1, risk=0.1)).good
    assert summary([fine], RegressionLimits()).good
