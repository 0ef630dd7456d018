"""The colours of the picture: lane types, and errors on a logarithmic scale."""

from __future__ import annotations

from collections.abc import Mapping
from math import log10

ASPHALT, RAMP, RESERVED, OTHER = "#a9b0b9", "#8ea7c2", "#b9a3d0", "#dadde1"
MISSING, MISSING_OTHER = "#c51b8a", "#e6a6cf"
"""Lanes that are not in the net: for vehicles, and others; as in lanes.js."""

TYPES: Mapping[str, str] = {
    "driving": ASPHALT, "bidirectional": ASPHALT, "roadWorks": "#e08e45",
    "entry": RAMP, "exit": RAMP, "onRamp": RAMP, "offRamp": RAMP, "connectingRamp": RAMP, "slipLane": RAMP,
    "mwyEntry": RAMP, "mwyExit": RAMP,
    "bus": RESERVED, "taxi": RESERVED, "HOV": RESERVED,
    "special1": RESERVED, "special2": RESERVED, "special3": RESERVED,
    "shoulder": "#ddd3ba", "stop": "#e8c85a", "border": "#bccf9a", "median": "#9cb878", "curb": "#6f7680",
    "sidewalk": "#f2c6a0", "walking": "#f2c6a0", "biking": "#cf6f55", "parking": "#5b9bd5",
    "restricted": "#c9a0a0", "none": "#eceef1", "tram": "#7a6a86", "rail": "#7a6a86",
}  # fmt: skip
"""By lane type; vehicles' lanes in greys and muted blues, so that what is no lane for them stands out."""

FIRST = ("driving", "bidirectional", "entry", "exit")
"""What comes first in the legend; the rest follows by name."""

SCALE: tuple[tuple[float, str], ...] = (
    (1e-4, "#b5d4ea"), (1e-3, "#5ea1cf"), (5e-3, "#1f5f9f"), (1e-2, "#f6c667"), (1e-1, "#ec7014"),
    (1.0, "#b2182b"), (10.0, "#54001a"),
)  # fmt: skip
"""Errors [m] and their colours, linear between them in the logarithm: blue is good, whatever the limit."""

TICKS = ((1e-4, "0.1 mm"), (1e-3, "1 mm"), (1e-2, "1 cm"), (1e-1, "10 cm"), (1.0, "1 m"), (10.0, "10 m"))


def type_color(name: str) -> str:
    """Give the colour #rrggbb of a lane type."""
    return TYPES.get(name, OTHER)


def share(error: float) -> float:
    """Give where an error [m] lies on the scale, 0 to 1."""
    low, high = log10(SCALE[0][0]), log10(SCALE[-1][0])
    return min(max((log10(max(error, 1e-12)) - low) / (high - low), 0.0), 1.0)


def gradient() -> str:
    """Give the scale as a CSS gradient from left to right."""
    return "linear-gradient(90deg," + ",".join(f"{color} {100 * share(at):.2f}%" for at, color in SCALE) + ")"
