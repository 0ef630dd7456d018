"""The scripts that pages of one folder share: a file beside them, in place of one copy in each page."""

from __future__ import annotations

from pathlib import Path

from resim.report.document import own_scripts, script_sheet
from resim.report.player import player_scripts


def write_shared_scripts(path: Path, *, plots: bool = True) -> None:
    """Write the file that pages with `shared` take their scripts from; the same bytes each time.

    path: SHEET in the folder of the pages. plots: whether any of these has figures, for which a library is needed.
    """
    sheet = script_sheet([*own_scripts(), *player_scripts()], plots=plots)
    path.write_text(sheet, encoding="utf-8", newline="\n")
