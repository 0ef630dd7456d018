"""Ground truth as CSV of the highD family, in the columns of inD, rounD and exiD, which hold on curves as well.

highD's own columns have no heading, as its vehicles drive along x; the newer ones of the same makers have box centres
and headings in degrees (`highd` reads both).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.tracks import Tracks

DIGITS = 6


def write_highd(tracks: Tracks, folder: Path, number: int, rate: float) -> tuple[Path, Path, Path]:
    """Write `XX_tracks.csv`, `XX_tracksMeta.csv` and `XX_recordingMeta.csv`, and give their paths.

    number: XX, of the recording. rate: frames a second [Hz]. tracks: on that clock from 0 s; their ids are numbers.
    """
    stem = f"{number:02d}"
    files = tuple(folder / f"{stem}_{name}.csv" for name in ("tracks", "tracksMeta", "recordingMeta"))
    folder.mkdir(parents=True, exist_ok=True)
    row, k = np.nonzero(tracks.valid)
    first = np.argmax(tracks.valid, axis=1)
    heading, v = tracks.heading[row, k], tracks.v[row, k]
    a = np.zeros(len(row)) if tracks.a is None else tracks.a[row, k]
    rate_of_turn = np.zeros(len(row)) if tracks.yaw_rate is None else tracks.yaw_rate[row, k]
    cos, sin = np.cos(heading), np.sin(heading)
    table = pd.DataFrame({
        "recordingId": number, "trackId": tracks.ids[row], "frame": k, "trackLifetime": k - first[row],
        "xCenter": tracks.x[row, k], "yCenter": tracks.y[row, k], "heading": np.degrees(heading) % 360.0,
        "width": tracks.width[row], "length": tracks.length[row],
        "xVelocity": v * cos, "yVelocity": v * sin,
        "xAcceleration": a * cos - v * rate_of_turn * sin, "yAcceleration": a * sin + v * rate_of_turn * cos,
        "lonVelocity": v, "latVelocity": 0.0, "lonAcceleration": a, "latAcceleration": v * rate_of_turn,
    })  # fmt: skip
    meta = pd.DataFrame({
        "recordingId": number, "trackId": tracks.ids, "initialFrame": first,
        "finalFrame": first + tracks.valid.sum(axis=1) - 1, "numFrames": tracks.valid.sum(axis=1),
        "width": tracks.width, "length": tracks.length, "class": tracks.kind,
    })  # fmt: skip
    head = pd.DataFrame({"recordingId": [number], "frameRate": [rate], "duration": [float(tracks.t[-1])],
                         "numTracks": [len(tracks)], "numVehicles": [len(tracks)]})  # fmt: skip
    for path, one in zip(files, (table, meta, head), strict=True):
        one.round(DIGITS).to_csv(path, index=False, lineterminator="\n")
    return files[0], files[1], files[2]
