"""The page of a sweep: requirements, boundaries, sensitivity, responses, the worst runs."""

from resim.sweeps.page.boundary_words import boundary_lines
from resim.sweeps.page.page import write_sweep_page
from resim.sweeps.page.words import demanded_of, engine_line, overview_line, requirement_lines

__all__ = [
    "boundary_lines",
    "demanded_of",
    "engine_line",
    "overview_line",
    "requirement_lines",
    "write_sweep_page",
]
