"""How a command is told that somebody watches."""

import os
from pathlib import Path

LIVE_VARIABLE = "RESIM_LIVE"
"""Environment variable with the path of the file into which a simulation writes its latest state."""
PROGRESS = "progress.json"
"""File beside that one in which stands how far the command is."""
LOG = "log.txt"
"""File beside these in which stands what the command says."""


def progress_file() -> Path | None:
    """Give the file in which a command says how far it is, None where nobody watches."""
    live = os.environ.get(LIVE_VARIABLE)
    return Path(live).with_name(PROGRESS) if live else None
