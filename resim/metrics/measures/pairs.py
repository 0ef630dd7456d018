"""Scenes of the EGO and traffic objects, as criticality measures take them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from resim.core.errors import ResimError
from resim.core.geometry import Bools, Floats
from resim.metrics.measures import motion
from resim.metrics.measures.contact import Rows, first_contact
from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.values import MeasureValues, State, StateArray
from resim.metrics.risk import Scenes

CHUNK = 2048  # pairs looked at together: bounds memory


@dataclass(frozen=True, eq=False)
class CompletePairs:
    """P pairs of the EGO and one object, all complete; fields as in `Pairs`, rows (P, ...).

    every: the scenes that they are of, pair p of scene[p] and its object column[p].
    """

    every: Pairs
    scene: Rows
    column: Rows
    plan: Floats
    ego_size: Floats
    state: Floats
    size: Floats
    path: Floats | None
    step: float
    horizon: float

    @cached_property
    def steps(self) -> int:
        """How many steps the horizon is cut into."""
        return max(1, round(self.horizon / self.step))

    @property
    def h(self) -> Floats:
        """The step (P,) [s] that divides the horizon evenly."""
        return np.full(len(self.plan), self.horizon / self.steps)

    @property
    def t(self) -> Floats:
        """Times (P, N + 1) [s] over the horizon."""
        return np.arange(self.steps + 1) * self.h[:, None]

    def rows(self, rows: Rows) -> CompletePairs:
        """Give these pairs."""
        path = None if self.path is None else self.path[rows]
        return replace(
            self, scene=self.scene[rows], column=self.column[rows], plan=self.plan[rows],
            ego_size=self.ego_size[rows], state=self.state[rows], size=self.size[rows], path=path,
        )  # fmt: skip

    def planned(self, t: Floats) -> Floats:
        """Give the EGO's plan (P, N, 4) at t (P, N)."""
        return motion.sample_rows(self.every.turned_plan, self.scene, self.step, t)

    @property
    def steady(self) -> Floats:
        """The EGO (P, N + 1, 4) over the horizon along the path of its plan, at its present speed."""
        return self.every.steady[self.scene]

    def expected(self, t: Floats) -> Floats:
        """Give the objects (P, N, 4): their driven path if it is known, else acceleration and yaw rate kept."""
        if self.path is None:
            return motion.ctra(self.state, t)
        rows = self.scene * self.every.state.shape[1] + self.column
        return motion.sample_rows(self.every.turned_path, rows, self.step, t)


@dataclass(frozen=True, eq=False)
class Pairs:
    """S scenes of the EGO and up to K objects; shapes as in `resim.metrics.risk.Scenes`.

    plan: (S, M + 1, 4) the EGO's x, y [m], heading [rad], v [m/s] at 0, step, ... s. ego_size: (S, 2) length,
    width [m]. state: (S, K, 6) x, y, heading, v, a [m/s²], yaw rate [rad/s]; size: (S, K, 2), 0 or NaN where there
    is no such object. path: (S, K, M + 1, 4) driven paths of the objects in place of predicted ones, if known.
    horizon: s, how far measures look; by default the plan's. Beyond its end a plan or path goes straight on.
    Raises ResimError for arrays that do not fit.
    """

    plan: Floats
    ego_size: Floats
    state: Floats
    size: Floats
    step: float
    horizon: float | None = None
    path: Floats | None = None

    def __post_init__(self) -> None:
        s, k = self.state.shape[:2]
        expected = {
            "ego_size": (s, 2),
            "state": (s, k, 6),
            "size": (s, k, 2),
            "plan": (s, self.plan.shape[1], 4),
        }
        if self.path is not None:
            expected["path"] = (s, k, self.plan.shape[1], 4)
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise ResimError(f"pairs: {name} has shape {getattr(self, name).shape}, expected {shape}")
        if self.plan.shape[1] < 2 or not self.step > 0.0 or not self.span > 0.0:
            raise ResimError("pairs: expected two or more plan points, and step and horizon above 0 s")

    @classmethod
    def of(cls, scenes: Scenes, step: float, horizon: float | None = None) -> Pairs:
        """Give the pairs of risk scenes whose plan has this step [s]."""
        return cls(scenes.plan, scenes.ego_size, scenes.state, scenes.size, step, horizon)

    def scenes(self, rows: Rows) -> Pairs:
        """Give those of some scenes."""
        path = None if self.path is None else self.path[rows]
        return replace(
            self, plan=self.plan[rows], ego_size=self.ego_size[rows], state=self.state[rows], size=self.size[rows],
            path=path,
        )  # fmt: skip

    @property
    def span(self) -> float:
        """The horizon [s]."""
        return (self.plan.shape[1] - 1) * self.step if self.horizon is None else self.horizon

    @cached_property
    def steady(self) -> Floats:
        """The EGO (S, N + 1, 4) over the horizon along the path of its plan, at its present speed."""
        n = max(1, round(self.span / self.step))
        pace = np.repeat(np.abs(self.plan[:, 0, 3, None]), n + 1, axis=1)
        return motion.along(self.plan, pace * (np.arange(n + 1) * (self.span / n)), pace)

    @cached_property
    def turned_plan(self) -> Floats:
        """The EGO's plans as `motion.sample_rows` takes them."""
        return motion.turned(self.plan)

    @cached_property
    def turned_path(self) -> Floats:
        """The objects' driven paths, scene by scene, as `motion.sample_rows` takes them."""
        assert self.path is not None
        return motion.turned(self.path.reshape(-1, *self.path.shape[2:]))

    @cached_property
    def contact(self) -> Floats:
        """The first contact (S, K) [s] of the EGO's plan with the expected motion of each object, inf for none.

        NaN of pairs that are not complete.
        """
        out = np.full(self.state.shape[:2], np.nan)
        for p in self.complete_pairs():
            out[p.scene, p.column] = first_contact(p.planned(p.t), p.expected(p.t), p.h, p.ego_size, p.size)
        return out

    @property
    def going(self) -> Floats:
        """The EGO (S, N + 1, 4) as planned over the horizon, straight on after the plan's end."""
        if self.horizon is None:
            return self.plan
        n = max(1, round(self.span / self.step))
        t = np.broadcast_to(np.arange(n + 1) * (self.span / n), (len(self.plan), n + 1))
        return motion.sample(self.plan, self.step, t)

    def complete(self, columns: int = 6) -> Bools:
        """Say (S, K) which pairs have all input: no NaN in the first columns of the state, no size of 0.

        Where driven paths are known, acceleration and yaw rate (columns 5 and 6) are not needed.
        """
        columns = columns if self.path is None else min(columns, 4)
        ego = [
            np.isfinite(self.plan).all(axis=(1, 2)),
            (np.isfinite(self.ego_size) & (self.ego_size > 0)).all(axis=1),
        ]
        objects = [
            np.isfinite(self.state[..., :columns]).all(axis=2),
            (np.isfinite(self.size) & (self.size > 0)).all(axis=2),
        ]
        if self.path is not None:
            objects.append(np.isfinite(self.path).all(axis=(2, 3)))
        return np.asarray(np.all(ego, axis=0)[:, None] & np.all(objects, axis=0))

    def measured(
        self,
        measure: MeasureDefinition,
        of: Callable[[CompletePairs], tuple[Floats, StateArray]],
        *,
        columns: int = 6,
    ) -> MeasureValues:
        """Give a measure (S, K) of all complete pairs; NOT_COMPUTED where NaN or a size of 0 stands in the input.

        of: gives value and state (P,) of P pairs.

        columns: how many of the object's state are needed; the rest may be NaN.
        """
        shape = self.state.shape[:2]
        value, state = np.full(shape, np.nan), np.full(shape, State.NOT_COMPUTED, dtype=np.uint8)
        for p in self.complete_pairs(columns):
            value[p.scene, p.column], state[p.scene, p.column] = of(p)
        return measure.values(value, state)

    def complete_pairs(self, columns: int = 6) -> Iterator[CompletePairs]:
        """Give the pairs that are complete, as `complete` has it, in parts that memory holds."""
        s, k = np.nonzero(self.complete(columns))
        for begin in range(0, len(s), CHUNK):
            i, j = s[begin : begin + CHUNK], k[begin : begin + CHUNK]
            path = None if self.path is None else self.path[i, j]
            size = self.size[i, j]
            yield CompletePairs(
                self, i, j, self.plan[i], self.ego_size[i], self.state[i, j], size, path, self.step, self.span
            )
