"""One scenario from above as an SVG file: lanes, ways, and boxes where everybody is at its end."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from resim.core.geometry import Floats, box_corners, to_frame
from resim.core.tracks import Tracks
from resim.mining.page.views import BORDER, EGO, OTHER, along_ego, lane_borders
from resim.report.markup import Markup, html, join
from resim.road.opendrive import VEHICLE_LANES, LaneShape, RoadNetwork

WIDTH, LEAST_HEIGHT, MARGIN = 1400.0, 160.0, 12.0
"""m around all ways; pixels of the picture."""
LANE = "#e7eaed"


def write_scenario_picture(tracks: Tracks, ego: str, network: RoadNetwork, file: Path) -> None:
    """Write the picture of a scenario: the way of its EGO from left to right, everybody to one scale."""
    text = scenario_picture(tracks, ego, network)
    file.write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n', encoding="utf-8", newline="\n")


def scenario_picture(tracks: Tracks, ego: str, network: RoadNetwork) -> Markup:
    """Give the picture of a scenario as SVG."""
    row = tracks.index(ego)
    view = _View(along_ego(tracks, row), tracks)
    parts = [*view.lanes(network), *(view.vehicle(tracks, n, n == row) for n in [*range(len(tracks)), row])]
    size = f"{WIDTH:g}", f"{view.height:.0f}"
    return html(
        '<svg class="resim-scenario" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {} {}" width="{}" '
        'height="{}" role="img">'
        '<rect width="100%" height="100%" fill="white"/>{}</svg>',
        *size, *size, join(parts),
    )  # fmt: skip


class _View:
    """Pixels of places on the map, turned so that the EGO drives to the right."""

    def __init__(self, frame: tuple[float, float, float], tracks: Tracks) -> None:
        self.frame = frame
        along, aside = to_frame(tracks.x, tracks.y, *frame)
        self.left, right = float(np.nanmin(along)) - MARGIN, float(np.nanmax(along)) + MARGIN
        self.top, bottom = float(np.nanmax(aside)) + MARGIN, float(np.nanmin(aside)) - MARGIN
        self.scale = WIDTH / (right - self.left)
        self.height = max((self.top - bottom) * self.scale, LEAST_HEIGHT)

    def points(self, x: Floats, y: Floats) -> str:
        """Give places as the points of a line."""
        along, aside = to_frame(x, y, *self.frame)
        px, py = (along - self.left) * self.scale, (self.top - aside) * self.scale
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(px.tolist(), py.tolist(), strict=True))

    def lanes(self, network: RoadNetwork) -> Iterator[Markup]:
        """Give the lanes that reach into the picture: driven ones as areas, borders as lines."""
        near = [shape for shape in network.lane_shapes(2.0) if self._is_near(shape)]
        for shape in near:
            if shape.type in VEHICLE_LANES:
                ring = np.concatenate([shape.left, shape.right[::-1]])
                yield html('<polygon points="{}" fill="{}"/>', self.points(*ring.T), LANE)
        for border, broken in lane_borders(near):
            yield html(
                '<polyline points="{}" fill="none" stroke="{}" stroke-width="1" stroke-dasharray="{}"/>',
                self.points(*border.T), BORDER, "8,7" if broken else "none",
            )  # fmt: skip

    def _is_near(self, shape: LaneShape) -> bool:
        x, y = np.concatenate([shape.left, shape.right]).T
        along, aside = to_frame(x, y, *self.frame)
        high, wide = self.height / self.scale, WIDTH / self.scale
        across = (along > self.left) & (along < self.left + wide)
        return bool((across & (aside < self.top) & (aside > self.top - high)).any())

    def vehicle(self, tracks: Tracks, row: int, is_ego: bool) -> Markup:
        """Give the way of a vehicle, and its box and name where it is last."""
        known = np.flatnonzero(tracks.valid[row])
        if not len(known):
            return Markup()
        color, last = EGO if is_ego else OTHER, known[-1]
        x, y, heading = tracks.x[row, last], tracks.y[row, last], tracks.heading[row, last]
        corners = box_corners(x, y, heading, tracks.length[row], tracks.width[row])
        place = self.points(np.array([x]), np.array([y])).split(",")
        return html(
            '<polyline points="{}" fill="none" stroke="{}" stroke-width="1.6"/>'
            '<polygon points="{}" fill="{}" fill-opacity="0.75"/>'
            '<text x="{}" y="{}" font-family="sans-serif" font-size="11" fill="{}" text-anchor="middle" '
            'dy="-{}">{}</text>',
            self.points(tracks.x[row, known], tracks.y[row, known]), color,
            self.points(*corners.T), color, *place, color,
            f"{0.5 * tracks.width[row] * self.scale + 4.0:.0f}", str(tracks.ids[row]),
        )  # fmt: skip
