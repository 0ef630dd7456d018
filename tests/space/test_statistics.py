"""Intervals on synthetic populations whose truth is known, in 500 draws each."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, poisson

from resim.space.calibration import reliability
from resim.space.comparison import variation
from resim.space.expected import ExposedScenarios, RiskLimit, expected_accidents, risk_limits
from resim.space.risk import ClusterRisk, DrawRisk
from resim.space.statistics.rates import UNKNOWN, rate, share, spread_of
from resim.space.statistics.unseen import held_out, kinds_at_least, more_needed, unseen_share

DRAWS = 500
LEVEL = 0.93
"""95 % less 2 points."""
BELIEVED = reliability(np.repeat([0.0, 0.0005, 0.005, 0.02, 0.05, 0.2, 0.5], 4000), np.zeros(28000))
POPULATIONS = {
    "zipf": 1.0 / np.arange(1, 501), "steep": 1.0 / np.arange(1, 501) ** 2.0, "even": np.ones(500),
    "few": np.ones(20), "geometric": 0.9 ** np.arange(300),
    "common and rare": np.r_[np.full(5, 0.18), np.full(1000, 1e-4)],
}  # fmt: skip


@pytest.mark.parametrize("name", POPULATIONS)
@pytest.mark.parametrize("n", [20, 100, 500, 2000])
def test_the_unseen_share_is_held(name: str, n: int) -> None:
    p = POPULATIONS[name] / POPULATIONS[name].sum()
    rng = np.random.default_rng(1)
    held = 0
    for counts in rng.multinomial(n, p, DRAWS):
        found = unseen_share(counts[counts > 0])
        held += found.low <= float(p[counts == 0].sum()) <= found.high
        assert found.high > found.low
    assert held >= LEVEL * DRAWS


@pytest.mark.parametrize("level", [0.95, 1.0 - 0.05 / 6])
@pytest.mark.parametrize("kinds", [10, 20, 40, 80, 150])
def test_the_upper_end_of_the_unseen_share_holds_alone(kinds: int, level: float) -> None:
    """A release asks for it one-sided; equally frequent kinds are the worst, where the last few are still missing."""
    rng = np.random.default_rng(9)
    for n in (2 * kinds, 5 * kinds, 7 * kinds):
        held = 0
        for counts in rng.multinomial(n, np.full(kinds, 1.0 / kinds), 4 * DRAWS):
            held += (counts == 0).mean() <= unseen_share(counts[counts > 0], 1.0, 2.0 * level - 1.0).high
        assert held >= (level - 3.0 * np.sqrt(level * (1.0 - level) / (4 * DRAWS)) - 0.005) * 4 * DRAWS


def test_the_unseen_share_is_held_where_kinds_come_together() -> None:
    # at each occasion one kind, and with it three times in four the next two
    p = POPULATIONS["zipf"] / POPULATIONS["zipf"].sum()
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(DRAWS):
        first = rng.choice(400, 150, p=p[:400] / p[:400].sum())
        more = rng.random(150) < 0.75
        kinds = np.concatenate([first, first[more] + 1, first[more] + 2])
        occasion = np.concatenate([np.arange(150), np.flatnonzero(more), np.flatnonzero(more)])
        values, inverse, counts = np.unique(kinds, return_inverse=True, return_counts=True)
        single = counts[inverse] == 1
        spread = spread_of(np.unique(occasion[single], return_counts=True)[1])
        base = np.r_[p[:400] / p[:400].sum(), 0.0, 0.0]
        truth = (base + 0.75 * np.roll(base, 1) + 0.75 * np.roll(base, 2)) / 2.5
        missing = 1.0 - truth[values].sum()
        found = unseen_share(counts, spread)
        held += found.low <= missing <= found.high
    assert held >= LEVEL * DRAWS


def test_nothing_is_ever_told_as_an_interval_of_width_zero() -> None:
    for counts in (np.zeros(0, int), np.array([1]), np.array([50]), np.full(10, 7), np.ones(30, int)):
        found = unseen_share(counts)
        assert found.high > found.low
        assert kinds_at_least(counts).high > kinds_at_least(counts).seen
    for count in (0, 1, 40):
        found = rate(count, 10.0)
        assert found.high > found.low
    assert share(0, 5).high > 0.0
    assert share(5, 5).low < 1.0
    assert np.isnan(rate(3, np.nan).value)
    assert np.isnan(UNKNOWN.value)


def test_chao_tells_a_lower_bound() -> None:
    rng = np.random.default_rng(3)
    for name, p in POPULATIONS.items():
        draws = rng.multinomial(300, p / p.sum(), 100)
        found = np.mean([kinds_at_least(c[c > 0]).at_least for c in draws])
        assert found <= 1.1 * len(p), name
    # worked: 10 kinds seen, 4 of them once and 2 twice, of n = 20
    counts = np.array([1, 1, 1, 1, 2, 2, 3, 3, 3, 3])
    assert kinds_at_least(counts).at_least == pytest.approx(10 + 19 / 20 * 16 / 4)


@pytest.mark.parametrize("expected", [0.3, 2.0, 7.0, 30.0])
def test_rates_are_held(expected: float) -> None:
    counts = np.random.default_rng(4).poisson(expected, DRAWS)
    found = [rate(float(c), 2.0) for c in counts]
    assert sum(one.low <= expected / 2.0 <= one.high for one in found) >= LEVEL * DRAWS
    # exact: at the ends the observed number is as unlikely as the level says
    one = found[int(np.argmax(counts))]
    assert poisson.sf(counts.max() - 1, one.low * 2.0) == pytest.approx(0.025)
    assert poisson.cdf(counts.max(), one.high * 2.0) == pytest.approx(0.025)


def test_rates_are_held_where_several_egos_see_the_same() -> None:
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(DRAWS):
        sizes = rng.integers(1, 6, rng.poisson(12))
        found = rate(float(sizes.sum()), 1.0, spread_of(sizes))
        held += found.low <= 12 * 3.0 <= found.high
    assert held >= LEVEL * DRAWS


def test_shares_and_mean_risks_are_held() -> None:
    rng = np.random.default_rng(6)
    hits = rng.binomial(50, 0.03, DRAWS)
    assert sum(share(h, 50).low <= 0.03 <= share(h, 50).high for h in hits) >= LEVEL * DRAWS
    means = rng.beta(0.1, 1.9, (DRAWS, 40)).sum(axis=1)  # mean 0.05
    assert sum(share(m, 40).low <= 0.05 <= share(m, 40).high for m in means) >= LEVEL * DRAWS
    assert binom.sf(2, 50, share(3, 50).low) == pytest.approx(0.025)


def test_what_is_missing_is_what_would_be_needed() -> None:
    assert more_needed(np.zeros(0, int), 0.05) == pytest.approx(73.8, abs=0.1)
    assert more_needed(np.full(10, 50), 0.05) == 0.0
    few, many = np.full(10, 2), np.r_[np.ones(60, int), np.full(10, 5)]
    assert 0.0 < more_needed(few, 0.05) < more_needed(many, 0.05)


def test_a_held_out_half_agrees_where_nothing_changes_and_not_where_all_does() -> None:
    rng = np.random.default_rng(7)
    p = POPULATIONS["zipf"] / POPULATIONS["zipf"].sum()
    good = [held_out(rng.choice(500, 400, p=p), np.arange(400)) for _ in range(100)]
    assert sum(one is not None and one.agree for one in good) >= 95
    changed = held_out(np.r_[rng.integers(0, 5, 200), rng.integers(100, 105, 200)], np.arange(400))
    assert changed is not None
    assert not changed.agree
    assert held_out(np.array([1, 2, 3]), np.arange(3)) is None


def cluster_risk(name: str, values: np.ndarray) -> ClusterRisk:
    draws = tuple(DrawRisk(1, value, value, value, 0, 0.0, 0.0) for value in np.sort(values)[::-1].tolist())
    return ClusterRisk(
        name, 0, 0, len(values), 0, 0, 0, 0, share(float(values.sum()), float(len(values))), draws, (), {}
    )


@pytest.mark.slow
def test_expected_accidents_are_held() -> None:
    rng = np.random.default_rng(8)
    rates = np.r_[np.full(4, 20.0), np.full(6, 2.0), np.full(14, 0.05)]
    risk = np.r_[np.full(4, 1e-2), np.full(6, 0.03), np.full(14, 0.2)]
    truth, hours, held, names = float((rates * risk).sum()), 10.0, 0, [str(k) for k in range(24)]
    for _ in range(DRAWS):
        counts = rng.poisson(rates * hours)
        kind = np.repeat(np.arange(24), counts)
        exposed = ExposedScenarios(kind, np.arange(len(kind)), np.arange(len(kind)), 24)
        found = {
            names[k]: cluster_risk(names[k], (rng.random(200) < risk[k]).astype(float))
            for k in np.flatnonzero(counts).tolist()
        }
        limits = risk_limits(names, found, 0.95, 30, BELIEVED)
        terms = expected_accidents(exposed, limits, hours, 0.95)
        held += terms.low <= truth <= terms.high
        assert terms.high <= terms.known + terms.thin + terms.unseen + 1e-9
    assert held >= LEVEL * DRAWS


def test_predicted_risk_is_calibrated_or_not() -> None:
    rng = np.random.default_rng(9)
    predicted = rng.choice([0.02, 0.05, 0.2], 3000)
    hit = (rng.random(3000) < predicted).astype(float)
    assert reliability(predicted, hit).verdict == "calibrated"
    assert reliability(predicted / 4.0, hit).verdict == "too low"
    assert reliability(np.minimum(predicted * 3.0, 1.0), hit).verdict == "calibrated"  # on the safe side
    assert reliability(predicted[:5], hit[:5] * 0.0).verdict == "not shown"
    assert reliability(np.zeros(0), np.zeros(0)).verdict == "not shown"
    unknown = np.where(rng.random(3000) < 0.5, np.nan, hit)
    assert reliability(predicted, unknown).verdict == "not shown"
    assert reliability(np.zeros(1), np.full(1, np.nan)).verdict == "not shown"
    rare, often = np.full(200_000, 5e-5), np.full(40, 0.05)
    hit = np.r_[np.zeros(200_000), np.repeat([1.0, 0.0], [10, 30])]
    assert reliability(np.r_[rare, often], hit).verdict == "too low"
    assert (
        reliability(np.r_[rare, often * np.nan], hit).verdict == "not shown"
    )  # collisions nothing predicted


def test_a_kind_whose_risk_is_too_low_is_not_hidden_by_others_in_its_bin() -> None:
    predicted, others = np.repeat([0.31, 0.98], 40), [1.0] * 32 + [0.0] * 8  # together 0.645 are predicted
    hit = np.r_[np.repeat([1.0, 0.0], [24, 16]), others]  # and 0.7 collide
    assert reliability(predicted, hit).verdict == "too low"
    assert reliability(np.full(80, predicted.mean()), hit).verdict == "calibrated"
    lost = np.where((np.arange(80) >= 12) & (np.arange(80) < 24), np.nan, hit)
    assert reliability(predicted, lost).verdict == "not shown"  # of known ones it is not, but it may be
    assert reliability(predicted, np.r_[np.repeat([1.0, 0.0], [12, 28]), others]).verdict == "calibrated"


def test_a_kind_whose_risk_is_too_low_is_not_hidden_by_one_with_the_same_prediction() -> None:
    predicted, hit = np.full(60, 0.5), np.repeat([1.0, 0.0], 30)
    assert reliability(predicted, hit).verdict == "calibrated"
    assert reliability(predicted, hit, kind=["a"] * 30 + ["b"] * 30).verdict == "too low"


def test_drives_of_another_kind_whose_end_is_not_known_hide_no_risk_that_is_too_low() -> None:
    predicted = np.repeat([0.61, 0.73], 22)
    hit, kind = np.r_[np.repeat([1.0, 0.0], [14, 8]), np.repeat([1.0, 0.0], [21, 1])], ["a"] * 22 + ["b"] * 22
    assert reliability(predicted, hit, kind=kind).verdict == "too low"
    more, lost = np.r_[predicted, np.full(3, 0.6)], np.r_[hit, np.full(3, np.nan)]
    assert reliability(more, lost, kind=[*kind, "c", "d", "e"]).verdict == "too low"


@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
def test_no_limit_of_accidents_falls_as_a_risk_rises(confidence: float) -> None:
    rng = np.random.default_rng(14)
    for _ in range(300):
        drives, n = int(rng.integers(1, 40)), int(rng.integers(1, 30))
        exposed = ExposedScenarios(
            rng.integers(0, 4, n),
            np.arange(n),
            rng.integers(0, drives, n),
            4,
            rng.lognormal(0.0, 2.0, drives),
        )
        one = rng.beta(0.2, 2.0, 4)
        other = np.minimum(one + 0.3 * rng.random(4) * (np.arange(4) == rng.integers(4)), 1.0)
        before, after = (
            expected_accidents(
                exposed, [RiskLimit(0.0, 0.0, float(high), True) for high in risk], 1.0, confidence
            )
            for risk in (one, other)
        )
        assert after.high >= before.high * (1.0 - 1e-9)
        assert after.known >= before.known * (1.0 - 1e-9)


def test_how_far_two_distributions_are_apart_is_held() -> None:
    rng = np.random.default_rng(10)
    p = POPULATIONS["zipf"][:60] / POPULATIONS["zipf"][:60].sum()
    q = np.roll(p, 7)
    truth = 0.5 * np.abs(p - q).sum()
    held = same = 0
    for _ in range(200):
        counts = np.stack([rng.multinomial(400, p), rng.multinomial(300, q)])
        found = variation(counts, (1.0, 1.0))
        held += found.low <= truth <= found.high
        same += variation(np.stack([rng.multinomial(400, p), rng.multinomial(300, p)]), (1.0, 1.0)).low == 0.0
    assert held >= LEVEL * 200
    assert same >= LEVEL * 200
    assert found.low > 0.1
