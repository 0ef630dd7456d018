"""The pages of a space, of what covers it, of a release, and of two spaces compared."""

from resim.space.page.comparison import write_comparison_page
from resim.space.page.cover import write_cover_page
from resim.space.page.page import write_space_page
from resim.space.page.release import write_release_page

__all__ = ["write_comparison_page", "write_cover_page", "write_release_page", "write_space_page"]
