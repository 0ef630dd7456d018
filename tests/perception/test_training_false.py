"""False objects that do not fit the model of them are told, those that are drawn from it are not."""

from __future__ import annotations

import numpy as np

from resim.core.geometry import Floats
from resim.perception.model import FalseObjects
from resim.perception.training.false_places import FalsePlaces

MODEL = FalseObjects(rate=1.0, range=60.0, bearing=0.5, speed=10.0, speed_spread=1.0)


def drawn(rng: np.random.Generator, n: int = 60) -> Floats:
    """Tracks as the model draws them."""
    v = rng.normal(10.0, 1.0, n)
    distance, bearing, sizes = rng.uniform(0.0, 60.0, n), rng.uniform(-0.5, 0.5, n), np.ones((2, n))
    return np.stack([distance, bearing, np.zeros(n), v, *sizes, np.abs(v)], axis=1)


def told(tracks: Floats, level: float = 0.05) -> set[str]:
    return {failure.on for failure in FalsePlaces(tracks, MODEL).failures(level)}


def test_what_is_drawn_from_the_model_fits_at_the_level() -> None:
    rng = np.random.default_rng(0)
    false = [len(told(drawn(rng), 0.05 / 3.0)) for _ in range(400)]
    assert np.mean(np.array(false) > 0) <= 0.06


def test_ghosts_at_one_place_on_one_side_or_across_are_told() -> None:
    tracks = drawn(np.random.default_rng(1))
    place, side, across = tracks.copy(), tracks.copy(), tracks.copy()
    place[:, 0], side[:, 1], across[:, 2] = 59.0, np.abs(side[:, 1]), 0.5 * np.pi
    assert told(place) == {"distances"}
    assert told(side) == {"bearings"}
    assert told(across) == {"headings"}
    assert FalsePlaces(tracks[:5], MODEL).count == 0
