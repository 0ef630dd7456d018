"""Recordings made by a known perception model: plain numpy over whole drives, nothing of the runtime in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from resim.core.geometry import Floats
from resim.core.tracks import Tracks
from resim.perception.model import (
    QUANTITIES,
    Averaging,
    Detection,
    Error,
    ErrorModels,
    FieldOfView,
    Latency,
    PerceptionModel,
    Response,
    Spread,
    Update,
)  # fmt: skip
from resim.perception.parts.ego import EgoStateError, Localisation
from resim.perception.parts.false_objects import FalseObjects
from resim.recordings import Recording

BEFORE = 4.0
FINE = 0.01


@dataclass(frozen=True, eq=False)
class Motion:
    """What N vehicles do on a fine grid of time: all (N, F)."""

    t: Floats
    x: Floats
    y: Floats
    heading: Floats
    v: Floats
    a: Floats

    def at(self, name: str, t: Floats) -> Floats:
        return np.stack([np.interp(t, self.t, row) for row in getattr(self, name)])

    def mean(self, name: str, t: Floats, over: float) -> Floats:
        if over <= 0.0:
            return self.at(name, t)
        values = getattr(self, name)
        whole = np.cumsum((values[:, 1:] + values[:, :-1]) * 0.5 * FINE, axis=1)
        whole = np.concatenate([np.zeros((len(whole), 1)), whole], axis=1)
        return np.stack(
            [(np.interp(t + over / 2, self.t, w) - np.interp(t - over / 2, self.t, w)) / over for w in whole]
        )


def drive_about(rng: np.random.Generator, duration: float, objects: int) -> Motion:
    """The EGO (first) and others, with accelerations and lane changes at random times."""
    t = np.arange(-BEFORE, duration + FINE / 2, FINE)
    n = objects + 1
    ego_v = rng.uniform(12.0, 32.0)
    v0 = np.maximum(ego_v + np.append(0.0, rng.normal(0.0, 3.0, objects)), 5.0)
    a = np.zeros((n, len(t)))
    for row in range(n):
        begin = -2.0 + rng.uniform(0.0, 2.0)
        while begin < duration:
            lasts, size = rng.uniform(1.0, 3.0), rng.uniform(-3.0, 2.5)
            if v0[row] + 0.5 * FINE * a[row].sum() + size * lasts < 4.0:
                size = abs(size)
            a[row] += size * np.clip(np.minimum((t - begin) / 0.4, (begin + lasts - t) / 0.4), 0.0, 1.0)
            begin += lasts + rng.uniform(0.3, 2.5)
    v = np.maximum(v0[:, None] + np.cumsum(a, axis=1) * FINE, 2.0)
    lane = 3.5 * rng.integers(-1, 2, objects) + rng.uniform(-0.5, 0.5, objects)
    y = np.repeat(np.append(0.0, lane)[:, None], len(t), axis=1)
    for row in range(1, n):
        u = np.clip((t - rng.uniform(0.0, 7.0)) / rng.uniform(2.5, 4.5), 0.0, 1.0)
        side = rng.choice([-3.5, 0.0, 3.5]) if abs(y[row, 0]) < 1.0 else -3.5 * np.sign(y[row, 0])
        y[row] += side * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    start = np.append(0.0, rng.uniform(-40.0, 90.0, objects))
    rate = np.gradient(y, FINE, axis=1)
    heading = np.arcsin(np.clip(rate / v, -0.9, 0.9))
    steps = np.cumsum(v * np.cos(heading) * FINE, axis=1)
    now = round(BEFORE / FINE)
    x = start[:, None] + steps - steps[:, now : now + 1]
    return Motion(t, x, y, heading, v, np.gradient(v, FINE, axis=1))


def tracks_of(motion: Motion, t: Floats, noise: float, rng: np.random.Generator) -> Tracks:
    n = len(motion.x)
    shape = (n, len(t))
    return Tracks(
        t=t, ids=np.array(["ego", *(str(k) for k in range(1, n))]), kind=np.full(n, "car"),
        x=motion.at("x", t) + noise * rng.standard_normal(shape),
        y=motion.at("y", t) + noise * rng.standard_normal(shape),
        heading=motion.at("heading", t), v=motion.at("v", t), length=np.full(n, 4.7), width=np.full(n, 1.9),
        valid=np.ones(shape, dtype=bool),
    )  # fmt: skip


@dataclass(frozen=True)
class Beyond:
    """What a perception model cannot say: white noise as Student's t of so many degrees of freedom, of the same
    variance; a latency that varies by so much [s], with this correlation time [s] (0: from list to list); a scale of
    speeds; offsets by quantity while an object brakes; level: a factor of every spread. found: objects are not seen at
    first, and then found with this probability a list, within 60 m, and kept; confirmed: within 60 m for so long [s]
    before they are seen. drive: offsets by quantity that all objects of a drive share, normal of this standard
    deviation from drive to drive. weather: standard deviation of the logarithm of a factor of every spread from drive
    to drive. blind: nobody is seen for 0.8 s, so often [1/s]. bend: by quantity, an error that grows with the square of
    range, of so much at 120 m. side: by quantity, an error of so much more on the left than on the right."""

    tails: float = 0.0
    late: float = 0.0
    late_time: float = 0.0
    scale: float = 0.0
    braking: tuple[tuple[str, float], ...] = ()
    level: float = 1.0
    found: float = 0.0
    confirmed: float = 0.0
    drive: tuple[tuple[str, float], ...] = ()
    weather: float = 0.0
    blind: float = 0.0
    bend: tuple[tuple[str, float], ...] = ()
    side: tuple[tuple[str, float], ...] = ()

    def finds(self, r: Floats, dt: float, rng: np.random.Generator) -> np.ndarray:
        """Which object is seen when (N, K), by how far it is."""
        near = r <= 60.0
        if self.blind > 0.0:
            begins = rng.random(r.shape[1]) < self.blind * dt
            return np.broadcast_to(np.convolve(begins, np.ones(round(0.8 / dt)))[: r.shape[1]] == 0, r.shape)
        if self.found > 0.0:
            return np.logical_or.accumulate(near & (rng.random(r.shape) < self.found), axis=1)
        return np.cumsum(near, axis=1) * dt >= self.confirmed

    def lateness(self, n: int, dt: float, rng: np.random.Generator) -> Floats:
        """Latency beyond the usual one (n,) [s]."""
        if self.late == 0.0:
            return np.zeros(n)
        keep = np.exp(-dt / self.late_time) if self.late_time > 0.0 else 0.0
        z = rng.standard_normal(n)
        for k in range(1, n):
            z[k] = keep * z[k - 1] + np.sqrt(1.0 - keep**2) * z[k]
        return self.late * z

    def white(self, shape: tuple[int, ...], rng: np.random.Generator) -> Floats:
        """White noise of unit variance."""
        if self.tails == 0.0:
            return rng.standard_normal(shape)
        return rng.standard_t(self.tails, shape) * np.sqrt(1.0 - 2.0 / self.tails)

    def offsets(self, v: Floats, f: Floats, rng: np.random.Generator) -> dict[str, Floats]:
        """Errors (N, K) by quantity, of true speeds and features (4, N, K)."""
        r, b, _, a = f
        out = {name: offset * (a < -1.0) for name, offset in self.braking}
        out |= {name: np.full_like(v, spread * rng.standard_normal()) for name, spread in self.drive}
        out |= {name: size * (r / 120.0) ** 2 for name, size in self.bend}
        out |= {name: size * (b > 0.0) for name, size in self.side}
        out["speed"] = out.get("speed", 0.0) + self.scale * v
        return out


def response(r: Response, f: Floats) -> Floats:
    return r.constant + r.range * f[0] + r.bearing * f[1] + r.relative_speed * f[2] + r.acceleration * f[3]


def spread(s: Spread, f: Floats) -> Floats:
    g = np.abs(f)
    return s.constant * np.exp(
        s.range * g[0] + s.bearing * g[1] + s.relative_speed * g[2] + s.acceleration * g[3]
    )


def wander(
    tau: Floats, coupling: Floats, shape: tuple[int, int], dt: float, rng: np.random.Generator
) -> Floats:
    """Unit drifts (6, N, K) whose driving noises have this correlation."""
    both = 2.0 * np.sqrt(np.outer(tau, tau)) / (tau[:, None] + tau[None, :])
    stationary = coupling * both
    keep = np.exp(-dt / tau)
    driving = stationary * (1.0 - np.outer(keep, keep))
    first, more = (np.linalg.cholesky(c + 1e-12 * np.eye(6)) for c in (stationary, driving))
    out = np.empty((6, *shape))
    out[..., 0] = first @ rng.standard_normal((6, shape[0]))
    for k in range(1, shape[1]):
        out[..., k] = keep[:, None] * out[..., k - 1] + more @ rng.standard_normal((6, shape[0]))
    return out


def detected(model: PerceptionModel, r: Floats, b: Floats, dt: float, rng: np.random.Generator) -> np.ndarray:
    """Which object is detected when (N, K); by range and bearing, one bin of occlusion."""
    d = model.detection
    out = np.ones(r.shape, dtype=bool)
    if d.loss:
        i = np.clip(np.searchsorted(d.range_edges, r, side="right") - 1, 0, len(d.range_edges) - 2)
        j = np.clip(np.searchsorted(d.bearing_edges, b, side="right") - 1, 0, len(d.bearing_edges) - 2)
        loss, gain = np.array(d.loss)[i, j, 0], np.array(d.gain)[i, j, 0]
        share, stays = gain / (gain + loss), np.exp(-(gain + loss) * dt)
        out[:, 0] = rng.random(len(r)) < share[:, 0]
        for k in range(1, r.shape[1]):
            p = share[:, k] + (out[:, k - 1] - share[:, k]) * stays[:, k]
            out[:, k] = rng.random(len(r)) < p
    view = model.field_of_view
    out &= r <= (view.range or np.inf)
    out &= b <= (view.bearing or np.inf)
    return out


def make_recording(
    model: PerceptionModel, seed: int, *, duration: float = 10.0, rate: float = 25.0, objects: int | None = None,
    noise: float = 0.0, name: str | None = None, named: bool = True, beyond: Beyond = Beyond(),
) -> Recording:  # fmt: skip
    """One drive with 3 to 5 traffic objects, perceived by the model (pooled parameters), and what is beyond it."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 6)) if objects is None else objects
    motion = drive_about(rng, duration, count)
    dt = 1.0 / rate
    t = np.round(np.arange(0.0, duration + 1e-9, dt), 6)
    gt = tracks_of(motion, t, noise, rng)
    lists = t
    if model.update.period > 0.0:
        due = np.cumsum(
            np.maximum(model.update.period + model.update.jitter * rng.standard_normal(len(t)), 1e-3)
        )
        lists = np.round(due[due < duration], 6)
    dt = float(np.diff(lists).mean())
    ego = {k: motion.at(k, lists)[0] for k in ("x", "y", "heading", "v")}
    late, over = model.latency, model.averaging
    c, s = np.cos(ego["heading"]), np.sin(ego["heading"])
    now = lists - beyond.lateness(len(lists), dt, rng)
    dx, dy = (motion.at(k, now - late.position)[1:] - ego[k] for k in ("x", "y"))
    x, y = c * dx + s * dy, c * dy - s * dx
    v = motion.mean("v", now - late.speed, over.speed)[1:]
    heading = motion.mean("heading", now - late.heading, over.heading)[1:] - ego["heading"]
    a = motion.at("a", now - late.speed)[1:]
    f = np.stack([np.hypot(x, y), np.arctan2(y, x), v * np.cos(heading) - ego["v"], a])
    seen = detected(model, f[0], np.abs(f[1]), dt, rng)
    if beyond.found > 0.0 or beyond.confirmed > 0.0 or beyond.blind > 0.0:
        seen &= beyond.finds(f[0], dt, rng)
    each = [getattr(model.errors, q) for q in QUANTITIES]
    coupling = np.eye(6) if model.errors.coupling is None else np.array(model.errors.coupling)
    z = wander(np.array([e.correlation_time for e in each]), coupling, x.shape, dt, rng)
    w = beyond.white((6, *x.shape), rng)
    offsets = beyond.offsets(v, f, rng)
    level = beyond.level * (np.exp(beyond.weather * rng.standard_normal()) if beyond.weather else 1.0)
    errors = [
        response(e.bias, f)
        + level * (spread(e.drift, f) * z[q] + spread(e.noise, f) * w[q])
        + offsets.get(QUANTITIES[q], 0.0)
        for q, e in enumerate(each)
    ]
    x, y, v, heading = x + errors[0], y + errors[1], v + errors[2], heading + errors[3]
    own = _own(model, len(lists), dt, rng)
    px, py = ego["x"] + c * own[0] - s * own[1], ego["y"] + s * own[0] + c * own[1]
    ph, pv = ego["heading"] + own[2], ego["v"] + own[3]
    c, s = np.cos(ph), np.sin(ph)
    mx, my = px + c * x - s * y, py + s * x + c * y
    rows = [("ego", px, py, ph, pv, np.ones(len(lists), dtype=bool), "ego")]
    for n in range(count):
        number = np.cumsum(rng.random(len(lists)) < model.id_switch * dt)
        for part in range(int(number[-1]) + 1):
            here = seen[n] & (number == part)
            if here.any():
                rows.append((f"{n + 1}.{part}", mx[n], my[n], heading[n] + ph, v[n], here, str(n + 1)))
    rows += _false(model, lists, px, py, ph, rng)
    valid = np.array([r[5] for r in rows])
    sd = Tracks(
        t=lists, ids=np.array([r[0] for r in rows]), kind=np.full(len(rows), "car"),
        x=np.where(valid, [r[1] for r in rows], np.nan), y=np.where(valid, [r[2] for r in rows], np.nan),
        heading=np.where(valid, [r[3] for r in rows], np.nan), v=np.where(valid, [r[4] for r in rows], np.nan),
        length=np.full(len(rows), 4.7), width=np.full(len(rows), 1.9), valid=valid,
    )  # fmt: skip
    return Recording(
        name=name or f"drive_{seed}", map=Path("none.xodr"), ego="ego", gt=gt, gt_rate=rate, sd=sd, sd_rate=1.0 / dt,
        sd_gt_id=np.array([r[6] for r in rows]) if named else None,
    )  # fmt: skip


def _own(model: PerceptionModel, k: int, dt: float, rng: np.random.Generator) -> Floats:
    out = np.empty((4, k))
    for row, name in enumerate(("longitudinal", "lateral", "heading", "speed")):
        e = getattr(model.ego, name)
        keep, z = np.exp(-dt / e.correlation_time), rng.standard_normal(k)
        for i in range(1, k):
            z[i] = keep * z[i - 1] + np.sqrt(1.0 - keep**2) * z[i]
        out[row] = e.bias + e.drift * z + e.noise * rng.standard_normal(k)
    return out


def _false(
    model: PerceptionModel, t: Floats, px: Floats, py: Floats, ph: Floats, rng: np.random.Generator
) -> list[tuple[str, Floats, Floats, Floats, Floats, np.ndarray, str]]:
    """Objects that are not there, as they come and go during the drive."""
    f, out = model.false_objects, []
    for number in range(rng.poisson(f.rate * (t[-1] + 5.0 * f.lifetime)) if f.rate else 0):
        since = rng.uniform(-5.0 * f.lifetime, t[-1])
        here = (t >= since) & (t < since + rng.exponential(f.lifetime))
        r, b, v = (
            rng.uniform(0, f.range),
            rng.uniform(-f.bearing, f.bearing),
            rng.normal(f.speed, f.speed_spread),
        )
        if here.any():
            k = int(np.argmax(here))
            x, y = (
                p[k] + r * g(ph[k] + b) + v * g(ph[k]) * (t - t[k]) for p, g in ((px, np.cos), (py, np.sin))
            )
            out.append((f"false{number}", x, y, np.full(len(t), ph[k]), np.full(len(t), v), here, ""))
    return out


def drives(model: PerceptionModel, seed: int, count: int = 20, **how: float) -> list[Recording]:
    """`count` drives of 10 s at 25 Hz."""
    return [make_recording(model, 1000 * seed + k, **how) for k in range(count)]  # type: ignore[arg-type]


CORRELATED = np.eye(6)
CORRELATED[0, 1] = CORRELATED[1, 0] = 0.4
CORRELATED[0, 2] = CORRELATED[2, 0] = 0.6

DETECTION = Detection(
    range_edges=(0.0, 30.0, 60.0, 150.0), bearing_edges=(0.0, 3.2), occlusion_edges=(0.0, 1.0),
    loss=(((0.2,),), ((1.0,),), ((4.0,),)), gain=(((20.0,),), ((16.0,),), ((12.0,),)),
)  # fmt: skip

KNOWN = {
    "latency": PerceptionModel(name="latency", latency=Latency(position=0.1, speed=0.35, heading=0.5)),
    "noise": PerceptionModel(
        name="noise",
        latency=Latency(position=0.05, speed=0.3, heading=0.2),
        errors=ErrorModels(
            longitudinal=Error(
                bias=Response(constant=0.5, range=0.01), noise=Spread(constant=0.1, range=0.01)
            ),
            lateral=Error(bias=Response(bearing=0.2), noise=Spread(constant=0.1)),
            speed=Error(bias=Response(constant=-0.3), noise=Spread(constant=0.2, relative_speed=0.05)),
            heading=Error(noise=Spread(constant=0.01)),
        ),
    ),
    "drift": PerceptionModel(
        name="drift",
        latency=Latency(position=0.1, speed=0.8, heading=0.8),
        averaging=Averaging(speed=1.2, heading=1.2),
        errors=ErrorModels(
            longitudinal=Error(
                bias=Response(constant=1.5), drift=Spread(constant=0.25), correlation_time=0.5,
                noise=Spread(constant=0.03),
            ),
            lateral=Error(drift=Spread(constant=0.1), correlation_time=0.3, noise=Spread(constant=0.03)),
            speed=Error(drift=Spread(constant=0.15), correlation_time=0.3, noise=Spread(constant=0.05)),
            heading=Error(drift=Spread(constant=0.005), correlation_time=0.4, noise=Spread(constant=0.002)),
            coupling=tuple(map(tuple, CORRELATED.tolist())),
        ),
    ),
    "detection": PerceptionModel(name="detection", detection=DETECTION),
    "everything": PerceptionModel(
        name="everything",
        latency=Latency(position=0.08, speed=0.6, heading=0.4),
        averaging=Averaging(speed=0.8, heading=0.5),
        errors=ErrorModels(
            longitudinal=Error(
                bias=Response(constant=1.0, range=0.005), drift=Spread(constant=0.2, range=0.005),
                correlation_time=0.6, noise=Spread(constant=0.05),
            ),
            lateral=Error(
                bias=Response(constant=0.1, bearing=0.05), drift=Spread(constant=0.1), correlation_time=0.8,
                noise=Spread(constant=0.03),
            ),
            speed=Error(
                bias=Response(constant=-0.2), drift=Spread(constant=0.3), correlation_time=0.5,
                noise=Spread(constant=0.05),
            ),
            heading=Error(drift=Spread(constant=0.01), correlation_time=0.4, noise=Spread(constant=0.003)),
            coupling=tuple(map(tuple, CORRELATED.tolist())),
        ),
        detection=DETECTION,
        field_of_view=FieldOfView(range=90.0),
        update=Update(period=0.05, jitter=0.004),
        id_switch=0.2,
        false_objects=FalseObjects(rate=0.5, lifetime=0.6, range=70.0, bearing=0.4, speed=20.0, speed_spread=4.0),
        ego=Localisation(
            longitudinal=EgoStateError(bias=-0.1, noise=0.05),
            lateral=EgoStateError(bias=0.19, drift=0.05, correlation_time=1.0, noise=0.02),
            speed=EgoStateError(bias=0.04, noise=0.04),
        ),
    ),
}  # fmt: skip
"""Models to recover."""


def parameter(model: PerceptionModel, name: str) -> float:
    """A parameter by its dotted name."""
    value: object = model
    for part in name.split("."):
        value = value[int(part)] if part.isdigit() else getattr(value, part)  # type: ignore[index]
    return float(value)  # type: ignore[arg-type]
