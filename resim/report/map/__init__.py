"""The page that shows a map and how exact its SUMO net is: one HTML file, no network, same map, same bytes."""

from resim.report.map.page import write_map_page

__all__ = ["write_map_page"]
