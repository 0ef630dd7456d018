"""Every kind of label, planted by chance on maps with curves and junctions, is found, each once, and nothing else.

The scenes and their truth are those of tools/validate_planted.py, which plants more, on more maps.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from resim.mining.maneuver import label_names

ROOT = Path(__file__).parents[2]
MAPS = ("motorway", "ramps_0", "lights_0")
MORE = ("urban", "proving_ground", "u_turn_0", "stops_0")
A_SAMPLE = 0.041
"""s that starts and ends of labels may be off."""


@pytest.fixture
def tools(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))


@pytest.mark.parametrize("name", [*MAPS, *(pytest.param(name, marks=pytest.mark.slow) for name in MORE)])
def test_what_is_planted_is_found_and_nothing_else(tools: None, name: str, tmp_path: Path) -> None:
    from mining_maps import maps
    from validate_planted import KINDS, plant_all

    (file,) = [one for one in maps(ROOT / "networks", None, tmp_path, 1, 3) if one.stem == name]
    plain, _, _ = plant_all([file], KINDS, 1, 3)
    assert plain.drives >= 12
    assert {
        label: (one.misses, one.wrong) for label, one in plain.table.items() if one.misses or one.wrong
    } == {}
    assert {label: off for label, off in plain.off.items() if off > A_SAMPLE} == {}


def test_varied_maneuvers_are_found_too(tools: None, tmp_path: Path) -> None:
    from validate_planted import plant_all

    kinds = ("cut_in_left", "swerving")
    _, varied, refused = plant_all([ROOT / "networks" / "urban.xodr"], kinds, 1, 3, 1, tmp_path)
    assert varied.drives == 2
    assert refused == []
    assert {
        label: (one.misses, one.wrong) for label, one in varied.table.items() if one.misses or one.wrong
    } == {}


def test_a_way_that_joins_is_held_back_by_lights_too(tools: None, tmp_path: Path) -> None:
    from mining_maps import maps
    from validate_planted import plant_all

    (file,) = [one for one in maps(ROOT / "networks", None, tmp_path, 1, 7) if one.stem == "lights_0"]
    plain, _, _ = plant_all([file], ("protected_way",), 2, 7)
    found = plain.table["protected_way"]
    assert (found.truth, found.right, found.wrong) == (found.found, found.found, [])


def test_no_kind_of_label_is_left_out(tools: None) -> None:
    from validate_planted import KINDS

    assert set(KINDS) == set(label_names())
