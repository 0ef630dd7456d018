"""The pages of a space, of a release, and of two spaces compared."""

from resim.space.page.page import write_space_page

__all__ = ["write_space_page"]
