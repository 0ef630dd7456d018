"""The player: a drive seen from above with curves and marks; a page of its own, or part of another."""

from resim.report.player.assessed import of_assessment
from resim.report.player.drive import PlayedDrive
from resim.report.player.measured import of_recording, of_scenario
from resim.report.player.page import player, player_scripts, player_styles, smaller, write_player_page
from resim.report.player.simulated import of_resimulation, of_run
from resim.report.player.varied import of_variations

__all__ = [
    "PlayedDrive",
    "of_assessment",
    "of_recording",
    "of_resimulation",
    "of_run",
    "of_scenario",
    "of_variations",
    "player",
    "player_scripts",
    "player_styles",
    "smaller",
    "write_player_page",
]
