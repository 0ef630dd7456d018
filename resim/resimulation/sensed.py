"""What was perceived of a drive, as a recording has it: sensor tracks with the objects they are of, and plans."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from resim.core.schema import PLAN_COLUMNS
from resim.core.tracks import Strings, Tracks
from resim.resimulation.tables import perceived_frame, plan_frame
from resim.simulation.case import SimulatedDrive
from resim.simulation.function.interface import EgoState, Perceived
from resim.simulation.perception import OneRun, Perception, PerceptionBatch, World, worlds_of

SWITCHED = "#"
"""What stands between an object's id and how often a perception model switched it."""


@dataclass(frozen=True, eq=False)
class SensedTracks:
    """Sensor data of one drive.

    Attributes:
        tracks: The EGO as it has itself, then who was perceived, in the map frame.
        gt_id: (N,) id of the true object that each is, "" for what is not there.
    """

    tracks: Tracks
    gt_id: Strings


def sensed_tracks(seen: Sequence[Perceived], truth: Tracks, ego: str) -> SensedTracks:
    """Give lists of perceived objects as tracks.

    Args:
        seen: Lists in order of time, those of the EGO's drive.
        truth: Who is there, for ids, and the EGO's kind and size.
        ego: The EGO's id.
    """
    own = truth.select([ego])
    states = np.array([one.ego for one in seen])
    x, y, heading, v = states[:, None, :4].T
    t = np.array([one.t for one in seen])
    driver = Tracks(
        t=t, ids=own.ids, kind=own.kind, x=x, y=y, heading=heading, v=v, length=own.length, width=own.width,
        valid=np.ones((1, len(t)), dtype=bool),
    )  # fmt: skip
    others = perceived_frame(seen)
    if not len(others):
        return SensedTracks(driver, own.ids)
    tracks = Tracks.from_frame(pd.concat([driver.to_frame(), others], ignore_index=True))
    known = set(truth.ids.tolist())
    return SensedTracks(tracks, np.array([_true_id(name, known) for name in tracks.ids.tolist()], dtype=str))


def _true_id(name: str, known: Collection[str]) -> str:
    """The id of the true object that a perceived one is, "" for none."""
    base = name if name in known else name.partition(SWITCHED)[0]
    return base if base in known else ""


class WithinSight:
    """A perception of who is up to `sight` [m] from the EGO: errors of a model grow without end beyond its data."""

    def __init__(self, inner: Perception, sight: float) -> None:
        self.inner, self.sight = inner, sight
        self.hash = f"{inner.hash} within {sight:g} m"

    def together(
        self, others: Sequence[Perception], rngs: Sequence[np.random.Generator]
    ) -> PerceptionBatch | None:
        """Give that of one run, whose draws come from its generator; None for several."""
        batch = None if others else self.inner.together((), rngs)
        if batch is None:
            return None
        whole = batch

        def look(world: World) -> Perceived:
            away = np.abs(world.position - complex(world.ego.x, world.ego.y))
            far = set(world.ids[away > self.sight].tolist())
            return _without(whole.perceive(worlds_of(world)).of(0), far)

        return OneRun(look)


def _without(seen: Perceived, far: Collection[str]) -> Perceived:
    """The list without objects, whatever a model calls them by now."""
    names = seen.ids.tolist()
    near = np.array([n not in far and n.partition(SWITCHED)[0] not in far for n in names], dtype=bool)
    columns = ("ids", "kind", "x_ego", "y_ego", "heading_ego", "v", "length", "width", "z_ego")
    return replace(seen, **{name: getattr(seen, name)[near] for name in columns})


def perceive_along(
    perception: Perception, tracks: Tracks, ego: str, rng: np.random.Generator
) -> list[Perceived]:
    """Give what one of the objects, the EGO, perceives of the others while it is there, at every sample.

    Args:
        perception: What makes perceived lists of the truth; begins anew.
        tracks: Everybody, with accelerations and yaw rates.
        ego: Who perceives.
        rng: Of every random draw.
    """
    batch = perception.together((), [rng])
    assert batch is not None
    return [batch.perceive(worlds_of(world)).of(0) for world in _worlds(tracks, tracks.index(ego))]


def _worlds(tracks: Tracks, row: int) -> Iterator[World]:
    """The truth at every sample of the EGO; the ids are one array as long as the same objects are there."""
    others = np.arange(len(tracks)) != row
    motion = np.stack([tracks.x, tracks.y, tracks.heading, tracks.v, tracks.a, tracks.yaw_rate])  # type: ignore[list-item]
    there = tracks.valid & others[:, None]
    rows = names = kinds = length = width = None
    for k in np.flatnonzero(tracks.valid[row]).tolist():
        now = np.flatnonzero(there[:, k])
        if rows is None or not np.array_equal(now, rows):
            rows, names, kinds = now, tracks.ids[now], tracks.kind[now]
            length, width = tracks.length[now], tracks.width[now]
        x, y, heading, v = motion[:4, rows, k]
        own = EgoState(*motion[:, row, k].tolist())
        yield World(float(tracks.t[k]), own, names, kinds, x + 1j * y, heading, v, length, width)  # type: ignore[arg-type]


def planned(drive: SimulatedDrive, end: float) -> pd.DataFrame | None:
    """Give the plans of a drive that were made up to `end` [s], as a recording has them; None where there are none."""
    frame = plan_frame({"": [(when, plan) for when, plan in drive.plans if when <= end]})
    return frame[[*PLAN_COLUMNS]].round(6) if len(frame) else None
