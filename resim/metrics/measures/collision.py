"""Whether the EGO collides, when, and with whom."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from resim.core.clock import TICK
from resim.core.geometry import Boxes, boxes_overlap
from resim.core.levels import apart_from
from resim.core.tracks import Tracks
from resim.metrics.drive import DriveScenes
from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.values import MeasureValues, computed

if TYPE_CHECKING:
    from resim.metrics.measures.inputs import MeasureInputs

NEAR = 1.0 + 1e-9
"""By what distances of centres are compared with the circles around boxes: rounding must not part who touch."""

COLLISION = MeasureDefinition(
    name="collision",
    unit="1",
    worst="high",
    kind="quantitative",
    source="KO criterion (Wagner 2021, 4.1.4)",
    meaning="1 where the EGO's box touches another",
    of=lambda inputs: collision(inputs),
    unseen=lambda absent: absent.at_worst(1.0, absent.touches("anything") <= absent.step),
    whom=lambda found, scene: next(
        (who for t, who in found.contacts if scene_of(found.drive, t) == scene), ""
    ),
)


def collision(inputs: MeasureInputs) -> MeasureValues:
    """Give 1 where the EGO's box touches another between a scene and the next, else 0 (S,)."""
    drive = inputs.drive
    value = np.where((inputs.pairs.complete() | ~drive.present).all(axis=1), 0.0, np.nan)
    value[[scene_of(drive, t) for t, _ in inputs.contacts]] = 1.0
    return COLLISION.values(*computed(value))


def scene_of(drive: DriveScenes, t: float) -> int:
    """Give the scene that a time [s] belongs to: the last one that is not after it."""
    return max(int(np.searchsorted(drive.t, t + TICK, side="right")) - 1, 0)


def contacts(tracks: Tracks, ego: str) -> list[tuple[float, str]]:
    """Give when [s] the EGO's box touches whose, for every sample; nobody on another level."""
    row, radius = tracks.index(ego), 0.5 * np.hypot(tracks.length, tracks.width)
    apart = np.hypot(tracks.x - tracks.x[row], tracks.y - tracks.y[row])
    near = apart <= NEAR * (radius + radius[row])[:, None]  # else the circles around the boxes are apart
    near[row] = False
    if near.any() and (levels := apart_from(tracks, row)) is not None:
        near &= ~levels
    n, i = np.nonzero(near)
    hit = boxes_overlap(
        Boxes(
            tracks.x[row, i], tracks.y[row, i], tracks.heading[row, i], tracks.length[row], tracks.width[row]
        ),
        Boxes(tracks.x[n, i], tracks.y[n, i], tracks.heading[n, i], tracks.length[n], tracks.width[n]),
    )
    return sorted(zip(tracks.t[i[hit]].tolist(), tracks.ids[n[hit]].tolist(), strict=True))
