"""Who hardly moves is where it was: positions of the file's polynomials, integrated here, beside the truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson

from resim.core.tracks import Tracks
from resim.recordings import Recording, read_commonroad
from resim.resimulation.notes import misfits
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.jscen import write_jscen
from resim.scenario.scenario import describe

NGSIM = Path(__file__).parents[2].parent / "shared" / "data" / "ngsim"
RATE = 25.0
LANES = {-1: -1.75, -2: -5.25, -3: -8.75}  # y of their centres; road 1 runs along y = 0 for 1,200 m

SPEEDS = {
    "standing": lambda t: 0.0 * t,
    "creeping": lambda t: np.abs(0.2 * np.sin(0.5 * t)),
    "stop and go": lambda t: np.clip(3.0 * np.sin(0.7 * t), 0.0, None),
    "reversing": lambda t: -1.5 * np.clip(np.sin(0.5 * t), 0.0, None),
    "there and back": lambda t: 2.0 * np.sin(0.7 * t),
    "moving off": lambda t: np.clip(1.2 * (t - 8.0), 0.0, None),
    "stopping": lambda t: np.clip(8.0 - 1.6 * t, 0.0, None),
}


def measured(kind: str, heading: str, noise: float, v_noise: float, seed: int) -> tuple[Tracks, np.ndarray]:
    """An EGO for 16 s, as a sensor that has no heading of who stands sees it; and its true positions (T,)."""
    rng, fine = np.random.default_rng(seed), np.arange(16.0 * 1000.0 + 1.0) / 1000.0
    v, h = SPEEDS[kind](fine), 0.3
    p = 600.0 - 5.25j + np.exp(1j * h) * cumulative_simpson(v, x=fine, initial=0.0)
    t, own = fine[::40], slice(None, None, 40)
    seen = p[own] + noise * (rng.normal(size=len(t)) + 1j * rng.normal(size=len(t)))
    headings = {
        "course of noise": np.angle(np.gradient(seen)),
        "anything": rng.uniform(-np.pi, np.pi, len(t)),
        "0": np.zeros(len(t)),
        "turned at times": h + np.pi * (rng.random(len(t)) < 0.3),
        "noisy": h + 0.2 * rng.normal(size=len(t)),
    }
    tracks = Tracks(
        t=t, ids=np.array(["ego"]), kind=np.array(["car"]), x=seen.real[None], y=seen.imag[None],
        heading=headings[heading][None], v=(np.abs(v[own]) + v_noise * rng.normal(size=len(t)))[None],
        length=np.array([4.5]), width=np.array([1.8]), valid=np.ones((1, len(t)), dtype=bool),
    )  # fmt: skip
    return tracks, p[own]


def driven(path: Path, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T,) and speeds (T,) of the EGO of a file, its polynomials integrated in steps of 2 ms."""
    maneuver = json.loads(path.read_text())["objectPool"]["ego"]["maneuver"]
    fine = np.arange(t[0], t[-1] + 1e-3, 0.002)

    def values(name: str) -> np.ndarray:
        out = np.zeros_like(fine)
        for part in maneuver[name]:
            here = fine >= part["startTime"] - 1e-9
            out[here] = np.polyval(part["polynomParameter"], fine[here] - part["startTime"])
        return out

    v, heading = values("velocity"), values("heading")
    place = maneuver["startPosition"]
    start = place["sOffset"] + 1j * (LANES[place["referenceObj"]["odrLane"]] + place["tOffset"])
    way = [cumulative_simpson(f, x=fine, initial=0.0) for f in (v * np.cos(heading), v * np.sin(heading))]
    x, y = (np.interp(t, fine, w) for w in way)
    return start + x + 1j * y, np.interp(t, fine, v)


@settings(deadline=None, max_examples=60, derandomize=True)
@example(kind="creeping", heading="anything", noise=0.1, v_noise=0.0, seed=47)
@example(kind="creeping", heading="anything", noise=0.1, v_noise=0.5, seed=4)
@given(
    kind=st.sampled_from(sorted(SPEEDS)),
    heading=st.sampled_from(["course of noise", "anything", "0", "turned at times", "noisy"]),
    noise=st.sampled_from([0.0, 0.02, 0.1]),
    v_noise=st.sampled_from([0.0, 0.5]),
    seed=st.integers(0, 99),
)
def test_whoever_hardly_moves_is_described_where_it_is(
    network: RoadNetwork, tmp_path_factory: pytest.TempPathFactory,
    kind: str, heading: str, noise: float, v_noise: float, seed: int,
) -> None:  # fmt: skip
    tracks, truth = measured(kind, heading, noise, v_noise, seed)
    path = tmp_path_factory.mktemp("jscen") / "ego.jscen.json"
    write_jscen(describe(tracks, network, ego="ego", map_name="m.xodr"), path)
    p, v = driven(path, tracks.t)
    off = np.abs(p - truth)
    assert np.sqrt(np.mean(off**2)) < 0.05 + 1.2 * noise
    assert off.max() < 0.25 + 4.0 * noise
    if kind == "standing":
        assert np.abs(v).max() == 0.0
        assert off.max() < 0.001 + 0.3 * noise


def test_objects_that_come_and_go_while_standing_stay_where_they_are(network: RoadNetwork) -> None:
    ego, _ = measured("standing", "anything", 0.02, 0.3, 1)
    seen, _ = measured("standing", "course of noise", 0.05, 0.3, 2)
    here = (seen.t < 3.0) | ((seen.t > 3.6) & (seen.t < 9.0))
    both = Tracks(
        t=ego.t, ids=np.array(["ego", "7"]), kind=np.array(["car", "car"]), length=np.full(2, 4.5),
        width=np.full(2, 1.8), valid=np.stack([np.ones_like(here), here]),
        **{n: np.concatenate([getattr(ego, n), np.where(here, getattr(seen, n), np.nan)]) for n in
           ("x", "y", "heading", "v")},
    )  # fmt: skip
    told = describe(both, network, ego="ego", map_name="m.xodr").tracks(network, ego.t)
    row = told.index("7")
    inside = told.valid[row]
    assert ego.t[inside][[0, -1]] == pytest.approx([0.0, 8.96])
    assert np.hypot(told.x[row, inside] - 600.0, told.y[row, inside] + 5.25).max() < 0.02
    assert np.ptp(told.heading[row, inside]) == 0.0


def test_a_trace_that_is_off_is_told_by_object(network: RoadNetwork) -> None:
    tracks, _ = measured("stop and go", "noisy", 0.02, 0.1, 3)
    scenario = describe(tracks, network, ego="ego", map_name="m.xodr")
    frame = tracks.to_frame()
    assert misfits({"GT": scenario}, {"GT": frame}, network) == {}
    bent = frame.assign(y=frame["y"] + np.where(frame["t"].between(6.0, 9.0), 0.5, 0.0))
    line = misfits({"GT": scenario}, {"GT": bent}, network)["GT"]
    assert line.startswith("GT: ")
    assert "ego by 0.5" in line


@pytest.mark.skipif(not NGSIM.is_dir(), reason="needs the NGSIM scenarios beside the project")
@pytest.mark.parametrize("name", ["USA_Lanker-1_17_T-1", "USA_US101-10_1_T-1"])
def test_slow_vehicles_of_real_traffic_are_where_they_were(name: str) -> None:
    """Their headings are made worthless below 2 m/s: those of NGSIM are smooth."""
    road = NGSIM / f"{name}.xodr"
    egos = {"USA_Lanker-1_17_T-1": "1579", "USA_US101-10_1_T-1": "529"}
    recording: Recording = read_commonroad(NGSIM / f"{name}.xml", map=road, ego=egos[name])
    gt, rng = recording.gt, np.random.default_rng(1)
    slow = gt.valid & (gt.v < 2.0)
    turned = Tracks(**{**vars(gt), "heading": np.where(slow, rng.uniform(-3.1, 3.1, gt.x.shape), gt.heading)})
    first, last = gt.t[gt.valid[gt.index(recording.ego)]][[0, -1]]
    turned = turned.window(first, last)
    network = load(road)
    told = describe(turned, network, ego=recording.ego, map_name="m.xodr").tracks(network, turned.t)
    some = [
        n
        for n in range(len(turned))
        if turned.ids[n] in told.ids and (turned.v[n, turned.valid[n]] < 2.0).any()
    ]
    assert len(some) >= 3
    for n in some:
        row = told.index(str(turned.ids[n]))
        assert np.nanmax(np.hypot(told.x[row] - turned.x[n], told.y[row] - turned.y[n])) < 0.3, turned.ids[n]
