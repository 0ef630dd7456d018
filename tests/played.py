"""Drives for the player's tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from resim.core.geometry import Floats
from resim.core.tracks import Tracks
from resim.recordings import Recording
from resim.report.player import PlayedDrive, of_recording
from resim.report.player.drive import Layer, differenced
from resim.road.opendrive import RoadNetwork, load

ROOT = Path(__file__).parents[1]
CORNER = ROOT / "scenarios" / "cut_in_brake"
PILOT = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"


def drive_of(recording: Recording) -> PlayedDrive:
    return of_recording(recording, load(recording.map))


def fifty(network: RoadNetwork, samples: int, names: tuple[str, ...]) -> PlayedDrive:
    """A drive among 50 boxes at 25 Hz with noise of sensors."""
    rng, n = np.random.default_rng(1), 51
    t = 0.04 * np.arange(samples)
    v = 2.0 + 0.5 * np.sin(0.3 * t + rng.uniform(0.0, 6.0, (n, 1)))
    layers = []
    for name in names:
        noise = 0.02 if name == "GT" else 0.1

        def off(scale: float, noise: float = noise) -> Floats:
            return rng.normal(0.0, noise * scale, (n, samples))

        tracks = Tracks(
            t=t, ids=np.array(["ego", *map(str, range(50))]), kind=np.full(n, "car"), v=v + off(1.0),
            x=rng.uniform(100.0, 400.0, (n, 1)) + np.cumsum(0.04 * v, axis=1) + off(1.0),
            y=rng.uniform(-8.0, 8.0, (n, 1)) + off(1.0), heading=off(0.05), length=np.full(n, 4.7),
            width=np.full(n, 1.9), valid=np.ones((n, samples), dtype=bool),
        )  # fmt: skip
        layers.append(Layer(name, name, tracks, acceleration=differenced(tracks, "ego")))
    return PlayedDrive("fifty", "ego", network, tuple(layers))
