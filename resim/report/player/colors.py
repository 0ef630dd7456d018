"""Colours and strokes of the player's layers, on light and dark paper."""

from __future__ import annotations

from dataclasses import dataclass

from resim.report.view import EGO_COLORS, SEEDS, TO_COLORS

DARK = {
    EGO_COLORS["GT"]: "#56b4f0",
    EGO_COLORS["SD"]: "#f0a5cf",
    TO_COLORS["GT"][0]: "#3ddbaa",
    TO_COLORS["SD"][0]: "#ff9a4d",
    SEEDS: "#c39bf0",
}
"""The colours of the reports in tones that are seen on dark paper."""


BUNDLE = "variations"
"""Name of the layer of a drive's variations."""


@dataclass(frozen=True)
class LayerColors:
    """Of the EGO and of others, each on light and dark paper; dash: of outlines [px]; fill: opacity of boxes."""

    ego: tuple[str, str]
    other: tuple[str, str]
    dash: tuple[int, ...]
    fill: float


def layer_colors(name: str) -> LayerColors:
    """Give how a layer is drawn: as in the reports by basis, dashed where simulated, dotted where perceived."""
    if name == BUNDLE:
        return LayerColors(_both(SEEDS), _both(SEEDS), (), 0.0)
    if name.startswith("perceived"):
        return LayerColors(_both(SEEDS), _both(SEEDS), (2, 3), 0.0)
    if "+M" in name:
        return LayerColors(_both(SEEDS), _both(SEEDS), (7, 4), 0.0)
    basis = "SD" if name.endswith("SD") else "GT"
    simulated = name.startswith("r")
    dash = (7, 4) if simulated else ()
    fill = 0.0 if simulated else 0.2 if basis == "SD" else 0.6
    return LayerColors(_both(EGO_COLORS[basis]), _both(TO_COLORS[basis][0]), dash, fill)


def _both(color: str) -> tuple[str, str]:
    return color, DARK[color]
