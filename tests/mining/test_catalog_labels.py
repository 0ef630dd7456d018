"""Labels that the catalogs' rows want beyond Kaefer's own: by the map's lanes, and by how somebody moves."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from junction import ARM, write_junction
from mining.planted import Drive, path_of, smooth, steady, tracks_of, write_motorway

from resim.core.tracks import Tracks
from resim.jobs.generate import generate_recording
from resim.mining.features import features
from resim.mining.find import find_maneuvers
from resim.recordings import read_recording
from resim.road.driven_route import Route
from resim.road.opendrive import RoadNetwork, load

ROOT = Path(__file__).parents[2]


@pytest.fixture
def motorway(tmp_path: Path) -> RoadNetwork:
    return load(write_motorway(tmp_path / "motorway.xodr"))


def labels_of(tracks: Tracks, network: RoadNetwork) -> dict[str, list[float]]:
    """When each label begins [s]."""
    found = features(tracks, network)
    out: dict[str, list[float]] = {}
    for one in find_maneuvers(found):
        out.setdefault(one.label, []).append(float(found.samples.t[one.start]))
    return out


def write_short_sections(path: Path) -> Path:
    """The junction of our own, whose road 1 has a last section of 8 m, and a stop sign at its end."""
    text = write_junction(path).read_text()
    end = text.index("</laneSection>") + len("</laneSection>")
    section = text[text.index("<laneSection") : end]
    first = section.replace("<link></link>", '<link><successor id="-1"/></link>')
    last = section.replace('s="0"', f's="{ARM - 8.0}"', 1)
    last = last.replace("<link></link>", '<link><predecessor id="-1"/></link>')
    sign = f'<signal id="s" s="{ARM - 1.0}" t="-3" orientation="+" dynamic="no" country="DE" type="206"/>'
    signs = f"</lanes><signals>{sign}</signals></road>"
    text = text.replace(section, first + last, 1).replace("</lanes></road>", signs, 1)
    path.write_text(text)
    return path


def test_near_a_junction_is_told_over_short_lane_sections(tmp_path: Path) -> None:
    network = load(write_short_sections(tmp_path / "short.xodr"))
    path = path_of(network, "1", -1, 20.0, 150.0, Route((("1",), ("10",), ("2",))))
    back = Drive("a", lambda t: 85.0 - 1.0 * t, end=4.0, backwards=True)  # from 15 m before the junction on
    assert labels_of(tracks_of(path, [back]), network)["reversing_at_junction"] == pytest.approx(
        [0.0], abs=0.05
    )
    far = Drive("a", lambda t: 79.0 - 1.0 * t, end=4.0, backwards=True)
    assert "reversing_at_junction" not in labels_of(tracks_of(path, [far]), network)
    steadily = labels_of(tracks_of(path, [Drive("a", steady(8.0), end=18.0)]), network)
    assert steadily["run_stop_sign"] == pytest.approx([80.0 / 8.0], abs=0.1)
    stops = Drive("a", lambda t: np.clip(8.0 * t, None, 88.0) + 8.0 * np.clip(t - 14.0, 0.0, None), end=20.0)
    assert "run_stop_sign" not in labels_of(tracks_of(path, [stops]), network)  # 12 m before the junction


@pytest.mark.parametrize(("across", "label"), [(0.0, "straight"), (3.5, "")])
def test_who_leaves_a_junction_on_the_other_side_of_the_road_makes_no_u_turn(
    tmp_path: Path, across: float, label: str
) -> None:
    network = load(write_junction(tmp_path / "junction.xodr"))
    path = path_of(network, "1", -1, 60.0, 150.0, Route((("1",), ("10",), ("2",))))
    drive = Drive("a", steady(10.0), lambda t: smooth(t, 6.9, 1.0, across), end=11.0)
    ways = {"straight", "turn_left", "turn_right", "u_turn"}
    assert ways & set(labels_of(tracks_of(path, [drive]), network)) == ({label} if label else set())


def test_who_stays_on_the_road_does_so_to_the_end(motorway: RoadNetwork) -> None:
    path = path_of(motorway, "7", -1, 20.0, 250.0)
    stays = Drive("a", steady(0.1), end=12.0, kind="pedestrian", length=0.5, width=0.5)
    found = features(tracks_of(path, [stays]), motorway)
    (one,) = [one for one in find_maneuvers(found) if one.label == "staying_on_road"]
    assert found.samples.t[[one.start, one.end]] == pytest.approx([0.0, 12.0])


def test_the_road_gets_lanes_and_loses_them(motorway: RoadNetwork) -> None:
    path = path_of(motorway, "7", -1, 250.0, 300.0)
    told = labels_of(tracks_of(path, [Drive("a", steady(20.0), end=14.0)]), motorway)
    assert told["road_widens"] == pytest.approx([50.0 / 20.0], abs=0.05)
    assert told["lane_ends"] == pytest.approx([250.0 / 20.0], abs=0.1)


def test_who_leaves_the_road_at_its_side_and_who_leaves_the_map(motorway: RoadNetwork) -> None:
    path = path_of(motorway, "7", -2, 20.0, 250.0)
    away = Drive("a", steady(20.0), lambda t: -smooth(t, 2.0, 5.0, 3.5), end=9.0)
    (begins,) = labels_of(tracks_of(path, [away]), motorway)["leave_road"]
    assert begins == pytest.approx(4.5, abs=0.1)
    end = path_of(motorway, "7", -2, 1500.0, 99.0)
    assert "leave_road" not in labels_of(tracks_of(end, [Drive("a", steady(20.0), end=4.9)]), motorway)


def test_who_is_beside_the_road_for_a_moment_has_not_left_it(motorway: RoadNetwork) -> None:
    path = path_of(motorway, "7", -2, 20.0, 250.0)
    away = Drive("a", steady(20.0), lambda t: -smooth(t, 2.0, 1.0, 2.0) + smooth(t, 3.0, 1.0, 2.0), end=9.0)
    tracks = tracks_of(path, [away])
    assert "leave_road" not in labels_of(tracks, motorway)
    cut = replace(tracks, valid=tracks.valid & (tracks.t <= 3.0))
    assert len(labels_of(cut, motorway)["leave_road"]) == 1  # seen no more, it did not come back


def test_both_who_touch_sides_do(motorway: RoadNetwork) -> None:
    """Boxes that overlap as much along as across, as seen by the one, and less, as seen by the other."""
    path = path_of(motorway, "7", -1, 250.0, 300.0)
    for angle in (0.1, 0.3, 0.5):
        for along in np.linspace(2.0, 4.4, 13):
            ahead = Drive("b", lambda t, along=along: along + 20.0 * t, end=0.4)
            tracks = tracks_of(path, [Drive("a", steady(20.0), end=0.4), ahead])
            turned = np.array([[0.0], [angle]])
            told = labels_of(replace(tracks, heading=tracks.heading + turned), motorway)
            assert len(told["collision"]) == 2
            assert len(told.get("sideswipe", ())) in (0, 2)


def test_a_map_without_any_light_or_sign_says_nothing_of_who_has_the_way(tmp_path: Path) -> None:
    made = generate_recording(
        ROOT / "scenarios" / "catalog" / "generate" / "urban_unprotected_left.toml", tmp_path / "out"
    )
    recording = read_recording(made.folder)
    bare = tmp_path / "bare.xodr"
    bare.write_text(
        re.sub("<signals>.*?</signals>", "", recording.map.read_text("utf-8"), flags=re.S), "utf-8"
    )
    assert "unprotected_way" in labels_of(recording.gt, load(recording.map))
    told = labels_of(recording.gt, load(bare))
    assert "turn_left" in told
    assert "unprotected_way" not in told


def test_who_skids_moves_across_its_heading(motorway: RoadNetwork) -> None:
    path = path_of(motorway, "7", -1, 20.0, 250.0)
    tracks = tracks_of(path, [Drive("a", steady(20.0), end=10.0)])
    off = smooth(tracks.t, 4.0, 1.0, 0.5) - smooth(tracks.t, 6.0, 1.0, 0.5)
    assert "skidding" not in labels_of(tracks, motorway)
    (begins,) = labels_of(replace(tracks, heading=tracks.heading + off), motorway)["skidding"]
    assert begins == pytest.approx(4.5, abs=0.1)


def test_who_stood_drives_off(motorway: RoadNetwork) -> None:
    path = path_of(motorway, "7", -1, 20.0, 250.0)
    way = Drive("a", lambda t: np.clip(t - 3.0, 0.0, None) ** 2, end=8.0)
    told = labels_of(tracks_of(path, [way]), motorway)
    assert told["starting"] == pytest.approx([3.05], abs=0.05)
