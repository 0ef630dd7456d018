"""The page of a verification: one row a recording, and what is behind it."""

from resim.verification.page.page import write_verification_page

__all__ = ["write_verification_page"]
