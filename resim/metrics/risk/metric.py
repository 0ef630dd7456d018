"""Accident risk of scenes: scenes in, arrays out (Wagner 2021, chapter 4)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.metrics.risk.lane_paths import LanePaths
from resim.metrics.risk.sobol import sobol_points

Mode = Literal["published", "continuous"]


@dataclass(frozen=True)
class RiskParameters:
    """Table 4.1, and how hard the EGO evades.

    horizon, step, no_return (T_PNR), most (T_max): s. samples per object; the default is the mode's own, 100
    random ones as published, 64 of a Sobol sequence in the continuous mode. lateral, braking, forward: m/s²;
    curvature: 1/m, of the tightest turn.
    """

    mode: Mode = "continuous"
    horizon: float = 4.0
    step: float = 0.1
    samples: int | None = None
    no_return: float = 0.5
    most: float = 3.5
    slope: float = 2.0
    lateral: float = 7.0
    braking: float = 8.5
    forward: float = 3.0
    curvature: float = 0.2
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.no_return < self.most:
            raise ResimError(
                f"no_return {self.no_return:g} s: expected less than most, {self.most:g} s (Eq. 4.6)"
            )
        if self.slope < 0.0:
            raise ResimError(f"slope {self.slope:g}: expected 0 or more (Eq. 4.6)")


DEFAULTS = RiskParameters()


@dataclass(frozen=True, eq=False)
class Scenes:
    """S scenes of the EGO and up to K traffic objects.

    plan: (S, M + 1, 4) the EGO's x, y [m], heading [rad], v [m/s] at 0, step, ..., horizon. ego_size: (S, 2)
    length, width [m]. state: (S, K, 6) x, y, heading, v, a [m/s²], yaw rate [rad/s]; size: (S, K, 2), 0 where
    there is no such object. inputs: (S, K, 4) mu_a, sigma_a, mu_w, sigma_w of Eq. 4.2.
    motion: (S, K) `prediction.CTRA` (Eq. 4.1; everybody where it is None) or WALKING. Who walks is not bound to a
    heading: inputs are mu, sigma of the acceleration along the heading, then of that across it (left positive)
    [m/s²], kept for 1 s; the velocity is kept after that, and the box keeps its heading.
    ways: of who drives and is to follow his lane (`resim.metrics.risk.lane_paths.ways`), in the continuous mode alone.
    """

    plan: Floats
    ego_size: Floats
    state: Floats
    size: Floats
    inputs: Floats
    motion: NDArray[np.uint8] | None = None
    ways: LanePaths | None = None

    def __post_init__(self) -> None:
        shape = self.state.shape[:2]
        shapes = {
            "plan": (shape[0], *self.plan.shape[1:2], 4), "ego_size": (shape[0], 2), "state": (*shape, 6),
            "size": (*shape, 2), "inputs": (*shape, 4), "motion": shape,
        }  # fmt: skip
        if self.ways is not None and self.ways.first.shape != shape:
            raise ResimError(f"risk: ways are those of {self.ways.first.shape} objects, expected {shape}")
        for name, expected in shapes.items():
            value = getattr(self, name)
            if value is not None and value.shape != expected:
                raise ResimError(f"risk: {name} has shape {value.shape}, expected {expected}")

    def known(self) -> None:
        """Raise ResimError where a plan, or the state or inputs of an object that is there, hold NaN."""
        if not np.isfinite(self.plan).all():
            n = int(np.argwhere(~np.isfinite(self.plan))[0, 0])
            raise ResimError(f"risk: the plan of scene {n} holds NaN; give numbers for all its times")
        unknown = ~(np.isfinite(self.state[..., :4]).all(axis=2) & np.isfinite(self.inputs).all(axis=2))
        if (unknown & (self.size[..., 0] > 0.0)).any():
            n, k = np.argwhere(unknown & (self.size[..., 0] > 0.0))[0]
            raise ResimError(
                f"risk: the state or inputs of object {k} in scene {n} hold NaN; "
                "give it the size 0 where it is not there"
            )


@dataclass(frozen=True, eq=False)
class Risk:
    """Results, in [0, 1] but for times.

    r_to: (S, K) Eq. 4.7, NaN where there is no object. r_ind: (S,) Eq. 4.10. r_dep: (S,) Eq. 4.9, exact.
    collision: (S, K) probability of contact. ttc, ttr: (S, K) s, shortest of all samples, inf where none touches.
    """

    r_to: Floats
    r_ind: Floats
    r_dep: Floats
    collision: Floats
    ttc: Floats
    ttr: Floats

    def scenes(self, part: slice) -> Risk:
        """Give that of some scenes."""
        return Risk(*(getattr(self, one.name)[part] for one in fields(self)))


@lru_cache(maxsize=16)
def _samples(mode: Mode, count: int, seed: int) -> tuple[Floats, Floats]:
    """Samples (N, 2) in units of 3 sigma, and their weights (N,) of Eq. 4.5; common to all objects."""
    if mode == "published":
        sample = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 2))
    else:
        sample = 2.0 * sobol_points(count, seed) - 1.0
    weight = np.exp(-4.5 * (sample**2).sum(axis=1))
    return sample, weight / weight.sum()


def accident_risk(scenes: Scenes, parameters: RiskParameters = DEFAULTS) -> Risk:
    """Give the accident risk of scenes. Raises ResimError where they hold NaN, or ways in the published mode."""
    # compiles, or reads what it compiled: only when risk is asked for
    from resim.metrics.risk.kernel import RiskArrays, Road, Sampling, SceneArrays, kernel

    p = parameters
    scenes.known()
    if scenes.ways is not None and p.mode == "published":
        raise ResimError(
            "risk: the published mode knows no road; leave ways out, or take the continuous mode"
        )
    count = p.samples or (100 if p.mode == "published" else 64)
    sample, weight = _samples(p.mode, count, p.seed)
    number, objects = scenes.state.shape[:2]
    motion = np.zeros((number, objects), dtype=np.uint8) if scenes.motion is None else scenes.motion
    given = (scenes.plan, scenes.ego_size, scenes.state, scenes.size, scenes.inputs, motion)
    ways = scenes.ways or LanePaths.none((number, objects))
    lanes = (ways.points, ways.begin, ways.first, ways.count, ways.s, ways.d)
    limits = np.array([p.lateral, p.braking, p.forward, p.curvature])
    times = np.array([p.no_return, p.most, p.slope])
    r_to, collision, ttc, ttr = (np.empty((number, objects)) for _ in range(4))
    found = Risk(r_to, np.empty(number), np.empty(number), collision, ttc, ttr)
    kernel(
        SceneArrays(*[_as_compiled(part) for part in given]),
        Road(*[_as_compiled(part) for part in lanes]),
        Sampling(sample, weight, limits, times, p.step, p.mode == "continuous"),
        RiskArrays(found.r_to, found.r_ind, found.r_dep, found.collision, found.ttc, found.ttr),
    )
    return found


def _as_compiled(values: ArrayLike) -> NDArray[Any]:
    """Give an array that the kernel is compiled for: for one that is read-only that takes half a minute once more."""
    return np.require(values, requirements=["C", "W"])
