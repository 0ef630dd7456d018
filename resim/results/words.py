"""The words by which something is found: what stands between the signs of its name, its path and the names of what it
follows from."""

from __future__ import annotations

import re

_WORD = re.compile(r"[^\W_]+")
LONGEST = 40
"""Letters of a word that count."""


def words_of(*texts: str) -> list[str]:
    """Give the words of texts in small letters, each once, in order: of cut_in-1.0 cut, in, 1 and 0."""
    return sorted({word[:LONGEST] for text in texts for word in _WORD.findall(text.lower())})
