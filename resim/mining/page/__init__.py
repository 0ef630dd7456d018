"""Pages of what was found: mined.html of a study, and one of each recording."""

from resim.mining.page.page import write_mined_page
from resim.mining.page.picture import scenario_picture, write_scenario_picture
from resim.mining.page.recording_page import PAGES, write_recording_page

__all__ = ["PAGES", "scenario_picture", "write_mined_page", "write_recording_page", "write_scenario_picture"]
