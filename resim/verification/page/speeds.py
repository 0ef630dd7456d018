"""The EGO's speed over time in every drive of a recording, measured and simulated, or with two builds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from resim.core.geometry import Floats
from resim.report.markup import Markup, html, join
from resim.verification.page.axes import Axes, array
from resim.verification.page.cells import Entry

LEAST = 2.0
"""m/s that the axis spans at least, so that noise looks like it."""
MODEL = "rGT+M"
DRIVES = {"GT": "gt", "rGT": "rgt", "rSD": "rsd"}
"""Drives with a curve of their own, and their look (verification.css)."""

Curves = Mapping[str, Floats]
"""Speeds [m/s] by drive, each (K,) or, over seeds, (seeds, K)."""


def measured_figure(name: str, entry: Entry, traces: Mapping[str, Any]) -> Markup:
    """Give the figure of a recording's drives: GT, rGT, rSD, and the range and median with the perception model."""
    t, curves = _curves(traces)
    axes = _axes(t, curves)
    drawn = _band(axes, t, curves[MODEL], "m") if MODEL in curves else Markup()
    drawn += join(axes.line(t, curves[k], css) for k, css in DRIVES.items() if k in curves)
    drawn += join(_first_braking(axes, t, curves, entry["reaction"]))
    if entry["cause"] is not None:
        drawn += _first_difference(axes, entry["cause"]["t"])
    keys = [_key(k, css) for k, css in DRIVES.items() if k in curves]
    if MODEL in curves:
        keys.append(_key(f"{MODEL}: median and range of {len(curves[MODEL])} seeds", "m"))
    keys.append(_key("first braking", "dot"))
    return _figure(axes.svg(drawn, f"Speed of the EGO, {name}"), keys)


def builds_figure(name: str, entry: Entry, traces: Mapping[str, Any], labels: Mapping[str, str]) -> Markup:
    """Give the figure of GT and of the EGO with both builds. labels: the builds', of "before" and "now"."""
    found = {which: _curves(traces[which]) for which in labels}
    t, measured = found["now"]
    runs = {which: curves.get(MODEL, curves.get("rGT")) for which, (_, curves) in found.items()}
    known = {which: speeds for which, speeds in runs.items() if speeds is not None}
    axes = _axes(t, {"GT": measured["GT"], **known})
    drawn = axes.line(t, measured["GT"], "thin")
    for which, speeds in known.items():
        drawn += _band(axes, found[which][0], np.atleast_2d(speeds), which)
    drawn += join(_first_braking(axes, t, known, entry["reaction"]))
    drawn += _first_difference(axes, entry["t"])
    seeds = {which: f", {len(s)} seeds" if s.ndim == 2 else "" for which, s in known.items()}
    keys = [_key(f"{labels[which]} ({which}{text})", which) for which, text in seeds.items()]
    return _figure(
        axes.svg(drawn, f"Speed of the EGO, {name}"),
        [*keys, _key("GT", "thin"), _key("first braking", "dot")],
    )


def _curves(traces: Mapping[str, Any]) -> tuple[Floats, dict[str, Floats]]:
    """The times [s] (K,) and the speeds [m/s] by drive."""
    out = {k: array(traces[k]) for k in ("GT", "rGT", "rSD") if k in traces}
    if traces.get(MODEL):
        out[MODEL] = np.stack([array(one) for one in traces[MODEL]])
    return array(traces["t"]), out


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


def _first_braking(axes: Axes, t: Floats, curves: Curves, reaction: Mapping[str, Any]) -> list[Markup]:
    """A dot on each curve where the EGO first brakes; over seeds at the median time of those that do."""
    out = []
    for drive, speeds in curves.items():
        known = [v for v in _each(reaction.get(drive)) if v is not None]
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


def _each(found: Any) -> Sequence[float | None]:
    return found if isinstance(found, list) else [found]


def _first_difference(axes: Axes, t: float | None) -> Markup:
    return Markup() if t is None else axes.mark(t, f"first difference {t:.1f} s")


def _key(text: str, css: str) -> Markup:
    return html('<span class="k {}">{}</span>', css, text)


def _figure(svg: Markup, keys: Sequence[Markup]) -> Markup:
    return html('<figure class="small"><figcaption>{}</figcaption>{}</figure>', join(keys), svg)
