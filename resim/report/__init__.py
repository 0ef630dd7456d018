"""Pages of a re-simulation, an assessment, a map, a player. One file, no network; same input, same bytes.

That of a perception model (`resim.report.perception`) is not loaded with them: it brings the training along.
"""

from resim.report.assessment import write_assessment_page
from resim.report.map import write_map_page
from resim.report.page import write_report
from resim.report.player import write_player_page

__all__ = [
    "write_assessment_page",
    "write_map_page",
    "write_player_page",
    "write_report",
]
