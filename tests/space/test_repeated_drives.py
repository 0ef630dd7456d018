"""A drive that is there again with noise, by another clock or rate, or cut with an overlap is one draw with itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from space.spaces import source

from resim.core.geometry import Floats
from resim.jobs.space_drives import _find_repeated
from resim.space import repeated_drives
from resim.space.build import build_space, grow_space
from resim.space.draws import drive_numbers
from resim.space.limits import ReleaseLimits
from resim.space.release import release_checks
from resim.space.release_case import release_case
from resim.space.repeated_drives import merged, same_traffic
from resim.space.sources import MinedSource
from resim.space.traces import RATE, Ints, SlotTraces, joined

SCENES = 45
SLOTS_HELD = (2, 4, 7)


def traffic(name: str, seed: int, begin: float = 0.0, rate: float = RATE, noise: float = 0.0) -> SlotTraces:
    """An EGO among three vehicles that each come and go in their own way, seen from a moment on."""
    rng = np.random.default_rng(seed)
    at, v, swing, phase = (
        rng.uniform(*ends, 3) for ends in ((10.0, 60.0), (-4.0, 4.0), (0.3, 2.0), (0.0, 6.0))
    )
    fine = begin + np.arange(int(SCENES / RATE * rate)) / rate
    t = begin + np.arange(SCENES - 1) / RATE
    offset, speed = np.full((len(t), 8), np.nan), np.full((len(t), 8), np.nan)
    noisy = np.random.default_rng(seed + 1000)
    for k, slot in enumerate(SLOTS_HELD):
        true = at[k] + v[k] * fine + swing[k] * np.sin(0.8 * fine + phase[k])
        seen = np.interp(t, fine, true + noisy.normal(0.0, 2.0**0.5 * noise, len(fine)))
        offset[:, slot], speed[:, slot] = seen, np.gradient(seen, 1.0 / RATE)
    lanes = np.ones(len(t), np.intp)
    return SlotTraces(np.array([name]), np.array([0, len(t)], np.intp), offset, speed, lanes, lanes * 0.0)


def of_drive(name: str, seeds: list[int], **how: float) -> MinedSource:
    """A mined recording of such scenarios."""
    found = source(name, ["jam"] * len(seeds), 0, each=len(seeds))
    traces = joined([traffic(f"{name}_{k}", seed, **how) for k, seed in enumerate(seeds)])
    return replace(found, traces=traces, hash=name)


AGAIN = {
    "noise": {"noise": 0.02}, "much noise": {"noise": 0.08}, "clock": {"begin": 0.13},
    "rate": {"rate": 12.5, "noise": 0.02},
    "overlap": {"begin": 3.0}, "all": {"begin": 2.07, "rate": 25.0, "noise": 0.02},
}  # fmt: skip


@pytest.mark.parametrize("how", AGAIN)
def test_a_drive_that_is_there_again_is_one_draw(how: str) -> None:
    day, night = (of_drive(name, list(range(k, k + 6))) for k, name in ((0, "day"), (10, "night")))
    again = of_drive("again", list(range(6)), **AGAIN[how])
    for whole in (build_space([day, night, again]), grow_space(build_space([day, night]), [again])):
        assert drive_numbers(whole.rows).tolist() == [0] * 6 + [1] * 6 + [0] * 6


LIMITS = ReleaseLimits.model_validate(
    {"name": "t", "least_seen": 0.9, "least_seen_source": "t",
     "limit": [{"per": "hour", "accidents": 1.0, "source": "t"}]}
)  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
def test_what_is_there_again_makes_nothing_better(seed: int) -> None:
    """Not even a quiet drive that is there ten times, in whose hours next to nothing happens."""
    rng = np.random.default_rng(seed)
    seeds = [list(range(100 * k, 100 * k + int(rng.integers(1, 9)))) for k in range(5)]
    drives = [of_drive(f"d{k}", own) for k, own in enumerate(seeds)]
    twice, times = seeds[int(rng.integers(5))], int(rng.integers(1, 5))
    again = [
        of_drive(f"again{k}", twice, begin=float(rng.uniform(0.05, 2.0)), noise=0.02) for k in range(times)
    ]
    whole, alone = build_space([*drives, *again]), build_space(drives)
    assert len(set(drive_numbers(whole.rows).tolist())) == 5
    assert whole.driven == pytest.approx(alone.driven)
    found, before = (release_case(space, None, LIMITS) for space in (whole, alone))
    assert found.accidents("hour").high >= before.accidents("hour").high - 1e-9
    checks = [release_checks(case, {"hour": case.accidents("hour")})[0] for case in (found, before)]
    assert checks[0].low <= checks[1].low + 1e-9


def test_other_drives_are_other_draws() -> None:
    many = joined([traffic(str(k), k) for k in range(1500)])
    names = many.names.tolist()
    pairs = same_traffic(many, names, ["m"] * len(names))
    assert len(pairs) <= 2
    assert len(set(merged(names, pairs).tolist())) >= 1498
    copies = joined([many, *(traffic(f"again {k}", k, begin=1.0, noise=0.02) for k in range(100))])
    found = same_traffic(copies, copies.names.tolist(), ["m"] * 1600, since=1500)
    assert sum(one == two - 1500 for one, two in found.tolist()) >= 90
    assert not len(same_traffic(copies, ["a drive"] * 1600, ["m"] * 1600))
    assert not len(same_traffic(copies, copies.names.tolist(), [str(k) for k in range(1600)]))
    assert not len(same_traffic(many.take([]), [], []))


def test_few_hits_are_held_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Copies of copies are alike in each moment: all hits at once would take memory by the square of their number."""
    copies = joined([traffic(f"{k}", k % 4, begin=0.05 * (k // 4), noise=0.02) for k in range(120)])
    drive = [f"d{k // 4}" for k in range(120)]
    whole = merged(drive, same_traffic(copies, drive, ["m"] * 120)).tolist()
    monkeypatch.setattr(repeated_drives, "AT_ONCE", 1000)
    held = [len(shift) for _, shift in repeated_drives._hits(*_looked_at(copies), since=0)]
    assert max(held) < 0.1 * sum(held)
    assert merged(drive, same_traffic(copies, drive, ["m"] * 120)).tolist() == whole == ["d0"] * 120


def _looked_at(traces: SlotTraces) -> tuple[Floats, repeated_drives._Moments, Ints]:
    """Moments as points, and each scenario as a drive of its own."""
    found = repeated_drives._moments(traces, np.zeros(len(traces), dtype=np.intp))
    return np.column_stack([3.0 * found.code, found.told]), found, np.arange(len(traces))


def test_two_egos_of_one_traffic_are_one_draw() -> None:
    """Two vehicles that record the same: their kinds are one draw, and hours are those of the longest."""
    one, two, other = (of_drive(name, [k, k + 1]) for k, name in ((0, "one"), (20, "two"), (40, "other")))
    one, two, other = (
        replace(each, recordings=tuple(replace(r, traffic=told) for r in each.recordings))
        for each, told in ((one, "same a"), (two, "same b"), (other, "another a"))
    )
    assert drive_numbers(build_space([one, two, other]).rows).tolist() == [0, 0, 0, 0, 1, 1]


def test_held_out_drives_that_are_nearly_one_of_the_space_are_that_one() -> None:
    day = of_drive("day", list(range(3)))
    space = build_space([replace(day, recordings=tuple(replace(r, tracks="bytes") for r in day.recordings))])
    given = joined(
        [traffic("near", 1, noise=0.02, begin=0.4), traffic("far", 50), traffic("like near", 1, begin=0.6)]
    )
    drive = {name: name for name in given.names.tolist()}
    _find_repeated(space, given, ["m-1"] * 3, drive)
    assert drive == {"near": "bytes", "far": "far", "like near": "bytes"}
