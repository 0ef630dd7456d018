"""The spline fit against the fit as published, on the same traces in one process.

As published (Wagner 2021, Eq. 5.1-5.5): knot times and values of both splines go to
`scipy.optimize.minimize`, L-BFGS-B with a numeric gradient, as many evaluations as it wants, and a wall
where Eq. 5.5 is broken; a segment is added until the gain is under 2 %.

    python tools/bench/fit.py [--quick]
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize

from resim.scenario.fit import GAIN, fit_trace
from resim.scenario.kernel import MIN_SEGMENT


def cut_in_and_brake(noise: float, *, seed: int = 0) -> tuple[np.ndarray, ...]:
    """A 9.2 s trace at 25 Hz: t, x, y, heading, v; positions with white noise [m]."""
    fine = np.linspace(0.0, 9.2, 9201)
    a = np.interp(fine, [0.0, 4.0, 4.4, 8.0, 8.4, 9.2], [0.0, 0.0, -4.0, -4.0, 0.0, 0.0])
    v = 32.5 + cumulative_trapezoid(a, fine, initial=0.0)
    u = np.clip((fine - 2.0) / 3.0, 0.0, 1.0)
    heading = 0.18 + np.gradient(-3.5 * (10 * u**3 - 15 * u**4 + 6 * u**5), fine) / v
    x = cumulative_trapezoid(v * np.cos(heading), fine, initial=0.0)
    y = cumulative_trapezoid(v * np.sin(heading), fine, initial=0.0)
    every = slice(None, None, 40)
    rng = np.random.default_rng(seed)
    noisy = [c[every] + noise * rng.standard_normal(len(fine[every])) for c in (x, y)]
    return fine[every], *noisy, heading[every], v[every]


def published(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, heading: np.ndarray, v: np.ndarray
) -> tuple[float, int]:
    """Mean error [m] and number of segments of the fit as published."""
    error, n = np.inf, 1
    while True:
        knots = np.linspace(t[0], t[-1], n + 1)
        start = [knots[1:-1], np.interp(knots, t, v), knots[1:-1], np.interp(knots, t, np.unwrap(heading))]

        def mean_distance(p: np.ndarray, n: int = n) -> float:
            tv, pv, th, ph = np.split(p, [n - 1, 2 * n, 3 * n - 1])
            tv, th = (np.concatenate([t[:1], inner, t[-1:]]) for inner in (tv, th))
            if min(np.diff(tv).min(), np.diff(th).min()) < MIN_SEGMENT:
                return 1e3
            speed, angle = (
                CubicSpline(tv, pv, bc_type="natural")(t),
                CubicSpline(th, ph, bc_type="natural")(t),
            )
            dx = x[0] + cumulative_trapezoid(speed * np.cos(angle), t, initial=0.0) - x
            dy = y[0] + cumulative_trapezoid(speed * np.sin(angle), t, initial=0.0) - y
            return float(np.hypot(dx, dy).mean())

        found = minimize(
            mean_distance,
            np.concatenate(start),
            method="L-BFGS-B",
            options={"maxfun": 10**6, "maxiter": 10**5},
        )
        if found.fun > (1.0 - GAIN) * error:
            return min(error, float(found.fun)), n
        error, n = float(found.fun), n + 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one trace instead of two")
    quick = parser.parse_args().quick
    rows = []
    for noise in (0.01,) if quick else (0.0, 0.01):
        trace = cut_in_and_brake(noise)
        begin = time.process_time()
        old_error, old_segments = published(*trace)
        old = time.process_time() - begin
        fit_trace(*trace)
        begin = time.process_time()
        for _ in range(20):
            new_fit = fit_trace(*trace)
        new = (time.process_time() - begin) / 20
        rows.append(
            (
                noise,
                old,
                old_error,
                old_segments,
                new,
                float(new_fit.distance.mean()),
                len(new_fit.trace.v.x) - 1,
            )
        )
    print(
        "noise [m]   as published: CPU [s]  error [m]  segments   here: CPU [s]  error [m]  segments   speedup"
    )
    for noise, old, oe, os_, new, ne, ns in rows:
        print(f"{noise:9.3f} {old:22.2f} {oe:10.4f} {os_:9d} {new:15.4f} {ne:10.4f} {ns:9d} {old / new:9.0f}")
    worst_speedup = min(r[1] / r[4] for r in rows)
    worst_error = max(r[5] / r[2] for r in rows)
    print(json.dumps({"speedup": round(worst_speedup, 1), "error_ratio": round(worst_error, 4)}))


if __name__ == "__main__":
    main()
