"""What of a traffic object's motion can be varied (`resim.scenario.variation`)."""

from __future__ import annotations

VARIED = ("speed", "gap", "braking", "lane_change")
"""Names of all parameters."""
