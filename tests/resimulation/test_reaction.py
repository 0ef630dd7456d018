"""Measured and simulated first braking are told alike, and beside it stands how far that time is off."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from resim.core.geometry import Floats
from resim.core.tracks import Tracks
from resim.recordings import Recording
from resim.resimulation import ResimulationOptions, resimulate
from resim.resimulation.reaction import ego_tracks, reaction_spread
from resim.road.opendrive import RoadNetwork
from resim.scenario import maneuvers
from resim.scenario.scenario import Scenario, describe
from resim.simulation.function.interface import Build

T = np.arange(0.0, 12.0, 0.04)
SEEDS = range(8)


def true_acceleration(t: Floats, jerk: float, most: float) -> Floats:
    """Braking from 5 s on, for 3 s."""
    return np.where(t < 8.0, np.clip(-jerk * (t - 5.0), most, 0.0), 0.0)


def driven(jerk: float, most: float, noise: float = 0.0, seed: int = 0) -> Tracks:
    """An EGO at 24 m/s on the right lane; noise of positions [m]."""
    fine = np.arange(0.0, 12.0, 1e-3)
    v = 24.0 + np.concatenate([[0.0], np.cumsum(true_acceleration(fine, jerk, most)[:-1] * 1e-3)])
    x = 200.0 + np.concatenate([[0.0], np.cumsum(v[:-1] * 1e-3)])
    rng = np.random.default_rng(seed)
    x, v = np.interp(T, fine, x), np.interp(T, fine, v)
    x, y = x + noise * rng.standard_normal(len(T)), -5.25 + noise * rng.standard_normal(len(T))
    return Tracks(
        t=T, ids=np.array(["ego"]), kind=np.array(["car"]), x=x[None], y=y[None], heading=0.0 * x[None], v=v[None],
        length=np.array([4.7]), width=np.array([1.9]), valid=np.ones((1, len(T)), dtype=bool),
    )  # fmt: skip


def described(tracks: Tracks, network: RoadNetwork) -> Scenario:
    return describe(tracks, network, ego="ego", map_name="m")


def braking(tracks: Tracks, network: RoadNetwork) -> float:
    found = maneuvers.reaction_time(ego_tracks(described(tracks, network), network), ego="ego")
    assert found is not None
    return found


def test_a_drive_measured_with_noise_brakes_when_the_same_drive_simulated_does(network: RoadNetwork) -> None:
    """Splines tell braking up to 0.1 s too early or late, of both alike; a simulation's own accelerations do not."""
    alike, unlike = [], []
    for jerk, most in ((30.0, -5.0), (8.0, -3.0), (3.0, -1.5)):
        measured = np.median([braking(driven(jerk, most, 0.01, seed), network) for seed in SEEDS])
        alike.append(abs(measured - braking(driven(jerk, most), network)))
        unlike.append(abs(measured - T[np.argmax(true_acceleration(T, jerk, most) < maneuvers.REACTED)]))
    assert max(alike) < 0.03
    assert max(unlike) > 0.07


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.02, 0.05])
def test_two_of_three_readings_are_off_by_no_more_than_the_spread(network: RoadNetwork, noise: float) -> None:
    """Off the same drive without noise: noise lets braking begin earlier, as fits of noisier tracks are smoother."""
    within, told = [], []
    for jerk, most in ((8.0, -3.0), (30.0, -5.0), (3.0, -1.5)):
        clean = braking(driven(jerk, most), network)
        for seed in SEEDS:
            tracks = driven(jerk, most, noise, seed)
            spread = reaction_spread(tracks, described(tracks, network), network)
            assert spread is not None
            within.append(abs(braking(tracks, network) - clean) <= spread)
            told.append(spread)
    assert np.mean(within) >= 2.0 / 3.0
    assert np.median(told) < 10.0 * noise


def test_who_does_not_brake_has_no_spread(network: RoadNetwork) -> None:
    steady = driven(0.0, 0.0, 0.01)
    assert reaction_spread(steady, described(steady, network), network) is None


def test_a_replay_brakes_with_the_measured_drive(
    shipped: Callable[[str], Recording], build: Callable[[str], Build]
) -> None:
    result = resimulate(shipped("cut_in_brake"), build("replay"), ResimulationOptions(bases=("GT",)))
    report = result.report
    assert report.reaction_spread > 0.0
    assert abs(report.reaction_difference["rGT"]) <= min(report.reaction_spread, 0.05)
