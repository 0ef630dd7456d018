"""Draw mined labels, one picture each, to be checked by eye: twelve on a sheet.

    python tools/draw_labels.py RECORDING MINED OUT [--label NAME ...]

Above, from the sky: lanes, the object's whole way thin, the labelled part blue, its box and that of the partner at
the moment; everybody else grey. Below, over time: speed [m/s] (black), its difference quotient [m/s²] (green,
right), and the labelled part shaded. Positions are those of the recording; nothing of what mining derives is drawn
but the label.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from resim.core.geometry import box_corners, to_frame
from resim.core.tracks import Tracks
from resim.jobs.mine import read_mined
from resim.recordings import read_recording
from resim.road.opendrive import VEHICLE_LANES, LaneShape, load

ACROSS, DOWN, REACH = 3, 4, 40.0
"""Pictures on a sheet; m around the labelled part."""
TEXT = ("recording", "object", "label", "start", "end", "t", "partner", "lane_from", "lane_to")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("mined", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--label", action="append", help="of these labels alone")
    arguments = parser.parse_args()
    recording = read_recording(arguments.recording)
    shapes = [shape for shape in load(recording.map).lane_shapes(2.0) if shape.type in VEHICLE_LANES]
    name, rows = arguments.recording.resolve().name, read_mined(arguments.mined).maneuvers
    rows = rows[rows["recording"] == name]
    if arguments.label:
        rows = rows[rows["label"].isin(arguments.label)]
    rows = rows.sort_values(["label", "start", "object"])
    arguments.out.mkdir(parents=True, exist_ok=True)
    for sheet, first in enumerate(range(0, len(rows), ACROSS * DOWN)):
        figure, axes = plt.subplots(2 * DOWN, ACROSS, figsize=(21, 26), height_ratios=[3, 1] * DOWN)
        for axis in axes.flat:
            axis.set_axis_off()
        for k, (_, row) in enumerate(rows.iloc[first : first + ACROSS * DOWN].iterrows()):
            at = 2 * (k // ACROSS), k % ACROSS
            _from_above(axes[at], row, recording.gt, shapes, f"{first + k}")
            _over_time(axes[at[0] + 1, at[1]], row, recording.gt)
        figure.tight_layout(pad=0.4)
        figure.savefig(arguments.out / f"{name}_{sheet:02}.png", dpi=55)
        plt.close(figure)
    print(f"{len(rows)} labels of {name}: {arguments.out}")


def _from_above(axis: Axes, row: pd.Series, tracks: Tracks, shapes: list[LaneShape], number: str) -> None:
    """Draw the map around the object's labelled part, turned along it."""
    n, valid = tracks.index(str(row["object"])), tracks.valid
    at = int(np.argmin(np.abs(tracks.t - row["t"])))
    part = np.flatnonzero(valid[n] & (tracks.t >= row["start"] - 1e-6) & (tracks.t <= row["end"] + 1e-6))
    frame = float(tracks.x[n, at]), float(tracks.y[n, at]), float(tracks.heading[n, at])
    x, y = to_frame(tracks.x, tracks.y, *frame)
    low, high = np.min(x[n, part]) - REACH, np.max(x[n, part]) + REACH
    across = max(np.ptp(y[n, part]), 14.0)
    for shape in shapes:
        ring = np.concatenate([shape.left, shape.right[::-1]])
        a, b = to_frame(ring[:, 0], ring[:, 1], *frame)
        if a.max() > low and a.min() < high:
            axis.fill(a, b, facecolor="#eef0f2", edgecolor="#9aa3ad", linewidth=0.6)
    for other in np.flatnonzero(valid[:, at]):
        named = str(tracks.ids[other]) == str(row["partner"])
        color = "#0072B2" if other == n else "#D55E00" if named else "#b5b5b5"
        corners = box_corners(
            tracks.x[other, at], tracks.y[other, at], tracks.heading[other, at], tracks.length[other],
            tracks.width[other],
        )  # fmt: skip
        axis.fill(*to_frame(*corners.T, *frame), color=color, alpha=0.7)
    axis.plot(x[n, valid[n]], y[n, valid[n]], color="black", linewidth=0.6)
    axis.plot(x[n, part], y[n, part], color="#0072B2", linewidth=2.0)
    middle = 0.5 * (np.min(y[n, part]) + np.max(y[n, part]))
    axis.set(xlim=(low, high), ylim=(middle - across, middle + across))
    figures = [f"{name} {value:.3g}" for name, value in row.drop([*TEXT]).items() if value == value]
    axis.set_title(
        f"{number}: {row['label']} of {row['object']}, {row['start']:.2f} to {row['end']:.2f} s at {row['t']:.2f} s, "
        f"{row['lane_from']} > {row['lane_to']} {row['partner']}\n{', '.join(figures)}",
        fontsize=11,
    )  # fmt: skip


def _over_time(axis: Axes, row: pd.Series, tracks: Tracks) -> None:
    """Draw speed, and what is differenced of it, over the object's whole life."""
    axis.set_axis_on()
    n = tracks.index(str(row["object"]))
    own = tracks.valid[n]
    t, v = tracks.t[own], tracks.v[n, own]
    axis.plot(t, v, color="black")
    axis.axvspan(row["start"], row["end"], color="#0072B2", alpha=0.2)
    axis.axvline(row["t"], color="#0072B2")
    if len(t) > 1:
        second = axis.twinx()
        second.plot(t, np.gradient(v, t), color="#009E73", linewidth=0.8)
        second.axhline(0.0, color="#009E73", linewidth=0.3)
        second.tick_params(labelsize=8)
    axis.tick_params(labelsize=8)


if __name__ == "__main__":
    main()
