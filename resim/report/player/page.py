"""The player's markup, script and styles: for a page of its own, and for a section of another page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from resim.core.errors import InputError
from resim.report.document import document, text
from resim.report.map.page import DRAWING
from resim.report.markup import Markup, html, join
from resim.report.player.data import to_script
from resim.report.player.drive import PlayedDrive, thinned

SCRIPTS = ("unpack.js", "playback.js", "drawing.js", "curves.js", "controls.js")
LARGEST = 100_000_000
"""Characters of a page that a browser still opens at once."""
EMBEDDED = 400_000
"""Samples of a layer in a page that shows more than the player: of 50 objects at 25 Hz those of 320 s."""


def _icon(path: str) -> Markup:
    return html('<svg viewBox="0 0 18 18" aria-hidden="true"><path d="{}"/></svg>', path)


FIRST, FINAL = _icon("M3 3h2v12H3zM15 3v12L6 9z"), _icon("M13 3h2v12h-2zM3 3v12l9-6z")
BACK, FORTH = _icon("M12 3v12L4 9zM13 3h2v12h-2z"), _icon("M6 3v12l8-6zM3 3h2v12H3z")
PLAY, PAUSE = _icon("M4 2v14l12-7z"), _icon("M4 2h4v14H4zM10 2h4v14h-4z")
FOLLOW = _icon(
    "M9 4a5 5 0 1 1 0 10A5 5 0 0 1 9 4zm0 2a3 3 0 1 0 0 6 3 3 0 0 0 0-6zM8 0h2v4H8zM8 14h2v4H8zM0 8h4v2H0zM14 8h4v2h-4z"
)
ALL = _icon("M1 1h6v2H3v4H1zM11 1h6v6h-2V3h-4zM1 11h2v4h4v2H1zM15 11h2v6h-6v-2h4z")
RULER = _icon("M1 6h16v7H1zM2.5 7.5v4h13v-4h-1.5v2h-1.5v-2H11v2.5H9.5V7.5H8v2H6.5v-2H5V10H3.5V7.5z")


def write_player_page(drives: Sequence[PlayedDrive], path: Path, *, shared: bool = False) -> None:
    """Write the page, one HTML file; the same drives give the same bytes. Raises InputError where it is too large.

    shared: it takes its scripts from the file that `write_shared_scripts` writes beside it.
    """
    path.write_text(page(drives, shared=shared), encoding="utf-8", newline="\n")


def page(drives: Sequence[PlayedDrive], *, shared: bool = False) -> Markup:
    """Give the page's HTML. Raises InputError where it would be too large for a browser."""
    title = drives[0].name if len(drives) == 1 else f"{len(drives)} drives"
    body = html(
        '<main class="play"><header><p class="kind">Player</p><h1>{}</h1></header>\n{}</main>',
        title,
        player(drives, alone=True),
    )
    css = player_styles() + text("resim.report.player", "alone.css")
    found = document(f"{title} · player", body, css=css, scripts=player_scripts(), plots=False, shared=shared)
    if len(found) > LARGEST:
        problem = f"the page would have {len(found) / 1e6:.0f} MB, more than a browser opens"
        raise InputError("--out", problem, "Give fewer drives, or cut them.")
    return found


def player_scripts() -> list[str]:
    """Give the script of a page with a player; nothing that it declares is seen by other scripts."""
    parts = [text("resim.report.map", name) for name in DRAWING]
    parts += [text("resim.report.player", name) for name in SCRIPTS]
    return ['(() => {\n"use strict";\n' + "\n".join(parts) + "})();\n"]


def player_styles() -> str:
    """Give the styles of a page with a player."""
    return text("resim.report.player", "player.css")


def player(drives: Sequence[PlayedDrive], *, alone: bool = False) -> Markup:
    """Give the player of these drives, once a page; alone: it has the page for itself and may be dark."""
    if not alone:
        drives = [smaller(drive, EMBEDDED) for drive in drives]
    return html(
        '<div class="player" id="player" data-alone="{alone}">\n{layers}\n{stage}\n{transport}\n'
        '<p id="now"></p>{chart}<p id="mark" aria-live="polite"></p>\n'
        '<ul class="note" id="notes"></ul>\n'
        '<details><summary id="marks-title">Marks</summary><ol id="marks"></ol></details>\n{help}</div>\n'
        '<script type="application/json" id="player-data">{data}</script>',
        alone="yes" if alone else "no", layers=LAYERS, stage=STAGE, transport=_transport(), chart=CHART, help=HELP,
        data=to_script(drives),
    )  # fmt: skip


def smaller(drive: PlayedDrive, most: int) -> PlayedDrive:
    """Give a drive with at most so many samples of objects in each layer."""
    return replace(drive, layers=tuple(thinned(layer, most) for layer in drive.layers))


LAYERS = Markup(
    '<div class="row"><label>Drive <select id="drive"></select></label>'
    '<div id="layers" role="group" aria-label="Sources"></div>'
    '<button type="button" id="trails" aria-pressed="true">Trails</button>'
    '<button type="button" id="labels" aria-pressed="true">Labels</button>'
    '<button type="button" id="plans" aria-pressed="true">Plan</button></div>'
)
STAGE = html(
    '<div class="stage" id="stage"><canvas id="map" tabindex="0" role="img" aria-label="The drive from above. '
    'Space plays and pauses, arrow keys step, + and - zoom."></canvas>'
    '<div class="side">'
    '<button type="button" id="closer" aria-label="Zoom in">+</button>'
    '<button type="button" id="farther" aria-label="Zoom out">−</button>'
    '<button type="button" id="all" aria-label="Show the whole drive" title="Whole drive (0)">{}</button>'
    '<button type="button" id="follow" aria-label="Follow the EGO" title="Follow the EGO (F)" '
    'aria-pressed="true">{}</button>'
    '<button type="button" id="measure" aria-label="Measure a distance" title="Measure a distance (M)" '
    'aria-pressed="false">{}</button></div><div class="details" id="details" hidden></div></div>',
    ALL,
    FOLLOW,
    RULER,
)
CHART = Markup(
    '<div class="chart"><canvas id="curves" role="img" aria-label="Marks on the time line, and curves of risk, TTC, '
    'speed and acceleration. Tap to go there."></canvas><div id="cursor"></div></div>'
)
HELP = Markup(
    '<p class="note">Keys: space plays, ← → step (with shift 1 s), Home, End, comma and dot slower and faster, '
    "1 to 9 sources, F follow, M measure, T trails, L labels, P plan, N and B next and last mark, + − 0 zoom. "
    "Tap a box for its details, a mark or curve to go there. Solid: measured; dashed: re-simulated; dotted: "
    "perceived; red ring: critical. The address of the page holds the time (#t=3.2).</p>"
)


def _transport() -> Markup:
    buttons = (
        ("first", "To the start", FIRST), ("back", "Step back", BACK), ("play", "Play", PLAY + PAUSE),
        ("forth", "Step", FORTH), ("final", "To the end", FINAL),
    )  # fmt: skip
    made = join(
        html('<button type="button" id="{}" aria-label="{}">{}</button>', name, label, icon)
        for name, label, icon in buttons
    )
    return html(
        '<div class="row transport">{}<input type="range" id="time" aria-label="Time"><output id="clock"></output>'
        '<select id="speed" aria-label="Speed of playing"></select></div>',
        made,
    )
