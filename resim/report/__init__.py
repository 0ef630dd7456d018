"""The page that shows a re-simulated recording: one HTML file, no network, same result, same bytes."""

from resim.report.page import write_report

__all__ = ["write_report"]
