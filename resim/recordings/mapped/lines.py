"""The lines of a guessed mapping: TOML, each with its reason."""

from __future__ import annotations

import json
from dataclasses import dataclass, field


@dataclass
class MappingLines:
    """The lines of a mapping as they come to be known: sure ones, and those that somebody has to fill in."""

    lines: list[str] = field(default_factory=list)

    def sure(self, text: str, reason: str) -> None:
        """Add a line that the data tell."""
        self.lines.append(f"{text}  # {reason}")

    def choose(self, name: str, choices: str) -> None:
        """Add a line whose value nobody but the user knows: what reads it refuses it as it is."""
        self.lines.append(f'{name} = "?"  # FILL IN: {choices}')

    def ask(self, text: str, reason: str) -> None:
        """Add a line, commented out, that somebody has to fill in."""
        self.lines.append(f"# {text}  # FILL IN: {reason}")


def quoted(text: str) -> str:
    """Give a TOML string (JSON's escapes, and DEL)."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
