"""Panels of the report, one file each. A new one needs its file, and a line here: their order is that of the page."""
# ruff: noqa: F401  each file adds its panel to the registry
# isort: skip_file

import resim.report.panels.player
import resim.report.panels.road
import resim.report.panels.steps
import resim.report.panels.errors
import resim.report.panels.reaction
import resim.report.panels.seeds
import resim.report.panels.assessment
import resim.report.panels.perceived
import resim.report.panels.findings
import resim.report.panels.provenance
