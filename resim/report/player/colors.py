"""Colours and strokes of the player's layers, on light and dark paper."""

from __future__ import annotations

from dataclasses import dataclass, replace

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


FURTHER = (
    ("#8a4b00", "#ffb35c"), ("#6b2fa3", "#cda6ff"), ("#00706b", "#4fd8d0"), ("#a3163f", "#ff8aa8"),
    ("#4d6600", "#b5d94c"),
)  # fmt: skip
"""Of the EGOs of further drives above the first, by turns, on light and dark paper; others are in grey."""
GREY = ("#6b6b6b", "#a8a8a8")


def layer_colors(name: str, of: int = 0) -> LayerColors:
    """Give how a layer is drawn: as in the reports by basis, dashed where simulated, dotted where perceived.

    of: of which of several drives above each other it is; further ones have colours of their own.
    """
    if of:
        first = layer_colors(name.rpartition(" ")[0])
        return replace(first, ego=FURTHER[(of - 1) % len(FURTHER)], other=GREY)
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
