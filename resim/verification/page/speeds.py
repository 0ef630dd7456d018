"""The EGO's speed over time in every drive of a recording, measured and simulated, or with two builds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from resim.core.geometry import Floats
from resim.report.markup import Markup, html, join
from resim.resimulation.traces import SpeedTraces
from resim.verification.cases import BuildTraces
from resim.verification.entries import MODEL, ReactionsOfBuilds
from resim.verification.page.axes import Axes, array

LEAST = 2.0
"""m/s that the axis spans at least, so that noise looks like it."""
DRIVES = {"GT": "gt", "rGT": "rgt", "rSD": "rsd"}
"""Drives with a curve of their own, and their look (verification.css)."""

Curves = Mapping[str, Floats]
"""Speeds [m/s] by drive, each (K,) or, over seeds, (seeds, K)."""
Reactions = Mapping[str, Sequence[float | None]]
"""First braking [s] by drive, of each run."""


def measured_figure(name: str, reactions: Reactions, since: float | None, traces: SpeedTraces) -> Markup:
    """Give the figure of a recording's drives: GT, rGT, rSD, and the range and median with the perception model.

    since: when [s] the first difference shows, None where none does.
    """
    t, curves = _curves(traces)
    axes = _axes(t, curves)
    drawn = _band(axes, t, curves[MODEL], "m") if MODEL in curves else Markup()
    drawn += join(axes.line(t, curves[k], css) for k, css in DRIVES.items() if k in curves)
    drawn += join(_first_braking(axes, t, curves, reactions)) + _first_difference(axes, since)
    keys = [_key(k, css) for k, css in DRIVES.items() if k in curves]
    if MODEL in curves:
        keys.append(_key(f"{MODEL}: median and range of {len(curves[MODEL])} seeds", "m"))
    keys.append(_key("first braking", "dot"))
    return _figure(axes.svg(drawn, f"Speed of the EGO, {name}"), keys)


def builds_figure(
    name: str,
    reactions: ReactionsOfBuilds,
    since: float | None,
    traces: BuildTraces,
    labels: Mapping[str, str],
) -> Markup:
    """Give the figure of GT and of the EGO with both builds. labels: the builds', of "before" and "now"."""
    found = {"before": _curves(traces.before), "now": _curves(traces.now)}
    t, measured = found["now"]
    runs = {which: curves.get(MODEL, curves.get("rGT")) for which, (_, curves) in found.items()}
    known = {which: speeds for which, speeds in runs.items() if speeds is not None}
    axes = _axes(t, {"GT": measured["GT"], **known})
    drawn = axes.line(t, measured["GT"], "thin")
    for which, speeds in known.items():
        drawn += _band(axes, found[which][0], np.atleast_2d(speeds), which)
    each = {"before": reactions.before, "now": reactions.now}
    drawn += join(_first_braking(axes, t, known, each)) + _first_difference(axes, since)
    seeds = {which: f", {len(s)} seeds" if s.ndim == 2 else "" for which, s in known.items()}
    keys = [_key(f"{labels[which]} ({which}{text})", which) for which, text in seeds.items()]
    return _figure(
        axes.svg(drawn, f"Speed of the EGO, {name}"),
        [*keys, _key("GT", "thin"), _key("first braking", "dot")],
    )


def _curves(traces: SpeedTraces) -> tuple[Floats, dict[str, Floats]]:
    """The times [s] (K,) and the speeds [m/s] by drive."""
    out = {drive: array(speeds) for drive, speeds in traces.single().items()}
    if traces.over_seeds:
        out[MODEL] = np.stack([array(one) for one in traces.over_seeds])
    return array(traces.t), out


def _axes(t: Floats, curves: Curves) -> Axes:
    every = np.concatenate([speeds.ravel() for speeds in curves.values()])
    every = every[np.isfinite(every)] if np.isfinite(every).any() else np.zeros(1)
    low, high = float(every.min()), float(every.max())
    more = max(0.06 * (high - low), 0.5 * (LEAST - (high - low)))
    return Axes((float(t[0]), max(float(t[-1]), float(t[0]) + 0.1)), (low - more, high + more), "v [m/s]")


def _band(axes: Axes, t: Floats, speeds: Floats, css: str) -> Markup:
    """The range of the runs and their median; speeds (runs, K)."""
    there = np.isfinite(speeds).any(axis=0)
    if not there.any():
        return Markup()
    low, middle, high = (np.full(len(t), np.nan) for _ in range(3))
    low[there], middle[there], high[there] = np.nanquantile(speeds[:, there], [0.0, 0.5, 1.0], axis=0)
    area = axes.band(t, low, high, f"area {css}") if len(speeds) > 1 else Markup()
    return area + axes.line(t, middle, css)


def _first_braking(axes: Axes, t: Floats, curves: Curves, reactions: Reactions) -> list[Markup]:
    """A dot on each curve where the EGO first brakes; over seeds at the median time of those that do."""
    out = []
    for drive, speeds in curves.items():
        known = [v for v in reactions.get(drive, ()) if v is not None]
        if not known:
            continue
        at = float(np.median(known))
        every = np.atleast_2d(speeds)
        values = [np.interp(at, t, one, left=np.nan, right=np.nan) for one in every]
        if np.isfinite(values).any():
            out.append(
                axes.dot(at, float(np.nanmedian(values)), DRIVES.get(drive, "m" if drive == MODEL else drive))
            )
    return out


def _first_difference(axes: Axes, t: float | None) -> Markup:
    return Markup() if t is None else axes.mark(t, f"first difference {t:.1f} s")


def _key(text: str, css: str) -> Markup:
    return html('<span class="k {}">{}</span>', css, text)


def _figure(svg: Markup, keys: Sequence[Markup]) -> Markup:
    return html('<figure class="small"><figcaption>{}</figcaption>{}</figure>', join(keys), svg)
