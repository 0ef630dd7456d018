"""What the result was made from."""

from __future__ import annotations

from resim.report import tables
from resim.report.panels.registry import PANELS, Panel

PANELS.add(Panel("provenance", "Provenance", tables.provenance))
