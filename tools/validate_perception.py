"""Trains a perception model on Mcity trials 3 and 4 and holds it beside trial 5: a table in Markdown.

    python tools/validate_perception.py [DATA_DIR] [--model OUT.json]

DATA_DIR holds `gts/`, `dets/` and `mcity.xodr`, by default ../shared/data/mcity. The truth is one vehicle's; the sensor
stands at the roadside, nobody says where. So the "EGO" is a mark that follows BEHIND m behind the vehicle in its
heading: longitudinal and lateral are the vehicle's own axes, range and bearing say nothing. Each trial is cut into
parts of 10 s, which are taken for drives. Perceived objects that never come near the vehicle are left out: whether
they are there nobody knows, so false objects are not estimated.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from resim.core.tracks import Tracks
from resim.perception.model import PerceptionModel, write_model
from resim.perception.training import train
from resim.perception.validation import Report, judge
from resim.recordings import Recording, recording_of
from resim.recordings.formats.mcity import import_trial
from resim.road.opendrive import load

NEAR = 6.0  # m
PART = 10.0  # s
BEHIND = 20.0  # m
STATION = "station"
SEEDS = 100
SHOWN = (0.2, 0.8, 2.0)  # s, lags of the table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    here = Path(__file__).parents[2] / "shared" / "data" / "mcity"
    parser.add_argument("data_dir", type=Path, nargs="?", default=here)
    parser.add_argument("--model", type=Path)
    asked = parser.parse_args()
    network = load(asked.data_dir / "mcity.xodr")
    trials = {name: recording_of(import_trial(name, asked.data_dir, network)) for name in ("3", "4", "5")}
    parts = {name: cut(followed(r)) for name, r in trials.items()}
    begin = time.perf_counter()
    model = train([*parts["3"], *parts["4"]], name="mcity_3_4")
    took = time.perf_counter() - begin
    print(f"trained on {len(parts['3']) + len(parts['4'])} parts in {took:.1f} s\n")
    if asked.model:
        write_model(model, asked.model)
    none = judge(PerceptionModel(name="none"), parts["5"], seeds=1)
    print(table(judge(model, parts["5"], seeds=SEEDS), none))
    print()
    print(parameters(model))


def followed(recording: Recording) -> Recording:
    """Give the trial with a mark behind the vehicle as EGO and the vehicle as its traffic object."""
    gt, sd = recording.gt, recording.sd
    assert sd is not None
    mark = replace(
        gt, ids=np.array([STATION]), x=gt.x - BEHIND * np.cos(gt.heading), y=gt.y - BEHIND * np.sin(gt.heading)
    )  # fmt: skip
    truth = gt.at(sd.t)
    with np.errstate(invalid="ignore"):
        near = (np.hypot(sd.x - truth.x, sd.y - truth.y) < NEAR).any(axis=1)
    kept = sd.ids[near]
    names = np.where(near, recording.ego, "")
    assert recording.sd_gt_id is not None
    return replace(
        recording, ego=STATION, gt=Tracks.concatenate([mark, gt]), sd=sd.select(kept), sd_gt_id=names[near]
    )


def cut(recording: Recording) -> list[Recording]:
    """Give the parts in which something was perceived."""
    out, sd = [], recording.sd
    assert sd is not None
    assert recording.sd_gt_id is not None
    gt_id = dict(zip(sd.ids.tolist(), recording.sd_gt_id.tolist(), strict=True))
    for start in np.arange(recording.gt.t[0], recording.gt.t[-1] - PART / 2, PART).tolist():
        seen = sd.window(start, start + PART)
        if len(seen):
            names = np.array([gt_id[i] for i in seen.ids.tolist()])
            out.append(
                replace(
                    recording, name=f"{recording.name}_{start:.0f}s",
                    sd=seen, sd_gt_id=names,
                )
            )  # fmt: skip
    return out


def table(report: Report, none: Report) -> str:
    """The error statistics of the held-out trial, measured / of the model; distances: of the model, of no model."""
    lags = [report.lags.index(lag) for lag in SHOWN]
    head = [
        "error",
        "mean",
        "standard deviation",
        "2.5 %",
        "median",
        "97.5 %",
        "Wasserstein, model / none",
        "between halves",
    ]
    head += [f"correlation at {lag:g} s" for lag in SHOWN]
    rows = [head, ["---"] * len(head)]
    for name, a in report.quantities.items():
        one, other = a.quantiles_measured, a.quantiles_model
        row = [f"{name} [{a.unit}]", _both(*a.mean), _both(*a.deviation)]
        row += [_both(one[k], other[k]) for k in (0, len(one) // 2, -1)]
        row.append(_both(a.wasserstein, none.quantities[name].wasserstein))
        row.append("–" if a.yardstick is None else f"{a.yardstick:.3g}")
        row += [_both(a.autocorrelation_measured[k], a.autocorrelation_model[k]) for k in lags]
        rows.append(row)
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    lines.append("")
    lines.append(
        f"Detected {_both(*report.detected)} of the time; drop-outs: {_dropouts(report.dropouts_measured)} measured, "
        f"{_dropouts(report.dropouts_model)} of the model ({SEEDS} seeds)."
    )
    return "\n".join(lines)


def parameters(model: PerceptionModel) -> str:
    """The estimates with their intervals."""
    assert model.training is not None
    lines = ["| parameter | value | 95 % | samples |", "| --- | --- | --- | --- |"]
    for name, e in model.training.estimates.items():
        if e.value or e.high > e.low:
            lines.append(f"| {name} | {e.value:.4g} | {e.low:.4g} to {e.high:.4g} | {e.samples} |")
    return "\n".join(lines)


def _both(one: float | None, other: float | None) -> str:
    return " / ".join("–" if value is None else f"{value:.3g}" for value in (one, other))


def _dropouts(lengths: Sequence[float]) -> str:
    if not lengths:
        return "none"
    return f"{len(lengths)}, median {np.median(lengths):.2g} s, longest {max(lengths):.2g} s"


if __name__ == "__main__":
    main()
