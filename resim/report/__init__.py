"""Pages of a re-simulation, an assessment, a map, a perception model. One file, no network; same input, same bytes."""

from resim.report.assessment import write_assessment_page
from resim.report.map import write_map_page
from resim.report.page import write_report
from resim.report.perception import write_perception_page

__all__ = [
    "write_assessment_page",
    "write_map_page",
    "write_perception_page",
    "write_report",
]
