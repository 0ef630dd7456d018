"""Slots over time equal what one reads off a plain loop over a straight road, also between samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mining.planted import random_traffic, write_straight

from resim.core.tracks import Tracks
from resim.mining.extraction import extract
from resim.mining.features import features
from resim.mining.find import find_maneuvers
from resim.mining.settings import DEFAULT_SETTINGS
from resim.mining.slots import RATE, SLOT_COLUMNS, SlotTrace, slot_frame, slot_traces
from resim.road.opendrive import load

WIDTH = 3.5


def at(tracks: Tracks, row: int, t: float) -> tuple[float, int, float] | None:
    """x linear, lane the last known, v linear, of an object at a time; None where it is not there."""
    known = np.flatnonzero(tracks.valid[row])
    last = known[tracks.t[known] <= t + 1e-6]
    if not len(last):
        return None
    k = int(last[-1])
    lane = int(np.floor(-tracks.y[row, k] / WIDTH)) + 1
    if abs(tracks.t[k] - t) <= 1e-6:
        return float(tracks.x[row, k]), lane, float(tracks.v[row, k])
    after = known[known > k]
    if not len(after):
        return None
    share = (t - tracks.t[k]) / (tracks.t[after[0]] - tracks.t[k])
    x, v = (
        float(values[row, k] + share * (values[row, after[0]] - values[row, k]))
        for values in (tracks.x, tracks.v)
    )
    return x, lane, v


def slots(tracks: Tracks, ego: int, t: float) -> tuple[list[float], list[float]]:
    """Metres ahead and speeds above the EGO's of who holds its eight slots, NaN for nobody."""
    offset, speed = [np.nan] * 8, [np.nan] * 8
    own = at(tracks, ego, t)
    assert own is not None
    for other in range(len(tracks)):
        found = at(tracks, other, t)
        if other == ego or found is None:
            continue
        far, side = found[0] - own[0], found[1] - own[1]
        if not -50.0 <= far <= 100.0 or abs(side) > 1 or (side == 0 and abs(far) <= 5.0):
            continue
        place = 1 if abs(far) <= 5.0 else 0 if far < 0.0 else 2
        slot = {-1: 0, 0: 3, 1: 5}[side] + (place if side else (0 if far < 0.0 else 1))
        if np.isnan(offset[slot]) or abs(far) < abs(offset[slot]):
            offset[slot], speed[slot] = far, found[2] - own[2]
    return offset, speed


@pytest.mark.parametrize("rate", [10.0, 12.5, 25.0])
def test_slots_are_those_of_the_plain_loop(tmp_path: Path, rate: float) -> None:
    network = load(write_straight(tmp_path / "straight.xodr"))
    tracks = random_traffic(np.random.default_rng(4), 24, 16.0, rate)
    found = features(tracks, network)
    scenarios = extract(found, find_maneuvers(found), DEFAULT_SETTINGS.extraction)
    traces = slot_traces(found, scenarios)
    assert len(scenarios) > 5
    checked = 0
    for one, trace in zip(scenarios, traces, strict=True):
        start, end = tracks.t[one.ego_start], tracks.t[one.ego_end]
        assert len(trace.lane) == int((end - start) * RATE + 1e-6) + 1
        for k in range(len(trace.lane)):
            offset, speed = slots(tracks, one.ego, float(start + k / RATE))
            np.testing.assert_allclose(trace.offset[k], offset, atol=2e-5)
            np.testing.assert_allclose(trace.speed[k], speed, atol=1e-4)
            checked += int(np.isfinite(offset).sum())
        lanes = [at(tracks, one.ego, float(start + k / RATE))[1] for k in range(len(trace.lane))]  # type: ignore[index]
        assert trace.lane.tolist() == [3 - lane for lane in lanes]
    assert checked > 500


def test_the_table_of_nothing_has_its_columns() -> None:
    frame = slot_frame([], [])
    assert tuple(frame.columns) == SLOT_COLUMNS
    assert not len(frame)
    one = SlotTrace(np.full((2, 8), np.nan), np.full((2, 8), np.nan), np.array([0, 1], np.int32), np.zeros(2))
    assert slot_frame(["a"], [one])["t"].tolist() == [0.0, 0.2]
