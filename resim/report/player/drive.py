"""What the player shows of a drive: layers above each other, curves, and marks on the time line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import pandas as pd

from resim.core.clock import regular
from resim.core.geometry import Bools, Floats
from resim.core.tracks import Tracks
from resim.metrics.assessment_report import REASONS, DriveAssessment
from resim.metrics.drive import Plans
from resim.metrics.measures import State
from resim.road.opendrive import RoadNetwork

MarkKind = Literal["finding", "criterion", "decision", "reaction", "collision", "end"]
WINDOW = 0.4
"""s of speeds whose slope is the acceleration where no spline describes the drive."""
RATE = 10.0
"""Values a second [Hz] of a curve of accelerations."""


@dataclass(frozen=True)
class TimelineMark:
    """Something that happened from start to end [s]. source: of which layer, "" for all; object: whose id, or ""."""

    kind: MarkKind
    start: float
    end: float
    source: str
    object: str
    text: str


@dataclass(frozen=True, eq=False)
class Danger:
    """Over times t (S,) [s]: accident risk, 0 to 1, and least TTC [s], NaN where there is none; "": of nobody.

    unknown: (S,) whether the risk, or the TTC of anybody, could not be computed: then nobody may be called safe.
    """

    t: Floats
    risk: Floats
    risk_of: tuple[str, ...]
    ttc: Floats
    ttc_of: tuple[str, ...]
    unknown: Bools


@dataclass(frozen=True, eq=False)
class AccelerationCurve:
    """The EGO's acceleration a (S,) [m/s²] at times t (S,) [s], NaN where it is not known; whether splines give it."""

    t: Floats
    a: Floats
    of_splines: bool


@dataclass(frozen=True, eq=False)
class Layer:
    """One source of a drive: who was where, the plans that the EGO made, and curves; shown: from the start on.

    plans: when [s] each was made, and t, x, y, v (K, 4). assessed: what it was judged to be, if it was. maneuvers: rows
    of object, label, start, end [s] and partner, None where nobody looked for any. of: of which of several drives
    above each other, from 0.
    """

    name: str
    title: str
    tracks: Tracks
    plans: Plans = ()
    danger: Danger | None = None
    acceleration: AccelerationCurve | None = None
    shown: bool = True
    assessed: DriveAssessment | None = None
    maneuvers: pd.DataFrame | None = None
    of: int = 0

    @property
    def is_sensed(self) -> bool:
        """Whether it is what sensors saw, measured or simulated, and not where everybody was."""
        basis = self.name.rpartition(" ")[0] if self.of else self.name
        return basis == "SD" or basis.startswith("perceived")


@dataclass(frozen=True)
class DriveVerdict:
    """The verdict on a drive, and on each source that was judged; decides: whose verdict is that on the drive."""

    verdict: str
    sources: Mapping[str, str]
    decides: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PlayedDrive:
    """A drive as the player shows it.

    Attributes:
        name: What it is called.
        ego: Id of the EGO.
        network: The roads.
        layers: Its sources, in the order of their switches.
        marks: What happened when.
        notes: What to know of the layers.
        judged: The verdict on it, None where it was not judged by criteria.
    """

    name: str
    ego: str
    network: RoadNetwork
    layers: tuple[Layer, ...]
    marks: tuple[TimelineMark, ...] = ()
    notes: tuple[str, ...] = field(default=())
    judged: DriveVerdict | None = None


def differenced(tracks: Tracks, ego: str) -> AccelerationCurve | None:
    """Give the slope of the EGO's speed over WINDOW; None where it is not there twice."""
    if ego not in tracks.ids:
        return None
    row = tracks.index(ego)
    own = tracks.valid[row]
    t, v = tracks.t[own], tracks.v[row, own]
    if len(t) < 2:
        return None
    at = grid(float(t[0]), float(t[-1]))
    before, after = np.maximum(at - 0.5 * WINDOW, t[0]), np.minimum(at + 0.5 * WINDOW, t[-1])
    known = after > before
    slope = np.full(len(at), np.nan)
    slope[known] = (np.interp(after, t, v) - np.interp(before, t, v))[known] / (after - before)[known]
    return AccelerationCurve(at, slope, of_splines=False)


def grid(start: float, end: float) -> Floats:
    """Give RATE times [s] a second."""
    return regular(start, end - start, 1.0 / RATE)


def danger(found: DriveAssessment) -> Danger:
    """Give the curves of an assessment, and who is critical when."""
    t = np.array(found.t, dtype=float)
    risk = np.array([np.nan if r is None else r for r in found.risk.r_ind], dtype=float)
    _, risk_of = _extreme(found.risk.r_to, len(t), largest=True)
    ttc, ttc_of = _extreme(found.measures.get("TTC", {}), len(t), largest=False)
    risk_of = tuple(name if r > 0.0 else "" for name, r in zip(risk_of, risk, strict=True))
    reasons = found.reasons.get("TTC", {}).values()
    lost = np.array(
        [REASONS[State.NOT_COMPUTED] in scene for scene in zip(*reasons, strict=True)], dtype=bool
    )
    unknown = np.isnan(risk) | (lost if len(lost) else False)
    return Danger(t, risk, risk_of, ttc, ttc_of, unknown)


def _extreme(
    by_object: Mapping[str, tuple[float | None, ...]], count: int, *, largest: bool
) -> tuple[Floats, tuple[str, ...]]:
    """The largest or least value (S,) over objects, NaN where there is none, and whose it is, "" where nobody's."""
    ids = list(by_object)
    none = -np.inf if largest else np.inf
    values = np.array([[none if v is None else v for v in by_object[i]] for i in ids], dtype=float)
    if not ids:
        return np.full(count, np.nan), ("",) * count
    k = values.argmax(axis=0) if largest else values.argmin(axis=0)
    value = values[k, np.arange(count)]
    known = np.isfinite(value)
    names = tuple(ids[n] if there else "" for n, there in zip(k.tolist(), known.tolist(), strict=True))
    return np.where(known, value, np.nan), names


def thinned(layer: Layer, most: int) -> Layer:
    """Give a layer with at most so many samples of objects, by leaving out times evenly."""
    count = int(layer.tracks.valid.sum())
    step = -(-count // most)
    if step < 2:
        return layer
    return replace(layer, tracks=layer.tracks.samples(np.arange(0, len(layer.tracks.t), step)))
