"""What the checks found in the recording."""

from __future__ import annotations

from resim.report import tables
from resim.report.panels.registry import PANELS, Panel

PANELS.add(Panel("recording", "Findings in the recording", tables.findings))
