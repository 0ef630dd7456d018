"""mined.html: what was found in recordings."""

from resim.mining.page.page import write_mined_page
from resim.mining.page.picture import scenario_picture, write_scenario_picture

__all__ = ["scenario_picture", "write_mined_page", "write_scenario_picture"]
