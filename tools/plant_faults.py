"""Plant faults of random kind, place and size in the shipped recordings, and count how many a check finds.

    python tools/plant_faults.py [N] [--seed S] [--misses] [--only KIND] [--fix]

A plant counts as found when a finding of the kind's code names the source and object that were hit and does
not stand for the untouched recording. Where GT and SD only disagree with each other (reference point), either
may be named. Sizes go, logarithmically where they span more than a factor of five, from the smallest that
matters for a result; each kind says which. A plant that would not reach it is drawn again.

With --fix each plant is repaired as well: of those whose finding has a repair, the share in which it is gone
afterwards, and how far the repaired rows are then off the untouched recording.
"""

from __future__ import annotations

import argparse
import time
import traceback
import warnings
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from repaired_plants import HEAD, Remains

from resim.core.finding import Finding
from resim.core.geometry import Floats, wrap_angle
from resim.recordings import RecordingTables, read_tables
from resim.recordings.checks import examine
from resim.road.opendrive import RoadNetwork, load

SCENARIOS = Path(__file__).parents[1] / "scenarios"
VALUES = ["x", "y", "heading", "v"]


class AgainError(Exception):
    """The draw would change too little, or cannot be made here: draw again."""


@dataclass(frozen=True)
class Plant:
    """What was planted: the tables, the codes that tell it, (source, object) pairs of which one must be named."""

    tables: RecordingTables
    codes: tuple[str, ...]
    named: tuple[tuple[str, str], ...]
    what: str


class Bed:
    """A recording to plant in, and the dice. `frame` and `ids` are of the source drawn."""

    def __init__(self, tables: RecordingTables, network: RoadNetwork, rng: np.random.Generator) -> None:
        self.tables, self.network, self.rng = tables, network, rng
        self.source = str(rng.choice(["gt", "sd"]))
        self.frame = self.of(self.source).copy()
        self.ids = list(dict.fromkeys(self.frame["id"]))
        self.object = str(rng.choice(self.ids))
        self.own = (self.frame["id"] == self.object).to_numpy()
        self.t = self.frame.loc[self.own, "t"].to_numpy()
        self.step = float(np.median(np.diff(self.t)))

    def of(self, source: str) -> pd.DataFrame:
        """The untouched table of the source."""
        frame = self.tables.gt if source == "gt" else self.tables.sd
        assert frame is not None
        return frame

    def between(self, low: float, high: float) -> float:
        """A size, logarithmic where the range is wide."""
        if high > 5.0 * low > 0.0:
            return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))
        return float(self.rng.uniform(low, high))

    def sign(self) -> float:
        """1 or -1."""
        return float(self.rng.choice([-1.0, 1.0]))

    def time(self, low: float = 0.15, high: float = 0.85) -> float:
        """A time [s] within the recording, by share of it."""
        return float(self.t[0] + self.rng.uniform(low, high) * (self.t[-1] - self.t[0]))

    def span(self, lasts: float) -> np.ndarray:
        """Rows of the object in a span of that length [s] somewhere in the recording."""
        if lasts > 0.8 * (self.t[-1] - self.t[0]):
            raise AgainError
        start = self.rng.uniform(self.t[0] + 0.2, self.t[-1] - lasts - 0.2)
        return self.own & (self.frame["t"].to_numpy() >= start) & (self.frame["t"].to_numpy() < start + lasts)

    def done(self, what: str, *codes: str, whole: bool = False, also: tuple[str, ...] = ()) -> Plant:
        """The plant in the source drawn: on the object (or one of `also`), or on the whole table."""
        return self.planted({self.source: self.frame}, what, *codes, whole=whole, also=also)

    def planted(
        self,
        frames: dict[str, pd.DataFrame],
        what: str,
        *codes: str,
        whole: bool = False,
        also: tuple[str, ...] = (),
    ) -> Plant:
        """The plant in these tables."""
        tables = replace(self.tables, **frames)
        names = ("",) if whole else (self.object, *also)
        named = tuple((s, n) for s in frames for n in names)
        who = "all" if whole else self.object
        return Plant(tables, codes, named, f"{self.tables.settings.name} {self.source} {who}: {what}")


def missing_samples(b: Bed) -> Plant:
    """2 samples to 0.3 s of one object."""
    rows = np.flatnonzero(b.own)
    count = int(b.rng.integers(2, round(0.3 / b.step)))
    at = int(b.rng.integers(2, len(rows) - count - 2))
    b.frame = b.frame.drop(b.frame.index[rows[at : at + count]])
    return b.done(f"{count} samples", "MISSING_SAMPLES")


def missing_values(b: Bed) -> Plant:
    """1 to 20 cells of one column."""
    rows = b.rng.choice(np.flatnonzero(b.own), int(b.rng.integers(1, 21)), replace=False)
    column = str(b.rng.choice(VALUES))
    b.frame.iloc[rows, b.frame.columns.get_loc(column)] = np.nan
    return b.done(f"{len(rows)} x {column}", "MISSING_VALUES")


def duplicates(b: Bed) -> Plant:
    """1 to 20 rows again, half of them with another position."""
    rows = np.sort(b.rng.choice(np.flatnonzero(b.own), int(b.rng.integers(1, 21)), replace=False))
    extra = b.frame.iloc[rows].copy()
    other = b.rng.random() < 0.5
    if other:
        extra["x"] += b.sign() * b.between(0.1, 50.0)
    place = b.frame.index[rows].to_numpy() + (0.5 if b.rng.random() < 0.5 else 1e6)
    extra.index = pd.Index(place)
    b.frame = pd.concat([b.frame, extra]).sort_index(kind="stable").reset_index(drop=True)
    if place[0] > 1e5:  # at the end of the file: the rows run back in time as well
        return b.done(f"{len(rows)} at the end, other {other}", "DUPLICATE_SAMPLES")
    return b.done(f"{len(rows)} beside, other {other}", "DUPLICATE_SAMPLES")


def repeated_samples(b: Bed) -> Plant:
    """Values that stand for 2 samples to 1 s."""
    rows = np.flatnonzero(b.own)
    count = round(b.between(2, 1.0 / b.step))
    at = int(b.rng.integers(2, len(rows) - count - 2))
    v = np.abs(b.frame["v"].to_numpy()[rows[at]])
    if v * count * b.step < 0.15:
        raise AgainError
    for column in ("x", "y", "heading", "v") if b.rng.random() < 0.5 else ("x", "y"):
        values = b.frame[column].to_numpy().copy()
        values[rows[at + 1 : at + 1 + count]] = values[rows[at]]
        b.frame[column] = values
    return b.done(f"{count} at t {b.t[at]:.2f}", "REPEATED_SAMPLES")


def time_backwards(b: Bed) -> Plant:
    """A block of 1 to 30 rows of one object that stands elsewhere in the file."""
    rows = np.flatnonzero(b.own)
    count = int(b.rng.integers(1, 31))
    at, to = b.rng.integers(0, len(rows) - count, 2)
    if at == to:
        raise AgainError
    order = list(range(len(rows)))
    block = order[at : at + count]
    rest = order[:at] + order[at + count :]
    moved = rest[:to] + block + rest[to:]
    place = np.arange(len(b.frame))
    place[rows] = rows[moved]
    b.frame = b.frame.iloc[place].reset_index(drop=True)
    return b.done(f"{count} rows from {at} to {to}", "TIME_BACKWARDS")


def gap(b: Bed) -> Plant:
    """0.4 to 3 s of one object or of all."""
    lasts = b.between(0.4, 3.0)
    rows = b.span(lasts)
    whole = b.rng.random() < 0.3
    if whole:
        t = b.frame["t"].to_numpy()
        rows = (t >= t[rows].min()) & (t <= t[rows].max())
    b.frame = b.frame[~rows]
    return b.done(f"{lasts:.2f} s", "GAP", whole=whole)


def clock_jump(b: Bed) -> Plant:
    """0.1 to 2 s, forwards or back: 2 m at 20 m/s."""
    amount, at = b.sign() * b.between(0.1, 2.0), b.time()
    if b.rng.random() < 0.5:
        amount = round(amount / b.step) * b.step
    b.frame["t"] = np.where(b.frame["t"] > at, b.frame["t"] + amount, b.frame["t"])
    return b.done(f"{amount:+.3f} s at {at:.2f}", "CLOCK_JUMP", whole=True)


def clock_drift(b: Bed) -> Plant:
    """0.2 to 1 s over the recording: 4 m at 20 m/s at its end."""
    amount = b.sign() * b.between(0.2, 1.0)
    t = b.frame["t"].to_numpy()
    start = float(b.rng.choice([t[0], 0.5 * (t[0] + t[-1])]))
    b.frame["t"] = start + (t - start) * (1.0 + amount / np.ptp(t))
    return b.done(f"{amount:+.3f} s from {start:.2f}", "CLOCK_DRIFT", whole=True)


def clock_offset(b: Bed) -> Plant:
    """0.35 to 3 s, beyond what sensors have, of one source: 7 m at 20 m/s."""
    amount = b.sign() * b.between(0.35, 3.0)
    b.frame["t"] = b.frame["t"] + amount
    plant = b.done(f"{amount:+.3f} s", "CLOCK_OFFSET", whole=True)
    return replace(plant, named=(("gt", ""), ("sd", "")))


def sensor_delay(b: Bed) -> Plant:
    """0.09 to 0.2 s of the SD, as sensors have it: 2 to 4 m at 20 m/s."""
    amount = b.between(0.09, 0.2)
    b.source, b.frame = "sd", b.of("sd").assign(t=b.of("sd")["t"] + amount)
    return b.done(f"{amount:+.3f} s", "CLOCK_OFFSET", whole=True)


def track_shifted(b: Bed) -> Plant:
    """One object's track, 0.35 to 3 s against the others."""
    amount = b.sign() * b.between(0.35, 3.0)
    if b.rng.random() < 0.5:
        amount = round(amount / b.step) * b.step
    b.frame.loc[b.own, "t"] += amount
    b.frame = b.frame.sort_values("t", kind="stable").reset_index(drop=True)
    plant = b.done(f"{amount:+.3f} s", "CLOCK_OFFSET")
    return replace(plant, named=(("gt", b.object), ("sd", b.object)))


def id_reused(b: Bed) -> Plant:
    """After a gap of 0.2 to 2 s the id is that of a vehicle 12 to 150 m away, faster or slower."""
    lasts, far = b.between(0.2, 2.0), b.between(12.0, 150.0)
    at = b.time(0.2, 0.6)
    t = b.frame["t"].to_numpy()
    b.frame = b.frame[~(b.own & (t > at) & (t < at + lasts))].copy()
    later = ((b.frame["id"] == b.object) & (b.frame["t"] > at)).to_numpy()
    if later.sum() < 10:
        raise AgainError
    lane = float(b.rng.choice([0.0, 3.5]))
    angle = 0.0 if b.rng.random() < 0.5 else np.pi
    b.frame.loc[later, "x"] += far * np.cos(angle)
    b.frame.loc[later, "y"] += lane
    return b.done(f"{far:.1f} m after {lasts:.2f} s", "ID_REUSED")


def id_switch(b: Bed) -> Plant:
    """Two objects change ids from some time on."""
    others = [i for i in b.ids if i != b.object]
    other = str(b.rng.choice(others))
    late = (b.frame["t"] > b.time()).to_numpy()
    swap = {b.object: other, other: b.object}
    b.frame["id"] = np.where(late, b.frame["id"].map(lambda i: swap.get(i, i)), b.frame["id"])
    return b.done(f"with {other}", "ID_SWITCH", also=(other,))


def track_broken(b: Bed) -> Plant:
    """The track goes on under a new id, at once or after up to 0.9 s."""
    if b.object == b.tables.settings.ego:
        raise AgainError
    at, lasts = b.time(), float(b.rng.choice([0.0, b.rng.uniform(0.1, 0.9)]))
    t = b.frame["t"].to_numpy()
    b.frame = b.frame[~(b.own & (t > at) & (t < at + lasts))].copy()
    late = (b.frame["t"] > at) & (b.frame["id"] == b.object)
    if late.sum() < 5:
        raise AgainError
    b.frame.loc[late, "id"] = "99"
    if b.source == "sd":
        b.frame.loc[late, "gt_id"] = ""
    return b.done(f"after {lasts:.2f} s", "TRACK_BROKEN", also=("99",))


def position_jump(b: Bed) -> Plant:
    """1 to 50 m, in one step and for good."""
    far, angle = b.between(1.0, 50.0), b.rng.uniform(0.0, 2.0 * np.pi)
    late = b.own & (b.frame["t"].to_numpy() > b.time())
    b.frame.loc[late, "x"] += far * np.cos(angle)
    b.frame.loc[late, "y"] += far * np.sin(angle)
    return b.done(f"{far:.2f} m", "POSITION_JUMP")


def outlier(b: Bed) -> Plant:
    """1 to 3 single samples, 1 to 30 m off."""
    rows = b.rng.choice(np.flatnonzero(b.own), int(b.rng.integers(1, 4)), replace=False)
    far = b.between(1.0, 30.0)
    for row in rows:
        angle = b.rng.uniform(0.0, 2.0 * np.pi)
        b.frame.iloc[row, b.frame.columns.get_loc("x")] += far * np.cos(angle)
        b.frame.iloc[row, b.frame.columns.get_loc("y")] += far * np.sin(angle)
    return b.done(f"{far:.2f} m, {len(rows)} of them", "OUTLIER")


def speed_disagrees(b: Bed) -> Plant:
    """A speed that is 10 to 60 % off, or 1 to 6 m/s for a second or more, or 0.5 to 2 s late; at least 1 m/s."""
    v = b.frame["v"].to_numpy().copy()
    rows, how = b.own, str(b.rng.choice(["share", "part", "late"]))
    if how == "share":
        amount = 1.0 + b.sign() * b.between(0.1, 0.6)
        v[rows] *= amount
    elif how == "part":
        amount, rows = b.sign() * b.between(1.0, 6.0), b.span(b.between(1.0, 4.0))
        v[rows] += amount
    else:
        amount = b.between(0.5, 2.0)
        v[rows] = np.interp(b.t - amount, b.t, v[rows])
    if np.abs(v - b.frame["v"].to_numpy())[rows].max() < 1.0:
        raise AgainError
    b.frame["v"] = v
    return b.done(f"{how} {amount:+.2f}", "SPEED_DISAGREES")


def heading_disagrees(b: Bed) -> Plant:
    """A heading turned by 0.05 to 3.1 rad, or by 0.15 and more for a second or more: 0.05 rad are 1 m in 20."""
    h = b.frame["heading"].to_numpy().copy()
    if b.rng.random() < 0.5:
        rows, amount = b.own, b.sign() * b.between(0.05, np.pi)
    else:
        rows, amount = b.span(b.between(1.0, 4.0)), b.sign() * b.between(0.15, np.pi)
    h[rows] = wrap_angle(h[rows] + amount)
    b.frame["heading"] = h
    return b.done(f"{amount:+.3f} rad, {int(rows.sum())} samples", "HEADING_DISAGREES", "HEADING_TURNED")


def _redriven(b: Bed, v: Floats, heading: Floats) -> None:
    """Put the object on the way that speed and heading tell, its own noise and errors kept."""
    own = b.frame.loc[b.own]
    dt = np.diff(own["t"].to_numpy(), prepend=own["t"].iloc[0])
    old = own["v"].to_numpy() * np.exp(1j * own["heading"].to_numpy())
    new = v * np.exp(1j * heading)
    more = np.cumsum((new - old) * dt)
    b.frame.loc[b.own, "x"] += more.real
    b.frame.loc[b.own, "y"] += more.imag
    b.frame.loc[b.own, "v"] = v
    b.frame.loc[b.own, "heading"] = wrap_angle(heading)


def acceleration(b: Bed) -> Plant:
    """The object changes its speed at 16 to 60 m/s² by 3.5 to 15 m/s, its positions with it."""
    a, change = b.between(16.0, 60.0), b.between(3.5, 15.0)
    own = b.frame.loc[b.own]
    at, v = b.time(), own["v"].to_numpy()
    sign = b.sign() if v.min() > change else 1.0
    ramp = np.clip((own["t"].to_numpy() - at) * a, 0.0, change)
    _redriven(b, v + sign * ramp, own["heading"].to_numpy())
    return b.done(f"{sign * a:+.1f} m/s² by {change:.1f} m/s", "ACCELERATION")


def yaw_rate(b: Bed) -> Plant:
    """The object swerves with 20 to 100 m/s² across, by 0.15 rad and more, and back; its positions with it."""
    own = b.frame.loc[b.own]
    v = own["v"].to_numpy()
    across, angle = b.between(20.0, 100.0), b.between(0.15, 0.5)
    rate = across / max(float(np.median(v)), 3.0)
    at, t = b.time(0.1, 0.7), own["t"].to_numpy()
    turned = np.clip((t - at) * rate, 0.0, angle) - np.clip((t - at - 0.6) * rate, 0.0, angle)
    _redriven(b, v, own["heading"].to_numpy() + b.sign() * turned)
    return b.done(f"{rate:.2f} rad/s by {angle:.2f} rad", "YAW_RATE")


def overlap(b: Bed) -> Plant:
    """A double of an object, 0.4 m deep in it to fully, for 1.2 s or more."""
    lasts = b.between(1.2, 5.0)
    rows = b.span(lasts)
    ghost = b.frame.loc[rows].copy()
    length, width = float(ghost["length"].iloc[0]), float(ghost["width"].iloc[0])
    along = b.sign() * b.rng.uniform(0.0, length - 0.4)
    across = b.sign() * b.rng.uniform(0.0, width - 0.4)
    h = ghost["heading"].to_numpy()
    ghost["x"] += along * np.cos(h) - across * np.sin(h)
    ghost["y"] += along * np.sin(h) + across * np.cos(h)
    ghost["id"] = "98"
    if b.source == "sd":
        ghost["gt_id"] = ""
    b.frame = pd.concat([b.frame, ghost]).sort_values("t", kind="stable").reset_index(drop=True)
    return b.done(f"{lasts:.2f} s, {along:+.2f} {across:+.2f}", "OVERLAP", also=("98",))


def size_changes(b: Bed) -> Plant:
    """Length or width that is 10 to 150 % larger in some rows, from some time on or singly."""
    column, factor = str(b.rng.choice(["length", "width"])), 1.0 + b.between(0.1, 1.5)
    rows = b.own & (b.frame["t"].to_numpy() > b.time())
    if b.rng.random() < 0.5:
        rows = np.isin(np.arange(len(b.frame)), b.rng.choice(np.flatnonzero(b.own), 10, replace=False))
    b.frame.loc[rows, column] *= factor
    return b.done(f"{column} x {factor:.2f}", "SIZE_CHANGES")


def off_map(b: Bed) -> Plant:
    """An object in GT and SD, or all, beside the road: its centre 2.5 to 150 m from any lane."""
    whole, side = b.rng.random() < 0.3, b.sign()
    shift, least = side * b.between(2.5, 150.0), 0.0
    frames = {}
    for _ in range(40):  # outwards until it is beside every lane
        for source in ("gt", "sd"):
            frame = b.of(source).copy()
            rows = np.ones(len(frame), dtype=bool) if whole else (frame["id"] == b.object).to_numpy()
            frame.loc[rows, "y"] += shift
            frames[source] = frame
        own = [f[f["id"].isin(b.ids if whole else [b.object])] for f in frames.values()]
        x, y = (np.concatenate([f[c].to_numpy()[::10] for f in own]) for c in ("x", "y"))
        at = b.network.to_road(x, y)
        beyond = np.abs(at.t) - 0.5 * b.network.lane_width(at.road, at.lane, at.s)
        least = float(np.where(at.on_road, 0.0, beyond).min())
        if least > 2.5:
            break
        shift += side * 3.0
    else:
        raise AgainError
    plant = b.planted(frames, f"{shift:+.1f} m, {least:.1f} m beside", "OFF_MAP")
    return replace(
        plant, named=tuple((s, n) for s in frames for n in (["", *b.ids] if whole else [b.object]))
    )


def wrong_way(b: Bed) -> Plant:
    """An object in GT and SD whose track runs backwards in time, its heading turned."""
    frames = {}
    for source in ("gt", "sd"):
        frame = b.of(source).copy()
        rows = (frame["id"] == b.object).to_numpy()
        for column in VALUES:
            frame.loc[rows, column] = frame.loc[rows, column].to_numpy()[::-1]
        frame.loc[rows, "heading"] = wrap_angle(frame.loc[rows, "heading"] + np.pi)
        frames[source] = frame
    return b.planted(frames, "", "WRONG_WAY")


def reference_point(b: Bed) -> Plant:
    """Front or rear bumper or a corner for the centre: of a whole source, or of one object.

    Of a whole source at steady speeds a delay may explain as much: then one finding says either.
    """
    whole = b.rng.random() < 0.5
    along = b.sign() * 0.5
    across = float(b.rng.choice([-0.5, 0.0, 0.5], p=[0.25, 0.5, 0.25]))
    rows = np.ones(len(b.frame), dtype=bool) if whole else b.own
    h, length, width = (b.frame[c].to_numpy() for c in ("heading", "length", "width"))
    x, y = along * length, across * width
    b.frame["x"] += np.where(rows, x * np.cos(h) - y * np.sin(h), 0.0)
    b.frame["y"] += np.where(rows, x * np.sin(h) + y * np.cos(h), 0.0)
    plant = b.done(f"{along:+g} {across:+g}, whole {whole}", "REFERENCE_POINT", "CLOCK_OFFSET")
    names = ["", *b.ids] if whole else [b.object]
    return replace(plant, named=tuple((s, n) for s in ("gt", "sd", "recording") for n in names))


def speed_unit(b: Bed) -> Plant:
    """km/h or mph, of one object or of all."""
    whole, factor = b.rng.random() < 0.5, float(b.rng.choice([3.6, 2.236936]))
    b.frame.loc[b.own | whole, "v"] *= factor
    return b.done(f"x {factor:.2f}", "SPEED_UNIT", whole=whole)


def heading_unit(b: Bed) -> Plant:
    """Degrees, of one object or of all; somewhere 0.05 rad or more off."""
    whole = b.rng.random() < 0.5
    old = b.frame["heading"].to_numpy()
    new = np.where(b.own | whole, np.degrees(old), old)
    if np.abs(new - old).max() < 0.05:
        raise AgainError
    b.frame["heading"] = new
    plant = b.done("degrees", "HEADING_UNIT", whole=whole)
    return replace(plant, named=tuple((b.source, n) for n in (["", *b.ids] if whole else [b.object])))


def heading_turned(b: Bed) -> Plant:
    """Turned by pi, of one object that drives fast enough not to reverse, or of all."""
    whole = b.rng.random() < 0.5
    if not whole and b.frame.loc[b.own, "v"].median() < 8.5:
        raise AgainError
    b.frame["heading"] += np.where(b.own | whole, b.sign() * np.pi, 0.0)
    return b.done("turned", "HEADING_TURNED", whole=whole)


def heading_convention(b: Bed) -> Plant:
    """From north, clockwise or not, in radians or degrees."""
    sign = b.sign()
    heading = sign * (b.frame["heading"] - 0.5 * np.pi)
    degrees = b.rng.random() < 0.5
    b.frame["heading"] = np.degrees(heading) if degrees else heading
    return b.done(f"from north, sign {sign:+g}, degrees {degrees}", "HEADING_CONVENTION", whole=True)


def size_swapped(b: Bed) -> Plant:
    """Length and width of one object, or of all."""
    whole = b.rng.random() < 0.5
    rows = b.own | whole
    sides = {"length": np.where(rows, b.frame["width"], b.frame["length"])}
    sides["width"] = np.where(rows, b.frame["length"], b.frame["width"])
    b.frame = b.frame.assign(**sides)
    return b.done(f"whole {whole}", "SIZE_SWAPPED", whole=whole)


def mirrored_y(b: Bed) -> Plant:
    """y down in one source or in both, with the heading or without."""
    both, turned = b.rng.random() < 0.5, b.rng.random() < 0.5
    frames = {}
    for source in ("gt", "sd") if both else (b.source,):
        frame = b.of(source).copy()
        frame["y"] = -frame["y"]
        if turned:
            frame["heading"] = -frame["heading"]
        frames[source] = frame
    return b.planted(frames, f"both {both}, heading {turned}", "MIRRORED_Y", whole=True)


def sd_without_gt(b: Bed) -> Plant:
    """An SD object that has lost its GT id, a ghost 15 to 150 m ahead, or one with another's GT id."""
    b.source, b.frame = "sd", b.of("sd").copy()
    b.own = (b.frame["id"] == b.object).to_numpy()
    how = str(b.rng.choice(["lost", "ghost", "other"]))
    if how == "lost":
        b.frame.loc[b.own, "gt_id"] = ""
        return b.done(how, "SD_WITHOUT_GT")
    if how == "ghost":
        ghost = b.frame.loc[b.own].copy()
        ghost["x"] += b.sign() * b.between(15.0, 150.0)
        ghost["id"], ghost["gt_id"] = "97", ""
        b.frame = pd.concat([b.frame, ghost]).sort_values("t", kind="stable").reset_index(drop=True)
        b.object = "97"
        return b.done(how, "SD_WITHOUT_GT")
    others = [i for i in b.ids if i != b.object]
    b.frame.loc[b.own, "gt_id"] = str(b.rng.choice(others))
    return b.done(how, "SD_WITHOUT_GT")


KINDS: dict[str, Callable[[Bed], Plant]] = {
    f.__name__: f
    for f in (
        missing_samples, missing_values, duplicates, repeated_samples, time_backwards, gap, clock_jump,
        clock_drift, clock_offset, sensor_delay, track_shifted, id_reused, id_switch, track_broken,
        position_jump, outlier, speed_disagrees, heading_disagrees, acceleration, yaw_rate, overlap,
        size_changes, off_map, wrong_way, reference_point, speed_unit, heading_unit, heading_turned,
        heading_convention, size_swapped, mirrored_y, sd_without_gt,
    )
}  # fmt: skip


def is_found(plant: Plant, findings: tuple[Finding, ...], known: tuple[Finding, ...]) -> bool:
    """Whether a finding tells the plant that the untouched recording did not have (or not so)."""
    return bool(telling(plant, findings, known))


def telling(plant: Plant, findings: tuple[Finding, ...], known: tuple[Finding, ...]) -> list[Finding]:
    """The findings that tell the plant."""
    before = {(f.code, f.source, f.object): f.value for f in known}
    out = []
    for f in findings:
        if f.code in plant.codes and (f.source, f.object) in plant.named:
            old = before.get((f.code, f.source, f.object))
            if old is None or abs(f.value - old) > 0.2 * abs(old):
                out.append(f)
    return out


class Beds:
    """The recordings that ship, their roads, and what is found in them without a plant."""

    def __init__(self) -> None:
        self.recordings = [read_tables(file.parent) for file in sorted(SCENARIOS.glob("*/recording.toml"))]
        self.networks = [load(tables.map) for tables in self.recordings]
        self.known = [examine(t, n) for t, n in zip(self.recordings, self.networks, strict=True)]

    def planted(self, kind: str, rng: np.random.Generator) -> tuple[int, Plant]:
        """Plant a fault of a kind in a recording that bears it; give which one it is, and the plant."""
        for _ in range(500):
            which = int(rng.integers(len(self.recordings)))
            with suppress(AgainError):
                return which, KINDS[kind](Bed(self.recordings[which], self.networks[which], rng))
        raise SystemExit(f"{kind} cannot be planted")


class Tally:
    """What was found of the plants, what beside them, and what repairs left.

    fix: whether each plant is repaired as well. only: whether one kind alone is asked for.
    """

    def __init__(self, *, fix: bool, only: bool) -> None:
        self.fix, self.only = fix, only
        self.rows: dict[str, list[bool]] = defaultdict(list)
        self.beside: dict[str, list[int]] = defaultdict(list)
        self.remains: dict[str, Remains] = defaultdict(Remains)
        self.crashes, self.misses, self.took = 0, list[str](), 0.0

    def look(self, kind: str, plant: Plant, beds: Beds, which: int) -> None:
        """Examine a recording with a plant, and count."""
        known, network = beds.known[which], beds.networks[which]
        begin = time.perf_counter()
        try:
            findings = examine(plant.tables, network)
        except Exception:
            self.crashes += 1
            self.rows[kind].append(False)
            self.misses.append(f"{kind}: {plant.what}: CRASH {traceback.format_exc()}")
            return
        self.took += time.perf_counter() - begin
        found = is_found(plant, findings, known)
        self.rows[kind].append(found)
        if self.fix and found:
            self._repair(kind, plant, beds.recordings[which], network, telling(plant, findings, known))
        base = {(f.code, f.source, f.object) for f in known}
        new = [f for f in findings if (f.code, f.source, f.object) not in base]
        self.beside[kind].append(sum(f.code not in plant.codes for f in new))
        if not found or (self.only and self.beside[kind][-1]):
            told = "; ".join(f"{f.code} {f.source} {f.object}: {f.text}" for f in new)
            self.misses.append(
                f"{'FOUND' if found else 'MISSED'} {kind}: {plant.what}: found {told or 'nothing'}"
            )

    def _repair(
        self, kind: str, plant: Plant, recording: RecordingTables, network: RoadNetwork, hit: list[Finding]
    ) -> None:
        gone = self.remains[kind].gone
        result = self.remains[kind].add(plant.tables, recording, network, hit)
        if self.remains[kind].gone == gone and any(f.repair for f in hit):
            told = "; ".join(f"{f.code} {f.source} {f.object}: {f.text}" for f in result.left)
            self.misses.append(f"LEFT {kind}: {plant.what}: {told}")

    def show(self, kinds: list[str], count: int, seed: int) -> None:
        """Print the tables."""
        print("| kind | planted | found | share | findings of another code, mean |\n|---|---|---|---|---|")
        for kind in kinds:
            got, all_ = sum(self.rows[kind]), len(self.rows[kind])
            if all_:
                mean = np.mean(self.beside[kind] or [0])
                print(f"| {kind} | {all_} | {got} | {100.0 * got / all_:.1f} % | {mean:.2f} |")
        got = sum(sum(r) for r in self.rows.values())
        more = np.mean([k for v in self.beside.values() for k in v])
        print(f"| **all** | {count} | {got} | {100.0 * got / count:.1f} % | {more:.2f} |")
        print(f"\n{self.crashes} crashes; {1e3 * self.took / count:.0f} ms an examination; seed {seed}")
        if self.fix:
            print(f"\n| kind | {HEAD} |\n|" + "---|" * (HEAD.count("|") + 2))
            for kind in kinds:
                print(f"| {kind} | {self.remains[kind].row(kind)} |")


def main() -> None:
    warnings.simplefilter("error", RuntimeWarning)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int, nargs="?", default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="this kind alone")
    parser.add_argument(
        "--misses", action="store_true", help="print what was not found, and what was instead"
    )
    parser.add_argument("--fix", action="store_true", help="repair each plant as well")
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    beds, tally = Beds(), Tally(fix=arguments.fix, only=bool(arguments.only))
    kinds = [arguments.only] if arguments.only else list(KINDS)
    for n in range(arguments.count):
        kind = kinds[n % len(kinds)]
        which, plant = beds.planted(kind, rng)
        tally.look(kind, plant, beds, which)
    tally.show(kinds, arguments.count, arguments.seed)
    if arguments.misses:
        print("\n".join(tally.misses))


if __name__ == "__main__":
    main()
