"""The names in files that more than one room knows: schemas of JSON files, columns of tables; each stands here once.

`resim.jobs.schemas` has the JSON Schema of every file, by the dataclass or model that reads and writes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

PerceptionSchema = Literal["resim-perception-1"]
VerificationSchema = Literal["resim-verification-1"]
SweepSchema = Literal["resim-sweep-1"]
SweepReportSchema = Literal["resim-sweep-report-1"]
"""Of a perception model, of verification.json, of a sweep's manifest.json and of its report.json."""

GENERATOR = '<meta name="generator" content="resim">'
"""Stands in the head of every page, by which resim knows its own."""

COLUMNS = ("t", "id", "x", "y", "heading", "v", "length", "width", "kind")
OPTIONAL_COLUMNS = ("yaw_rate", "a", "z")
"""Of tracks, one row a time and object: s, m (map frame, centre of the box), rad, m/s, m; yaw rate [rad/s], m/s²,
height of the road under the centre of the box [m]."""

GT_ID, EXISTENCE, REPAIRED = "gt_id", "existence_probability", "repaired"
TOLD = {"length": "told_length", "width": "told_width"}
"""Of a recording's tables besides: the object's id in GT, its probability, codes of what a repair changed in the row;
and by side the largest recorded size, where a repair changed it [m]."""

PLAN_COLUMNS = ("t", "t_plan", "x", "y", "v")
"""Of a plan: when it was made, planned time [s, on the same clock], x, y [m], v [m/s]."""

ANSWER_COLUMNS = ("t", "acceleration", "curvature", "objects")
"""Of a function's answers: s, m/s², 1/m, number of objects that it was shown."""

RUN = "run"
"""Column of the tables of a sweep, and field of its journal: which run it is, counted from 0."""

DRAWN_COLUMNS = ("recording", "build", "seed")
"""Columns of the table of a sweep: what a run is of, besides the values of its parameters."""

VARIED_DISTANCE, VARIED_TRUST = "variation_distance", "variation_trust"
"""Columns of the table of a sweep whose runs are of variations: how far each is from its origin, and whether it lies
within what was verified."""

TEXT_OUTCOMES = ("end", "failure", "decision", "case", "unpinned", VARIED_TRUST)
"""Columns of the table of a sweep that hold text, besides outcomes of criteria and their units."""

Cell = str | bool | float | None
"""What a row says in one column; None where that is not known."""
Row = Mapping[str, Cell]
"""What a run of a sweep came to, a cell a column: the columns follow from its outcomes and criteria."""

SOURCE = "source"
"""Column of the tables of a run: what drive a row is of (GT, SD, rGT, rSD, rGT+M0, ..., perceived_...)."""
