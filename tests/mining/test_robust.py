"""Whatever tracks and maps there are: nothing fails, and what is found does not depend on the clock or the order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mining.planted import (
    Drive,
    lane,
    path_of,
    random_traffic,
    smooth,
    steady,
    tracks_of,
    write_motorway,
    write_straight,
)

from resim.core.tracks import Tracks
from resim.mining.extraction import extract
from resim.mining.features import FEATURES, features
from resim.mining.find import find_maneuvers
from resim.mining.settings import DEFAULT_SETTINGS
from resim.road.opendrive import RoadNetwork, load

MANY = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
SECTION = (
    '<laneSection s="{s}"><center><lane id="0" type="none"/></center><right>{right}</right></laneSection>'
)


def everything(tracks: Tracks, network: RoadNetwork) -> list[tuple[object, ...]]:
    found = features(tracks, network)
    maneuvers = find_maneuvers(found)
    ids, step = tracks.ids.tolist(), found.samples.step
    made = extract(found, maneuvers, DEFAULT_SETTINGS.extraction)
    labels = [(ids[m.object], m.label, int(step[m.start]), int(step[m.end]), int(step[m.at]),
               ids[m.partner] if m.partner >= 0 else "") for m in maneuvers]  # fmt: skip
    windows = [(ids[e.ego], e.start, e.end, tuple(sorted(ids[m] for m in e.members))) for e in made]
    return sorted([*labels, *windows], key=str)


@pytest.mark.parametrize("cuts", [[], [100.0], [1.0, 1.001, 250.5], [40.0 * k for k in range(1, 19)]])
@pytest.mark.parametrize("links", [True, False])
def test_lane_sections_at_any_place_change_nothing(tmp_path: Path, cuts: list[float], links: bool) -> None:
    whole = load(write_straight(tmp_path / "whole.xodr"))
    right = "".join(lane(-n, links="ps" if links else "") for n in (1, 2, 3))
    sections = "".join(SECTION.format(s=s, right=right) for s in [0.0, *cuts])
    file = tmp_path / "cut.xodr"
    file.write_text(
        '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="cut"/><road id="1" length="800" '
        'junction="-1"><planView><geometry s="0" x="0" y="0" hdg="0" length="800"><line/></geometry></planView>'
        f"<lanes>{sections}</lanes></road></OpenDRIVE>"
    )
    tracks = random_traffic(np.random.default_rng(3), 16, 12.0, 10.0)
    assert everything(tracks, load(file)) == everything(tracks, whole)


@MANY
@given(seed=st.integers(0, 10_000), clock=st.floats(-1e9, 1e9))
def test_the_clock_and_the_order_of_objects_change_nothing(tmp_path: Path, seed: int, clock: float) -> None:
    network = load(write_straight(tmp_path / "straight.xodr"))
    rng = np.random.default_rng(seed)
    tracks = random_traffic(rng, 10, 10.0, 10.0)
    shifted = tracks.shifted(float(np.round(clock)))
    order = rng.permutation(len(tracks))
    assert everything(shifted.select(tracks.ids[order]), network) == everything(tracks, network)


@MANY
@given(seed=st.integers(0, 10_000), rate=st.sampled_from([1.0, 5.0, 12.5, 50.0]))
@example(seed=329, rate=1.0)  # jumps: the lane changes to one side, the border is crossed to the other
def test_objects_that_stand_reverse_leave_the_road_and_vanish_are_no_error(
    tmp_path: Path, seed: int, rate: float
) -> None:
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    rng = np.random.default_rng(seed)
    n, t = 8, np.arange(60) / rate
    kinds = rng.choice(["car", "truck", "pedestrian", "bicycle", "unknown"], n)
    x = rng.uniform(-50.0, 900.0, (n, 1)) + np.cumsum(rng.normal(5.0, 10.0, (n, 60)) / rate, axis=1)
    y = rng.uniform(-20.0, 300.0, (n, 1)) + np.cumsum(rng.normal(1.0, 10.0, (n, 60)) / rate, axis=1)
    valid = rng.random((n, 60)) < rng.choice([0.0, 0.05, 0.7, 1.0], (n, 1))
    hidden = [
        np.where(valid, a, np.nan)
        for a in (x, y, rng.uniform(-9.0, 9.0, (n, 60)), rng.normal(0.0, 20.0, (n, 60)))
    ]
    tracks = Tracks(
        t=t, ids=np.array([f"o{k}" for k in range(n)]), kind=kinds.astype(str), x=hidden[0], y=hidden[1],
        heading=hidden[2], v=hidden[3], length=rng.uniform(0.3, 20.0, n), width=rng.uniform(0.3, 3.0, n), valid=valid,
    )  # fmt: skip
    found = features(tracks, network)
    for one in find_maneuvers(found):
        low, high = found.samples.first[one.object], found.samples.first[one.object + 1]
        assert low <= one.start <= one.at <= one.end < high
        assert all(np.isfinite(value) for value in one.figures.values()), one
    for name in FEATURES:
        assert found.grid(name).shape == (n, 60)


@pytest.mark.parametrize("hole", [0.2, 0.4, 0.9])
def test_over_short_gaps_a_change_is_found_over_long_ones_it_is_not_judged(
    tmp_path: Path, hole: float
) -> None:
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -2, 520.0, 360.0)
    tracks = tracks_of(path, [Drive("a", steady(15.0), lambda t: smooth(t, 3.0, 5.0, 3.5), end=14.0)])
    gone = np.abs(tracks.t - 5.5) < 0.5 * hole
    valid = tracks.valid & ~gone
    parts = {c: np.where(valid, getattr(tracks, c), np.nan) for c in ("x", "y", "heading", "v")}
    found = features(replace(tracks, valid=valid, **parts), network)
    labels = [m.label for m in find_maneuvers(found) if m.label.startswith("lane_change")]
    assert labels == (["lane_change_left"] if hole < 0.5 else [])


def test_nothing_on_the_map_and_nothing_at_all(tmp_path: Path) -> None:
    network = load(write_straight(tmp_path / "straight.xodr"))
    tracks = random_traffic(np.random.default_rng(0), 3, 5.0, 10.0)
    far = replace(tracks, y=tracks.y + 500.0)
    assert (features(far, network).row == -1).all()
    assert [m for m in everything(far, network) if "lane" in str(m[1])] == []
    assert everything(tracks.select([]), network) == []
    alone = tracks.select(tracks.ids[:1])
    assert all(row[5] == "" for row in everything(alone, network))
