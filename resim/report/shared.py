"""The scripts that pages of one folder share: a file beside them, in place of one copy in each page."""

from __future__ import annotations

from pathlib import Path

from resim.report.document import SHEET, own_scripts, script_sheet
from resim.report.player import player_scripts


def write_shared_scripts(folder: Path) -> None:
    """Write the file that pages written with `shared` take their scripts from; the same bytes each time."""
    sheet = script_sheet([*own_scripts(), *player_scripts()])
    (folder / SHEET).write_text(sheet, encoding="utf-8", newline="\n")
