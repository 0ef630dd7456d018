"""The test of a share, against probabilities that are summed up over what it says of every sequence."""

from __future__ import annotations

from collections import defaultdict
from functools import cache

import numpy as np
import pytest

from resim.verification.sequential import ERROR, SequentialTest, StoppingPoint

Ends = dict[StoppingPoint, list[tuple[int, int]]]


@cache
def ends(test: SequentialTest) -> dict[tuple[int, int, str | None], int]:
    """How many sequences of seeds end with so many agreements after so many seeds, and what is told then.

    A tree of all sequences, in which those that are open with the same number of agreements are one, since the test is
    asked for one of them: exact, in whole numbers.
    """
    found: dict[tuple[int, int, str | None], int] = defaultdict(int)
    still = {0: ((), 1)}
    for n in range(1, test.most + 1):
        grown: dict[int, tuple[tuple[bool, ...], int]] = {}
        for seen, ways in still.values():
            for agrees in (False, True):
                sequence = (*seen, agrees)
                stop = test.stop(sequence)
                assert stop.of == n
                if stop.told is not None or n == test.most:
                    found[stop.agreed, n, stop.told] += ways
                else:
                    grown[stop.agreed] = (sequence, grown.get(stop.agreed, (sequence, 0))[1] + ways)
        still = grown
    return found


def odds(test: SequentialTest, share: float) -> dict[str | None, float]:
    """The probability of each verdict, and of the number of seeds its mean ("seeds")."""
    out: dict[str | None, float] = defaultdict(float)
    for (agreed, n, told), ways in ends(test).items():
        p = float(ways) * share**agreed * (1.0 - share) ** (n - agreed)
        out[told] += p
        out["seeds"] += p * n
    return out


@pytest.mark.parametrize("demand", [0.5, 0.8, 0.9, 0.95, 0.97])
def test_either_wrong_verdict_has_at_most_its_probability(demand: float) -> None:
    test = SequentialTest(demand, 200)
    for share in (demand, 0.9 * demand, 0.5 * demand):
        assert odds(test, share)["enough"] <= ERROR
    for share in (test.better, 0.5 * (1.0 + test.better)):
        assert odds(test, share)["too few"] <= ERROR
    total = odds(test, demand)
    assert total["enough"] + total["too few"] + total[None] == pytest.approx(1.0)


def test_the_errors_are_used_up_and_few_seeds_are_taken_where_it_is_clear() -> None:
    test = SequentialTest(0.9, 200)
    assert odds(test, 0.9)["enough"] > 0.045
    assert odds(test, 0.95)["too few"] > 0.045
    assert odds(test, 1.0)["seeds"] == 50
    assert odds(test, 0.99)["seeds"] < 60
    assert odds(test, 0.5)["seeds"] < 10
    assert odds(test, 0.98)["enough"] > 0.99
    assert odds(test, 0.8)["enough"] < 0.001  # 18 of 20 verified it in 21 % of cases


def test_drawn_seeds_give_the_probabilities_that_were_summed_up() -> None:
    test, rng, n = SequentialTest(0.8, 60), np.random.default_rng(5), 1500
    for share in (0.8, 0.86, 0.9):
        told = [test.stop(list(rng.random(60) < share)).told for _ in range(n)]
        for verdict in ("enough", "too few", None):
            p = odds(test, share)[verdict]
            assert told.count(verdict) / n == pytest.approx(p, abs=4.0 * (p * (1.0 - p) / n) ** 0.5)


def test_the_interval_misses_the_true_share_as_often_as_it_says_and_agrees_with_the_verdict() -> None:
    test = SequentialTest(0.8, 60)
    bounds = {key: test.interval(StoppingPoint(*key)) for key in ends(test)}
    for (_, _, told), (low, high) in bounds.items():
        assert told != "enough" or low >= 0.8
        assert told != "too few" or high <= 0.9
    for share in np.linspace(0.05, 0.98, 32):
        below = above = 0.0
        for (agreed, n, told), ways in ends(test).items():
            p = float(ways) * share**agreed * (1.0 - share) ** (n - agreed)
            low, high = bounds[agreed, n, told]
            below, above = below + p * (high < share - 1e-9), above + p * (low > share + 1e-9)
        assert max(below, above) <= ERROR + 1e-9


def test_so_many_seeds_as_are_said_to_be_needed_do() -> None:
    test = SequentialTest(0.8, 60)
    stop = test.stop([*[True] * 6, False] * 8 + [True] * 4)
    assert stop == StoppingPoint(52, 60, None)
    needed = test.needed(stop)
    assert 60 < needed < 1000
    assert odds(SequentialTest(0.8, needed), 52 / 60)[None] <= ERROR


def test_seeds_that_are_too_few_for_any_verdict_are_known() -> None:
    assert SequentialTest(0.9, 200).fewest == 29
    assert SequentialTest(0.9, 29).stop([True] * 29).told == "enough"
    assert SequentialTest(0.9, 28).stop([True] * 28).told is None
