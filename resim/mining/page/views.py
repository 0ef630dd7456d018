"""Scenarios from above, small: lanes, and the ways of the EGO and those around it, along the way of the EGO."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
import shapely

from resim.core.geometry import Floats, from_frame, to_frame
from resim.core.tracks import Tracks
from resim.report.markup import Markup, html, join
from resim.road.opendrive import VEHICLE_LANES, LaneShape, RoadNetwork

EGO, OTHER, BORDER = "#0072B2", "#b0603a", "#9aa3ad"
WIDTH, HEIGHT, MARGIN = 360.0, 120.0, 6.0
"""Pixels of a scenario from above, and those beside its ways."""
VIEWS_CSS = """.views { display: grid; gap: 14px 22px;
  grid-template-columns: repeat(auto-fill, minmax(min(360px, 100%), 1fr)); }
.views figure { margin: 0; } .views svg { max-width: 100%; height: auto; }
"""
STRETCHED = 4.0
"""Times that the scale across is larger than that along, at most."""
STEP, OFF = 2.0, 0.3
"""m between the points of lane borders; pixels that a line may be off for fewer points."""


class LaneBorders:
    """The borders of a map's lanes, found by place."""

    def __init__(self, network: RoadNetwork) -> None:
        told = [*lane_borders(network.lane_shapes(STEP))]
        self._lines = np.array([shapely.LineString(points) for points, _ in told], dtype=object)
        self._broken = np.array([broken for _, broken in told], dtype=bool)
        self._tree = shapely.STRtree(self._lines)

    def within(self, ring: Floats) -> Iterator[tuple[np.ndarray, bool]]:
        """Give the lines that reach into a ring of places (P, 2) [m], and whether they are broken."""
        found = np.sort(self._tree.query(shapely.Polygon(ring), predicate="intersects"))
        for broken in (False, True):
            yield self._lines[found[self._broken[found] == broken]], broken


def lane_borders(shapes: Iterable[LaneShape]) -> Iterator[tuple[Floats, bool]]:
    """Give the outer borders (P, 2) [m] of lanes that are driven on or marked, and whether the mark is broken."""
    for shape in shapes:
        if shape.mark != "none" or shape.type in VEHICLE_LANES:
            yield shape.left if shape.lane > 0 else shape.right, "broken" in shape.mark


def views_of(figures: Iterable[Markup]) -> Markup:
    """Give views beside each other, as many as the page is wide (VIEWS_CSS)."""
    return html('<div class="views">{}</div>', join(figures))


def along_ego(tracks: Tracks, row: int) -> tuple[float, float, float]:
    """Give the frame x [m], y [m], heading [rad] of the EGO's whole way: from where it is first to where it is last."""
    own = np.flatnonzero(tracks.valid[row])[[0, -1]]
    (x, x_end), (y, y_end) = tracks.x[row, own].tolist(), tracks.y[row, own].tolist()
    return x, y, math.atan2(y_end - y, x_end - x)


def top_view(name: str, tracks: Tracks, ego: str, borders: LaneBorders) -> Markup:
    """Give a scenario from above as SVG: the EGO blue, a dot where each way ends."""
    row = tracks.index(ego)
    view = _View(along_ego(tracks, row), tracks)
    return html(
        '<svg viewBox="0 0 {} {}" width="{}" height="{}" role="img" aria-label="{}">{}{}</svg>',
        f"{WIDTH:g}", f"{HEIGHT:g}", f"{WIDTH:g}", f"{HEIGHT:g}", f"{name} from above",
        join(view.lanes(borders)), join(view.ways(tracks, row)),
    )  # fmt: skip


class _View:
    """Pixels of places on the map: all ways of a scenario fit in."""

    def __init__(self, frame: tuple[float, float, float], tracks: Tracks) -> None:
        self.frame = frame
        along, aside = self._framed(tracks.x[tracks.valid], tracks.y[tracks.valid])
        self.low, self.middle = float(along.min()), 0.5 * float(aside.min() + aside.max())
        self.scale = (WIDTH - 2.0 * MARGIN) / max(float(np.ptp(along)), 1.0)
        self.across = min((HEIGHT - 2.0 * MARGIN) / max(float(np.ptp(aside)), 1.0), STRETCHED * self.scale)

    def _framed(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        return to_frame(x, y, *self.frame)

    def pixels(self, places: Floats) -> Floats:
        """Give the pixels (P, 2) of places (P, 2) [m]."""
        along, aside = self._framed(*places.T)
        return np.stack(
            [MARGIN + (along - self.low) * self.scale, 0.5 * HEIGHT - (aside - self.middle) * self.across],
            axis=1,
        )

    def lanes(self, borders: LaneBorders) -> Iterator[Markup]:
        """Give the borders of lanes that reach into the picture."""
        along = self.low + (np.array([0.0, WIDTH, WIDTH, 0.0]) - MARGIN) / self.scale
        aside = self.middle + 0.5 * HEIGHT / self.across * np.array([1.0, 1.0, -1.0, -1.0])
        ring = np.stack(from_frame(along, aside, *self.frame), axis=1)
        for lines, broken in borders.within(ring):
            drawn = shapely.clip_by_rect(shapely.transform(lines, self.pixels), 0.0, 0.0, WIDTH, HEIGHT)
            parts = shapely.get_parts(shapely.simplify(drawn, OFF))
            path = "".join(f"M{_points(shapely.get_coordinates(one))}" for one in parts if not one.is_empty)
            if path:
                yield html(
                    '<path d="{}" fill="none" stroke="{}" stroke-width="0.8" stroke-dasharray="{}"/>',
                    path, BORDER, "5,4" if broken else "none",
                )  # fmt: skip

    def ways(self, tracks: Tracks, ego: int) -> Iterator[Markup]:
        """Give the ways of all vehicles, that of the EGO (row ego) last."""
        row, step = np.nonzero(tracks.valid)
        row, step = np.repeat(row, 2), np.repeat(step, 2)  # a way of one sample is a line, too
        pixels = self.pixels(np.stack([tracks.x[row, step], tracks.y[row, step]], axis=1))
        seen, of = np.unique(row, return_inverse=True)
        lines = shapely.simplify(shapely.linestrings(pixels, indices=of), OFF)
        for k in sorted(range(len(seen)), key=lambda k: seen[k] == ego):
            points, color = shapely.get_coordinates(lines[k]), EGO if seen[k] == ego else OTHER
            x, y = points[-1].tolist()
            yield html(
                '<path d="M{}" fill="none" stroke="{}" stroke-width="1.6"/><circle cx="{}" cy="{}" r="2.6" fill="{}"/>',
                _points(points), color, f"{x:.1f}", f"{y:.1f}", color,
            )  # fmt: skip


def _points(pixels: Floats) -> str:
    return "L".join(f"{x:.1f},{y:.1f}" for x, y in pixels.tolist())
