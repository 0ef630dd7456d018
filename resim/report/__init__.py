"""Pages of a re-simulation, an assessment, a map, a player. No network; same input, same bytes.

A page is one file; those of a folder may share one file of scripts beside them.

That of a perception model (`resim.report.perception`) is not loaded with them: it brings the training along.
"""

from resim.report.assessment import write_assessment_page
from resim.report.document import SHEET
from resim.report.map import write_map_page
from resim.report.page import write_report
from resim.report.player import write_player_page
from resim.report.shared import write_shared_scripts

__all__ = [
    "SHEET",
    "write_assessment_page",
    "write_map_page",
    "write_player_page",
    "write_report",
    "write_shared_scripts",
]
