"""The pages: of a re-simulated recording and of a map. One HTML file, no network, same input, same bytes."""

from resim.report.map import write_map_page
from resim.report.page import write_report

__all__ = ["write_map_page", "write_report"]
