"""Detection and field of view against their rates, bins and limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from perception.worlds import MODELS, Motion, look, model, ring, standing, steps

from resim.perception.model import read_model
from resim.perception.runtime.chain import detected_share, probabilities, rates
from resim.perception.runtime.sensor import Sensor


def detected(sensor: Sensor, n: int, times: list[float], motion: Motion | None = None) -> np.ndarray:
    seen = look(sensor, motion or ring(n), times, standing)
    return np.array([np.isin([f"{k}" for k in range(n)], p.ids) for p in seen])


def lengths(table: np.ndarray, value: bool) -> np.ndarray:
    """Lengths of the complete runs of a value."""
    out: list[int] = []
    for row in table.T:
        ends = np.flatnonzero(np.diff(row.astype(int)))
        runs = np.diff(ends)
        out.extend(runs[row[ends[:-1] + 1] == value].tolist())
    return np.array(out)


@pytest.mark.parametrize("dt", [0.04, 0.2])
def test_share_and_run_lengths_of_detection(dt: float) -> None:
    parts = {"range_edges": (0, 100), "bearing_edges": (0, 4), "occlusion_edges": (0, 1)}
    chain = {**parts, "loss": (((0.5,),),), "gain": (((4.0,),),)}
    table = detected(Sensor(model(detection=chain)), 50, steps(4000 * dt, dt))
    lost, gained = probabilities(0.5, 4.0, dt)
    assert table.mean() == pytest.approx(4.0 / 4.5, abs=0.01)
    assert table[0].mean() == pytest.approx(4.0 / 4.5, abs=0.12)
    assert lengths(table, False).mean() == pytest.approx(1 / gained, rel=0.05)
    assert lengths(table, True).mean() == pytest.approx(1 / lost, rel=0.05)


def test_chains_and_rates_are_inverse_and_hold_for_any_step() -> None:
    loss, gain = np.array([0.5, 0.0, 3.0]), np.array([4.0, 2.0, 0.0])
    assert rates(*probabilities(loss, gain, 0.2), 0.2) == (pytest.approx(loss), pytest.approx(gain))
    assert detected_share(loss, gain).tolist() == [4.0 / 4.5, 1.0, 0.0]
    assert detected_share(0.0, 0.0) == 1.0
    lost, gained = probabilities(loss, gain, 0.1)
    twice = lost * (1 - gained) + (1 - lost) * lost
    assert twice == pytest.approx(probabilities(loss, gain, 0.2)[0])


def test_bins_of_range_and_bearing_reach_beyond_their_edges() -> None:
    never, always = 1e3, 0.0
    chain = {
        "range_edges": (10, 20, 30), "bearing_edges": (0, 1, 2), "occlusion_edges": (0, 1),
        "loss": (((always,), (always,)), ((never,), (always,))), "gain": (((1.0,),) * 2, ((0.0,), (1.0,))),
    }  # fmt: skip
    place = np.array([5.0, 15.0, 25.0, 90.0, -25.0, 25.0j])
    table = detected(Sensor(model(detection=chain)), 6, steps(2.0), lambda t: (place, 0.0, 0.0))
    assert table[10:].all(axis=0).tolist() == [True, True, False, False, True, True]
    assert table[10:].any(axis=0).tolist() == [True, True, False, False, True, True]


def test_who_is_hidden_is_lost() -> None:
    chain = {
        "range_edges": (0, 1), "bearing_edges": (0, 1), "occlusion_edges": (0, 0.5, 1),
        "loss": (((0.0, 100.0),),), "gain": (((5.0, 0.0),),),
    }  # fmt: skip

    def motion(t: float) -> tuple[Any, Any, Any]:
        return np.array([20.0, 50.0 + 1j * 10.0 * max(t - 3.0, 0.0)]), 0.0, 0.0

    table = detected(Sensor(model(detection=chain)), 2, steps(6.0), motion)
    assert table[:, 0].all()
    assert not table[20:75, 1].any()
    assert table[-10:, 1].all()


def test_field_of_view() -> None:
    sensor = Sensor(read_model(MODELS / "field_of_view.json"))
    place = np.array([119.0, 121.0, -10.0, 10 * np.exp(1j * 1.04), 10 * np.exp(-1j * 1.05)])
    assert look(sensor, lambda t: (place, 0.0, 0.0), [0.0], standing)[0].ids.tolist() == ["0", "3"]


def test_who_appears_or_comes_into_the_field_of_view_is_found_as_first_says() -> None:
    """Nobody is detected at first, and half of them within a second; those who left the view begin anew."""
    chain = {
        "range_edges": (0, 100), "bearing_edges": (0, 4), "occlusion_edges": (0, 1),
        "loss": (((0.0,),),), "gain": (((np.log(2.0),),),), "first": (((0.0,),),),
    }  # fmt: skip
    sensor = Sensor(model(detection=chain, field_of_view={"range": 200.0}))
    away = np.where(np.arange(400) < 200, 30.0, 300.0)

    def motion(t: float) -> tuple[Any, Any, Any]:
        place = ring(400)(t)[0]
        return (place if not 5.0 <= t < 6.0 else place / np.abs(place) * away), 0.0, 0.0

    table = detected(sensor, 400, steps(8.0, 0.1), motion)
    assert not table[0].any()
    assert table[10].mean() == pytest.approx(0.5, abs=0.08)
    assert table[60, :200].mean() > 0.95
    assert not table[50:61, 200:].any()
    assert table[70, 200:].mean() == pytest.approx(0.5, abs=0.11)
