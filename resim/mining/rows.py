"""Maneuvers and scenarios as tables: the one place that says their columns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from resim.mining.extraction import ExtractedScenario, tag
from resim.mining.features import Features
from resim.mining.maneuver import LabelledManeuver

MANEUVER_COLUMNS = (
    "recording", "object", "label", "start", "end", "t", "partner", "kind", "partner_kind", "lane_from", "lane_to",
    "x_from", "y_from", "x_to", "y_to",
)  # fmt: skip
"""Of maneuvers.parquet, before the figures: start, end, t [s] on the recording's clock; kinds of object and partner;
lanes as road/lane, and places [m] in the map's frame, at the first and the last sample."""
FIGURES = (
    "lanes", "duration_s", "most_across_mps", "v_mps", "ttc_s", "thw_s", "distance_m", "closing_mps", "required_m",
    "share", "limit_mps", "over_mps", "a_mps2", "v_start_mps", "v_end_mps", "turned_rad", "v_passed_mps", "swing_m",
    "turns", "relative_speed_mps", "slip_rad",
)  # fmt: skip
"""Figures of labels that ship; those of one's own come after them."""
SCENARIO_COLUMNS = (
    "scenario", "recording", "ego", "start", "end", "ego_start", "ego_end", "duration", "road", "along_s", "lanes",
    "vehicles", "tag", "labels", "members", "triggers", "least_ttc_s", "least_thw_s", "least_gap_m",
    "most_braking_mps2", "folder", "jscen", "note",
)  # fmt: skip
"""Of scenarios.parquet: start, end [s] of the window, ego_start, ego_end [s] of the EGO's life in it; labels, members:
names with spaces between; triggers: how many maneuvers it is cut out for."""


def maneuver_frame(recording: str, features: Features, maneuvers: Sequence[LabelledManeuver]) -> pd.DataFrame:
    """Give a row per maneuver, with MANEUVER_COLUMNS and the figures, NaN where a label has none."""
    samples = features.samples
    ids, kinds = samples.tracks.ids.tolist(), samples.tracks.kind.tolist()
    ends = np.array([(m.start, m.end, m.at) for m in maneuvers], dtype=np.intp).reshape(-1, 3)
    start, end, t = (samples.t[ends[:, k]] for k in range(3))
    own = dict.fromkeys(name for m in maneuvers for name in m.figures if name not in FIGURES)
    table: dict[str, object] = {
        "recording": [recording] * len(maneuvers),
        "object": [ids[m.object] for m in maneuvers],
        "label": [m.label for m in maneuvers],
        "start": start, "end": end, "t": t,
        "partner": ["" if m.partner < 0 else ids[m.partner] for m in maneuvers],
        "kind": [kinds[m.object] for m in maneuvers],
        "partner_kind": ["" if m.partner < 0 else kinds[m.partner] for m in maneuvers],
        "lane_from": features.lane_names(ends[:, 0]), "lane_to": features.lane_names(ends[:, 1]),
        "x_from": samples.x[ends[:, 0]], "y_from": samples.y[ends[:, 0]],
        "x_to": samples.x[ends[:, 1]], "y_to": samples.y[ends[:, 1]],
    }  # fmt: skip
    for name in (*FIGURES, *sorted(own)):
        table[name] = np.array([m.figures.get(name, np.nan) for m in maneuvers], dtype=float)
    texts = ("recording", "object", "label", "partner", "kind", "partner_kind", "lane_from", "lane_to")
    return _typed(pd.DataFrame(table), texts)


def scenario_frame(
    recording: str, features: Features, scenarios: Sequence[ExtractedScenario], names: Sequence[str]
) -> pd.DataFrame:
    """Give a row per scenario with SCENARIO_COLUMNS; folder, jscen and note are empty till they are written."""
    rows = [_scenario_row(recording, features, one, name) for one, name in zip(scenarios, names, strict=True)]
    frame = pd.DataFrame(rows, columns=list(SCENARIO_COLUMNS))
    numbers = ("start", "end", "ego_start", "ego_end", "duration", "least_ttc_s", "least_thw_s", "least_gap_m",
               "most_braking_mps2")  # fmt: skip
    frame = frame.astype(
        dict.fromkeys(numbers, float) | dict.fromkeys(("lanes", "vehicles", "triggers"), "int64")
    )
    frame["along_s"] = frame["along_s"].astype(bool)
    texts = ("scenario", "recording", "ego", "road", "tag", "labels", "members", "folder", "jscen", "note")
    return _typed(frame, texts)


def _scenario_row(
    recording: str, features: Features, one: ExtractedScenario, name: str
) -> tuple[object, ...]:
    samples = features.samples
    t, ids = samples.tracks.t, samples.tracks.ids.tolist()
    own = slice(samples.at(one.ego, one.ego_start), samples.at(one.ego, one.ego_end) + 1)
    labels = " ".join(dict.fromkeys(m.label for m in one.triggers))
    return (
        name, recording, ids[one.ego], t[one.start], t[one.end], t[one.ego_start], t[one.ego_end],
        t[one.end] - t[one.start], *one.bucket, tag(one.triggers), labels, " ".join(ids[m] for m in one.members),
        len(one.triggers), *_figures(features, own), "", "", "",
    )  # fmt: skip


def _figures(features: Features, own: slice) -> tuple[float, float, float, float]:
    """Least TTC and THW [s], least gap [m] to the leader, and strongest braking [m/s²] of samples."""
    samples, flow = features.samples, features.flow
    gap, v, leader = flow.gap[own], samples.v[own], flow.leader[own]
    a = features.a[own]
    braking = float(np.nanmin(a)) if np.isfinite(a).any() else np.nan
    led = leader >= 0
    if not led.any():
        return np.nan, np.nan, np.nan, braking
    gap, v, closing = np.maximum(gap[led], 0.0), v[led], (v - samples.v[leader])[led]
    times = gap[closing > 0.0] / closing[closing > 0.0]
    headways = gap[v > 0.0] / v[v > 0.0]
    return (
        float(times.min()) if len(times) else np.nan, float(headways.min()) if len(headways) else np.nan,
        float(gap.min()), braking,
    )  # fmt: skip


def _typed(frame: pd.DataFrame, texts: Sequence[str]) -> pd.DataFrame:
    """Texts as texts, also where there is no row."""
    return frame.astype(dict.fromkeys(texts, "string"))
