"""Several drives above each other in the player."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

from resim.core.errors import InputError
from resim.jobs.play import played_drive
from resim.report.player.colors import layer_colors
from resim.report.player.drive import Danger, PlayedDrive, TimelineMark
from resim.report.player.page import page
from resim.report.player.together import together
from resim.road.opendrive import load


@pytest.fixture(scope="module")
def drives() -> tuple[PlayedDrive, PlayedDrive]:
    one, other = (played_drive(ROOT / "scenarios" / name) for name in ("cut_in_brake", "rear_end"))
    return one, other


def test_sources_of_all_drives_are_layers_with_colours_of_their_own(
    drives: tuple[PlayedDrive, PlayedDrive],
) -> None:
    one, other = drives
    mark = TimelineMark("collision", 1.0, 1.0, "GT", "", "bump")
    layers = []
    for layer in other.layers:
        ids = ["another" if name == one.ego else name for name in layer.tracks.ids.tolist()]
        layers.append(replace(layer, tracks=replace(layer.tracks, ids=np.array(ids, object))))
    other = replace(other, ego="another", marks=(mark,), layers=tuple(layers))
    zero = np.zeros(1)
    danger = Danger(zero, zero, ("",), zero, ("",), zero > 1.0)
    judged = replace(one, layers=tuple(replace(layer, danger=danger) for layer in one.layers))
    found = together([one, other, judged])
    assert found.layers[0].danger is judged.layers[0].danger  # only the third was judged
    assert [layer.name for layer in found.layers] == [
        "GT",
        "SD",
        "GT 2",
        "SD 2",
    ]  # the third is the first once more
    assert found.notes[-1] == "3: cut_in_brake: GT, SD exactly as above, shown once"
    assert all(found.ego in layer.tracks.ids for layer in found.layers)
    assert [layer.is_sensed for layer in found.layers] == [False, True, False, True]
    assert [m.source for m in found.marks if m.text.endswith("bump")] == ["GT 2"]
    colors = [layer_colors(layer.name, layer.of) for layer in found.layers]
    assert len({c.ego for c in colors[:3]}) == 3
    assert colors[3].fill == colors[1].fill  # sensed is drawn as sensed
    text = page([found])
    assert '"GT 2"' in text
    assert "cut_in_brake and rear_end" in text


def test_drives_on_other_maps_are_refused(drives: tuple[PlayedDrive, PlayedDrive]) -> None:
    other = replace(drives[1], network=load(ROOT / "networks" / "urban.xodr"))
    with pytest.raises(InputError, match="is on another map than cut_in_brake"):
        together([drives[0], other])


def test_sources_of_one_drive_that_are_alike_are_all_there(drives: tuple[PlayedDrive, PlayedDrive]) -> None:
    gt = drives[0].layers[0]
    replayed = replace(drives[0], layers=(gt, replace(gt, name="rGT")))  # as of a build that replays
    assert [layer.name for layer in together([replayed, replayed]).layers] == ["GT", "rGT"]
