"""What functions of several runs see and answer at once: those that have `step_batch` beside `step`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats, constant
from resim.core.tracks import Strings
from resim.simulation.function.interface import AdFunction, EgoState, Perceived, Setup

Integers = NDArray[np.intp]
NUMBERS = ("x_ego", "y_ego", "heading_ego", "v", "length", "width", "z_ego")
"""Columns of numbers in a list."""


@dataclass(frozen=True, slots=True, eq=False)
class PerceivedBatch:
    """What the functions of B runs see at time t [s]: a list a run, in rows of M, of which the first `count` are
    objects.

    ego: (B, 6), the fields of `EgoState`. count: (B,). key: (B, M), a whole number from 0 on for each id of a run, the
    same as long as the run lasts. ids, kind: (B, M). The others: (B, M), in the units of `Perceived`. What is behind
    the last object of a row means nothing. lists: what it was made of, if it was made of the runs' own lists.
    """

    t: float
    ego: Floats
    count: Integers
    key: Integers
    ids: Strings
    kind: Strings
    x_ego: Floats
    y_ego: Floats
    heading_ego: Floats
    v: Floats
    length: Floats
    width: Floats
    z_ego: Floats
    lists: Sequence[Perceived] | None = None

    def __len__(self) -> int:
        """How many runs these are."""
        return len(self.ego)

    @property
    def listed(self) -> NDArray[np.bool_]:
        """Which places (B, M) hold an object."""
        return np.asarray(np.arange(self.key.shape[1]) < self.count[:, None])

    def of(self, b: int) -> Perceived:
        """Give what the function of one run sees."""
        if self.lists is not None:
            return self.lists[b]
        n = int(self.count[b])
        return Perceived(
            self.t, EgoState(*self.ego[b].tolist()), self.ids[b, :n], self.kind[b, :n], self.x_ego[b, :n],
            self.y_ego[b, :n], self.heading_ego[b, :n], self.v[b, :n], self.length[b, :n], self.width[b, :n],
            self.z_ego[b, :n],
        )  # fmt: skip


class PerceivedLists(Sequence[Perceived]):
    """The lists of one run, in order of time."""

    def __init__(self, lists: Sequence[Perceived]) -> None:
        self._lists = lists

    def __len__(self) -> int:
        return len(self._lists)

    def __getitem__(self, k: Any) -> Any:
        return self._lists[k]

    def columns(self) -> tuple[Floats, Integers, Strings]:
        """Give times (L,) [s] of the lists, how many objects each has (L,), and the ids of all, list by list."""
        count = np.array([len(p.ids) for p in self._lists], dtype=np.intp)
        ids = np.concatenate([np.empty(0, dtype=str), *(p.ids for p in self._lists)])
        return np.array([p.t for p in self._lists]), count, ids


class ListsOfBatch(PerceivedLists):
    """Those of run b of several: each is made when it is asked for."""

    def __init__(self, batches: Sequence[PerceivedBatch], b: int) -> None:
        self._batches, self._b = batches, b

    def __len__(self) -> int:
        return len(self._batches)

    def __getitem__(self, k: Any) -> Any:
        if isinstance(k, slice):
            return tuple(batch.of(self._b) for batch in self._batches[k])
        return self._batches[k].of(self._b)

    def columns(self) -> tuple[Floats, Integers, Strings]:
        """Give what `PerceivedLists.columns` gives."""
        b, count = self._b, np.array([p.count[self._b] for p in self._batches], dtype=np.intp)
        listed = (p.ids[b, :n] for p, n in zip(self._batches, count.tolist(), strict=True))
        ids = np.concatenate([np.empty(0, dtype=str), *listed])
        return np.array([p.t for p in self._batches]), count, ids


@dataclass(frozen=True, slots=True, eq=False)
class CommandBatch:
    """What the functions of B runs answer: acceleration [m/s²] and curvature [1/m, left positive] (B,), and their plans
    (B, K, 4) as `Command` has them, or none.
    """

    acceleration: Floats
    curvature: Floats
    plan: Floats | None = None


class BatchFunction(AdFunction, Protocol):
    """A function that drives several runs of one scenario at once, besides one by `reset` and `step`.

    What it answers for a run may not depend on what else is in the batch, nor on how many these are: some runs are
    driven again one by one, by `step`, and have to be the same to the bit.
    """

    def reset_batch(self, setups: Sequence[Setup]) -> None:
        """Prepare for B runs."""

    def step_batch(self, perceived: PerceivedBatch) -> CommandBatch:
        """Answer what is perceived in each of them."""


def batch_of_one(perceived: Perceived, key: Integers) -> PerceivedBatch:
    """Give what one run sees as a batch; key (M,): as `PerceivedBatch.key`."""
    p = perceived
    return PerceivedBatch(
        p.t, np.array([p.ego]), np.array([len(p.ids)]), key[None], p.ids[None], p.kind[None], p.x_ego[None],
        p.y_ego[None], p.heading_ego[None], p.v[None], p.length[None], p.width[None], p.z_ego[None], (p,),
    )  # fmt: skip


def stacked(lists: Sequence[Perceived], keys: Sequence[Integers]) -> PerceivedBatch:
    """Give the lists of B runs at one time as a batch; keys: of each its (M,)."""
    if len(lists) == 1:
        return batch_of_one(lists[0], keys[0])
    count = np.array([len(p.ids) for p in lists], dtype=np.intp)

    def filled(columns: Sequence[NDArray[Any]], blank: Any) -> NDArray[Any]:
        out = np.full((len(lists), int(count.max())), blank, dtype=np.result_type(*columns))
        for row, column in zip(out, columns, strict=True):
            row[: len(column)] = column
        return constant(out)

    x, y, heading, v, length, width, z = (filled([getattr(p, n) for p in lists], np.nan) for n in NUMBERS)
    ids, kind = (filled([getattr(p, name) for p in lists], "") for name in ("ids", "kind"))
    ego = constant(np.array([p.ego for p in lists]))
    return PerceivedBatch(
        lists[0].t,
        ego,
        constant(count),
        filled(keys, 0),
        ids,
        kind,
        x,
        y,
        heading,
        v,
        length,
        width,
        z,
        lists,
    )


class Keys:
    """Numbers for the ids of B runs: even ones for those of the traffic, which all runs have, odd ones for others."""

    def __init__(self, runs: int) -> None:
        self._traffic: dict[str, int] = {}
        self._others: list[dict[str, int]] = [{} for _ in range(runs)]

    def of_traffic(self, ids: Strings) -> Integers:
        """Give the numbers (N,) of objects that are there."""
        known = self._traffic
        return np.array([2 * known.setdefault(name, len(known)) for name in ids.tolist()], dtype=np.intp)

    def of_list(self, b: int, ids: Strings) -> Integers:
        """Give the numbers (N,) of what is on the list of a run."""
        known, others = self._traffic, self._others[b]
        return np.array(
            [
                2 * known[name] if name in known else 2 * others.setdefault(name, len(others)) + 1
                for name in ids.tolist()
            ],
            dtype=np.intp,
        )
