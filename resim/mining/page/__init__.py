"""mined.html: what was found in recordings."""

from resim.mining.page.page import write_mined_page

__all__ = ["write_mined_page"]
