"""Tables of an EGO that drives at 20 m/s, and of who is beside or before it."""

from __future__ import annotations

import numpy as np
import pandas as pd

T = np.round(np.arange(0.0, 9.01, 0.04), 2)
V, HIT = 20.0, 4.765
"""m/s; s when the EGO's front comes to the rear of who stands at 400 m."""


def rows(name, x, y=-5.25, v=0.0, **columns):
    return pd.DataFrame(
        {
            "t": T,
            "id": name,
            "x": x,
            "y": y,
            "heading": 0.0,
            "v": v,
            "length": 4.7,
            "width": 1.9,
            "kind": "car",
            **columns,
        }
    )


def ego(y=-5.25):
    return rows("ego", 300.0 + V * T, y, V)


def standing():
    return rows("1", 400.0)


def braking(start):
    """Who is 40 m ahead at the EGO's speed, and brakes to a stop at 6 m/s² from `start` [s] on."""
    tau = np.clip(T - start, 0.0, V / 6.0)
    return rows("1", 340.0 + V * np.minimum(T, start) + V * tau - 3.0 * tau**2, v=V - 6.0 * tau)


def lead_that_is_lost(start=3.0):
    """Who is 55 m ahead and a little faster, and would be hit after he brakes to a stop from `start` [s] on."""
    return braking(start).assign(x=lambda car: car.x + 15.0 + 0.01 * V * T, v=lambda car: car.v + 0.01 * V)


def under(car, *spans):
    """Seen from one time to the next under one id after the other: (id, from, to) [s]."""
    return [car[(start <= car.t) & (car.t < end)].assign(id=name) for name, start, end in spans]


def aside(car, by, *at):
    return car.assign(y=car.y + sum(np.where(when <= car.t, by, 0.0) for when in at))


def held(car, since, *columns, noise=0.0):
    """Places that stay as they were, but for noise [m], while all else goes on."""
    rng = np.random.default_rng(1)
    fixed = {
        c: car[c].mask(car.t > since).ffill() + (car.t > since) * noise * rng.normal(size=len(T))
        for c in columns
    }
    return car.assign(**fixed)


def across(**columns):
    """A truck that stands beside the EGO's lane and reaches into it."""
    truck = rows("1", 400.0, 0.0, length=12.0, width=2.5, kind="truck")
    return truck.assign(**{"heading": np.pi / 2, **columns})


def noisy(car, sigma=0.05, heading=0.0):
    rng = np.random.default_rng(7)
    return car.assign(
        x=car.x + sigma * rng.normal(size=len(car)), y=car.y + sigma * rng.normal(size=len(car)),
        heading=car.heading + heading * rng.normal(size=len(car)),
    )  # fmt: skip
