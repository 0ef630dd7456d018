"""Who is on a bridge and who is under it cannot meet; whoever may be on one level can."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import DATA, ROOT
from crossing import (
    BRIDGE,
    DECK,
    DOWN,
    FLAT,
    ROAD,
    SHORT,
    UP,
    bridge_height,
    crossing_rows,
    elevation,
    straight,
    write_map,
    write_recording,
)
from lxml import etree

from resim.core.objects import ObjectIds
from resim.core.tracks import Tracks
from resim.metrics.measures.values import State
from resim.perception.model import PerceptionModel
from resim.recordings import read_recording
from resim.recordings.checked import load_checked, repair_recording
from resim.recordings.checks import CODES
from resim.resimulation import AssessmentOptions, assess_recording, assess_resimulation, resimulate
from resim.resimulation.perceived import PerceptionSetup
from resim.resimulation.run import describe_recording, over_seeds
from resim.resimulation.tables import tracks_frame
from resim.road.measured_heights import HeightTrack, measured_heights
from resim.road.opendrive import load
from resim.road.path import lane_path
from resim.scenario.jscen import read_jscen, write_jscen
from resim.scenario.variation import vary
from resim.simulation.function.interface import load_build

BUILDS = ROOT / "adfunc" / "builds"


def under(t, x, y):
    return np.zeros(len(t))


def over(t, x, y):
    return bridge_height(y)


def on_grade(t, x, y):
    return np.full(len(t), 5.0)


def assessed(recording, basis="GT"):
    return assess_recording(recording, AssessmentOptions()).blocks[basis]


def meets(found) -> bool:
    """Whether anything says that the EGO meets the other car."""
    ttc = found.measures["TTC"]
    return bool(
        found.contacts
        or ((ttc.state == State.VALUE) & (np.nan_to_num(ttc.value, nan=np.inf) < 1.0)).any()
        or np.nanmax(found.measures["collision"].value) > 0.0
        or np.nanmax(found.risk.r_ind) > 0.5
    )


def test_a_bridge_and_the_road_below_are_found(tmp_path):
    network = load(write_map(tmp_path / "map.xodr", north=BRIDGE))
    x, y = np.zeros(3), np.full(3, -1.75)
    at = network.to_road(x, y, heading=np.full(3, 0.7), z=np.array([0.2, DECK - 0.4, np.nan]))
    assert at.road.tolist()[:2] == ["1", "2"]
    assert at.road[2] == network.to_road(x, y, heading=np.full(3, 0.7)).road[2]
    nowhere = network.to_road(x, y, heading=np.full(3, 0.7), z=np.full(3, 50.0))
    assert nowhere.road.tolist() == network.to_road(x, y, heading=np.full(3, 0.7)).road.tolist()
    point, heights = network.surfaces(x[:1], y[:1])
    assert set(point.tolist()) == {0}
    assert sorted(set(np.round(heights, 6))) == pytest.approx([0.0, DECK])


def test_from_a_ramp_on_nobody_meets_who_drives_over_a_short_bridge(tmp_path):
    """On the ramp its grade tells nothing of the bridge beyond: what little is predicted there stays little."""
    rows = crossing_rows(under, lambda t, x, y: bridge_height(y, 20.0))
    found = assessed(write_recording(tmp_path, rows, north=SHORT))
    assert not meets(found)
    assert np.nanmax(found.risk.r_ind) < 0.01


def test_nobody_meets_who_drives_over_the_bridge(tmp_path):
    found = assessed(write_recording(tmp_path, crossing_rows(under, over), north=BRIDGE))
    assert not meets(found)
    assert np.nanmax(found.risk.r_ind) == 0.0
    assert not (found.measures["gap ahead"].state == State.VALUE).any()
    ttc = found.measures["TTC"]
    assert not ((ttc.state == State.VALUE) & (np.nan_to_num(ttc.value, nan=np.inf) < 3.0)).any()


@pytest.mark.parametrize(
    "heights", [(None, None), (under, None), (None, over), (under, lambda t, x, y: np.nan * t)]
)
def test_without_both_heights_they_meet(tmp_path, heights):
    """And all is as without any."""
    bare = assessed(write_recording(tmp_path / "bare", crossing_rows(), north=BRIDGE))
    found = assessed(write_recording(tmp_path / "some", crossing_rows(*heights), north=BRIDGE))
    assert meets(found)
    for name, measure in bare.measures.items():
        np.testing.assert_array_equal(found.measures[name].value, measure.value, name)


def test_at_grade_they_meet(tmp_path):
    rows = crossing_rows(on_grade, on_grade)
    bare = assessed(write_recording(tmp_path / "bare", rows.drop(columns="z"), east=FLAT, north=FLAT))
    found = assessed(write_recording(tmp_path / "z", rows, east=FLAT, north=FLAT))
    assert meets(found)
    for name, measure in bare.measures.items():
        np.testing.assert_array_equal(found.measures[name].value, measure.value, name)


NOISE = np.random.default_rng(5).normal(0.0, 0.5, (2, 201))


@pytest.mark.parametrize(
    ("z_ego", "z_other"),
    [
        (on_grade, lambda t, x, y: np.full(len(t), 11.0)),
        (lambda t, x, y: np.full(len(t), -1.0), on_grade),
        (on_grade, lambda t, x, y: np.where(np.abs(t - 6.0) < 1.0, 11.0, 5.0)),
        (on_grade, lambda t, x, y: np.where(t > 4.0, 11.0, 5.0)),
        (lambda t, x, y: 5.0 + NOISE[0], lambda t, x, y: 5.0 + NOISE[1]),
        (lambda t, x, y: 51.3 + 0.0 * t, lambda t, x, y: 45.3 + 0.0 * t),
        (on_grade, lambda t, x, y: 5.0 + 1.2 * t),
        (lambda t, x, y: 7.4 + 0.0 * t, lambda t, x, y: 3.0 + 0.0 * t),
        (on_grade, lambda t, x, y: 7.4 + 0.0 * t),
    ],
    ids=[
        "one wrong",
        "EGO wrong",
        "jumps",
        "jumps for good",
        "noise",
        "two datums",
        "drifts",
        "both off",
        "one off",
    ],
)
def test_a_wrong_height_parts_nobody(tmp_path, z_ego, z_other):
    rows = crossing_rows(z_ego, z_other)
    assert meets(assessed(write_recording(tmp_path, rows, east=FLAT, north=FLAT)))


HIGH = elevation((0.0, 11.0, 0.0, 0.0, 0.0))


def onto(x):
    return np.where(np.asarray(x) > -59.0, 11.0, 5.0)


def unknown_around(x, way):
    return np.where(np.abs(np.asarray(x) + 59.0) < 0.5 * way, np.nan, onto(x))


@pytest.mark.parametrize("who", ["ego", "lead"])
@pytest.mark.parametrize(
    ("height", "every"),
    [
        (onto, 0.05),
        (onto, 0.7),
        (onto, 1.0),
        *((lambda x, way=way: unknown_around(x, way), 0.05) for way in (6.0, 10.0, 20.0, 30.0)),
        *(
            (lambda x, way=way: 5.0 + 6.0 * np.clip((x + 60.0) / way + 0.5, 0.0, 1.0), 0.05)
            for way in (12.0, 20.0, 30.0)
        ),
    ],
)
def test_nobody_leaps_onto_the_road_above(tmp_path, who, height, every):
    """Under a deck a height becomes that of the deck, as no car can climb it: by one sample, unseen, or steeply."""
    t = np.arange(0.0, 12.01, every)
    ego, lead = (
        straight("ego", t, -150.0, -1.75, 0.0, 20.0, 5.0),
        straight("lead", t, -70.0, -1.75, 0.0, 10.0, 5.0),
    )
    wrong = ego if who == "ego" else lead
    wrong["z"] = height(wrong["x"].to_numpy())
    rows = pd.concat([ego, lead]).sort_values("t", kind="stable")
    recording = write_recording(tmp_path, rows, east=FLAT, north=FLAT, deck=HIGH)
    assert meets(assessed(recording))
    told = [f for f in load_checked(tmp_path, accept=tuple(CODES)).findings if f.code == "HEIGHT"]
    assert [f.object for f in told] == [who]
    drive = resimulate(recording, load_build(BUILDS / "constant_velocity-1.0.toml")).drives["rGT"]
    assert [c.id for c in drive.collisions] == ["lead"]


@pytest.mark.parametrize("between", [False, True])
@pytest.mark.parametrize("switch", [0.05, 0.5, 0.95])
def test_who_gets_another_id_does_not_leap_onto_the_road_above(tmp_path, switch, between):
    """The leader is seen under another id, as high as the deck there; or under two, one of which has no height."""
    t = np.arange(0.0, 12.01, 0.05)
    ego, lead = (
        straight("ego", t, -150.0, -1.75, 0.0, 20.0, 5.0),
        straight("lead", t, -70.0, -1.75, 0.0, 10.0, 5.0),
    )
    after = t > 2.0 + switch - 0.04
    lead.loc[after, ["id", "z"]] = ["again", 11.0]
    if between:
        lead.loc[after & (t < 4.0), ["id", "z"]] = ["without", np.nan]
    lead.loc[t > 8.0, "id"] = "third"
    lead = lead[after | (t < 2.0)]
    rows = pd.concat([ego, lead]).sort_values("t", kind="stable")
    recording = write_recording(tmp_path, rows, east=FLAT, north=FLAT, deck=HIGH)
    assert meets(assessed(recording))
    told = [f for f in load_checked(tmp_path, accept=tuple(CODES)).findings if f.code == "HEIGHT"]
    assert {"lead", "again", "third"} <= {f.object for f in told}


def test_many_parts_without_heights_are_looked_at_at_once(tmp_path):
    """Of two hundred parts each can go on as several of the others."""
    network = load(write_map(tmp_path / "map.xodr", east=FLAT, north=FLAT, deck=HIGH))
    parts = [
        HeightTrack(
            str(n), np.array([0.2 * n, 0.2 * n + 0.1]), np.zeros(2), np.full(2, -1.75), np.full(2, np.nan)
        )
        for n in range(200)
    ]
    for n, z in ((0, 5.0), (199, 11.0)):
        parts[n].z[:] = z
    assert set(measured_heights(parts, network).doubted) == set(range(200))


@pytest.mark.parametrize(
    ("deck", "z_ego", "z_lead"), [(4.9, 2.4, 2.46), (4.9, 2.3, 2.6), (5.0, 2.45, 2.55), (3.0, 0.6, 1.6)]
)
def test_between_two_roads_a_height_tells_neither(tmp_path, deck, z_ego, z_lead):
    """Both are on the lower road."""
    t = np.arange(0.0, 12.01, 0.05)
    ego = straight("ego", t, -150.0, -1.75, 0.0, 20.0, 5.0 + z_ego)
    lead = straight("lead", t, -70.0, -1.75, 0.0, 10.0, 5.0 + z_lead)
    rows = pd.concat([ego, lead]).sort_values("t", kind="stable")
    above = elevation((0.0, 5.0 + deck, 0.0, 0.0, 0.0))
    assert meets(assessed(write_recording(tmp_path, rows, east=FLAT, north=FLAT, deck=above)))


@pytest.mark.parametrize(("grade", "v"), [(0.12, 36.0), (0.1, 45.0), (0.15, 30.0)])
def test_on_a_sharp_crest_they_meet(tmp_path, grade, v):
    """The road to the east goes up and down; that to the north crosses it on top."""
    crest = elevation((0.0, 0.0, grade, 0.0, 0.0), (300.0, 300.0 * grade, -grade, 0.0, 0.0))
    top = elevation((0.0, 300.0 * grade, 0.0, 0.0, 0.0))
    t = np.arange(0.0, 8.01, 0.05)
    ego = straight("ego", t, -6.0 * v, -1.75, 0.0, v)
    other = straight("over", t, 1.75, -38.0, 0.5 * np.pi, 6.0)
    ego["z"], other["z"] = grade * (300.0 - np.abs(ego["x"])), 300.0 * grade
    rows = pd.concat([ego, other]).sort_values("t", kind="stable")
    recording = write_recording(tmp_path, rows, east=crest, north=top)
    assert assessed(recording).contacts
    drive = resimulate(recording, load_build(BUILDS / "constant_velocity-1.0.toml")).drives["rGT"]
    assert [c.id for c in drive.collisions] == ["over"]


def test_beside_all_lanes_no_height_counts(tmp_path):
    """A car stands with its centre on the lane at first, then beside it, where nothing bears out that it rises."""
    t = np.arange(0.0, 12.01, 0.05)
    ego, car = straight("ego", t, -150.0, -2.5, 0.0, 20.0, 5.0), straight("car", t, 60.0, 0.0, 0.0, 0.0)
    car["y"] = np.interp(t, [0.5, 1.5], [-3.3, -4.2])
    car["z"] = 5.0 + np.clip(2.0 * (t - 1.6), 0.0, 6.0)
    rows = pd.concat([ego, car]).sort_values("t", kind="stable")
    assert meets(assessed(write_recording(tmp_path, rows, east=FLAT, north=FLAT)))


def test_on_a_map_without_heights_nobody_is_apart(tmp_path):
    """Nothing bears the heights out."""
    assert meets(assessed(write_recording(tmp_path, crossing_rows(under, over))))


@pytest.mark.parametrize("sd_above", [6.0, -6.0, 46.0])
def test_heights_of_sensor_data_in_another_system_part_nobody(tmp_path, sd_above):
    """The GT's EGO stands in for the SD's: its height is of another source."""
    gt = crossing_rows(on_grade, on_grade)
    sd = gt[gt["id"] != "ego"].assign(z=5.0 + sd_above)
    found = assessed(write_recording(tmp_path, gt, sd=sd, east=FLAT, north=FLAT), "SD")
    assert meets(found)


def test_heights_of_one_source_alone_part_nobody_in_the_other(tmp_path):
    gt = crossing_rows(under, over)
    sd = gt[gt["id"] != "ego"]
    recording = write_recording(tmp_path / "gt", gt, sd=sd.drop(columns="z"), north=BRIDGE)
    assert meets(assessed(recording, "SD"))
    assert not meets(assessed(recording))
    recording = write_recording(tmp_path / "sd", gt.drop(columns="z"), sd=sd, north=BRIDGE)
    assert meets(assessed(recording, "SD"))
    assert meets(assessed(recording))


@pytest.mark.parametrize("above", [46.2, -3.9])
def test_heights_that_are_all_off_by_one_amount_count(tmp_path, above):
    rows = crossing_rows(lambda *at: above + under(*at), lambda *at: above + over(*at))
    recording = write_recording(tmp_path, rows, north=BRIDGE)
    assert not meets(assessed(recording))
    (told,) = [f for f in load_checked(tmp_path).findings if f.code == "HEIGHT"]
    assert told.severity == "note"
    assert told.value == pytest.approx(above, abs=0.1)


def test_noise_does_not_bring_them_to_one_level(tmp_path):
    rows = crossing_rows(lambda *at: under(*at) + NOISE[0], lambda *at: over(*at) + NOISE[1])
    assert not meets(assessed(write_recording(tmp_path, rows, north=BRIDGE)))


def test_a_check_tells_whose_height_is_wrong_and_who_is_not_in_whom(tmp_path):
    rows = crossing_rows(on_grade, lambda t, x, y: np.full(len(t), 11.0))
    write_recording(tmp_path / "wrong", rows, east=FLAT, north=FLAT)
    told = [f for f in load_checked(tmp_path / "wrong", accept=tuple(CODES)).findings if f.code == "HEIGHT"]
    assert [(f.source, f.object) for f in told] == [("gt", "over")]
    t = np.arange(0.0, 6.0, 0.05)
    parked = [
        straight(n, t, 0.0, y, h, 0.0, z)
        for n, y, h, z in (("a", -1.75, 0.0, 0.0), ("b", -1.5, 0.5 * np.pi, DECK))
    ]
    ego = straight("ego", t, -200.0, -1.75, 0.0, 5.0, 0.0)
    together = pd.concat([ego, *parked])
    for name, rows, code in (("z", together, False), ("bare", together.drop(columns="z"), True)):
        write_recording(tmp_path / name, rows.sort_values("t", kind="stable"), north=BRIDGE)
        found = load_checked(tmp_path / name, accept=tuple(CODES)).findings
        assert any(f.code == "OVERLAP" for f in found) is code


SLOPE = elevation((0.0, 0.0, 0.06, 0.0, 0.0))


def climb(x):
    """A flyover: 6 m up within 100 m before x = 0, and level from there on."""
    u = np.clip((np.asarray(x) + 100.0) / 100.0, 0.0, 1.0)
    return DECK * (3.0 * u**2 - 2.0 * u**3)


CLIMB = elevation((0.0, 0.0, 0.0, 0.0, 0.0), (200.0, 0.0, 0.0, UP, -DOWN), (300.0, DECK, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("east", "height", "gap"),
    [(SLOPE, lambda x: 0.06 * (x + 300.0), 60.0)]
    + [(CLIMB, climb, gap) for gap in (30.0, 60.0, 90.0, 120.0, 150.0, 200.0)],
)
def test_a_leader_up_the_road_stays_the_leader(tmp_path, east, height, gap):
    t = np.arange(0.0, 8.0, 0.05)
    rows = pd.concat(
        [straight("ego", t, -250.0, -1.75, 0.0, 20.0), straight("lead", t, gap - 250.0, -1.75, 0.0, 10.0)]
    )
    rows = rows.assign(z=height(rows["x"])).sort_values("t", kind="stable")
    bare = assessed(write_recording(tmp_path / "bare", rows.drop(columns="z"), east=east))
    found = assessed(write_recording(tmp_path / "z", rows, east=east))
    for name in ("TTC", "gap ahead", "THW", "collision", "risk"):
        np.testing.assert_array_equal(found.measures[name].value, bare.measures[name].value, name)


@pytest.mark.parametrize("build", ["constant_velocity-1.0", "idm-1.0", "highway_pilot-1.0"])
def test_a_simulated_drive_under_the_bridge_goes_on(tmp_path, build):
    made = load_build(BUILDS / f"{build}.toml")
    result = resimulate(write_recording(tmp_path / "z", crossing_rows(under, over), north=BRIDGE), made)
    drive = result.drives["rGT"]
    assert drive.end == "duration"
    assert drive.collisions == ()
    assert drive.left_route is None
    truth = drive.truth
    assert truth.z is not None
    np.testing.assert_allclose(truth.z[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(truth.z[1], bridge_height(truth.y[1]), atol=0.25)
    seen = drive.perceived[len(drive.perceived) // 2]
    assert seen.z_ego is not None
    assert seen.z_ego.shape == seen.x_ego.shape
    away = resimulate(
        write_recording(tmp_path / "alone", _alone(crossing_rows(under, over)), north=BRIDGE), made
    )
    alone = away.drives["rGT"].truth
    np.testing.assert_allclose(
        truth.x[0], alone.x[0, : truth.x.shape[1]], atol=1e-9
    )  # it minds nobody above it


def _alone(rows):
    """The EGO, and the other car far behind on its own road."""
    return rows.assign(y=np.where(rows["id"] == "ego", rows["y"], rows["y"] - 200.0)).assign(z=np.nan)


def test_a_simulated_drive_at_grade_ends_in_the_collision(tmp_path):
    made = load_build(BUILDS / "constant_velocity-1.0.toml")
    grade = write_recording(tmp_path / "grade", crossing_rows(on_grade, on_grade), east=FLAT, north=FLAT)
    bare = write_recording(tmp_path / "bare", crossing_rows(), north=BRIDGE)
    for recording in (grade, bare):
        drive = resimulate(recording, made).drives["rGT"]
        assert drive.end == "collision"
        assert [c.id for c in drive.collisions] == ["over"]


@pytest.mark.parametrize(("up", "down"), [(0.08, -0.08), (0.08, 0.0), (0.15, 0.0)])
@pytest.mark.parametrize("upper", [True, False])
def test_where_a_road_splits_into_two_decks_a_simulated_drive_still_collides(tmp_path, up, down, upper):
    """Nobody knows on which of them the simulated EGO is once they part."""
    t, grade = np.arange(0.0, 12.01, 0.05), up if upper else down
    ego, other = straight("ego", t, -100.0, -1.75, 0.0, 18.0), straight("o", t, 90.0, -1.75, 0.0, 0.0)
    ego["z"], other["z"] = grade * np.maximum(ego["x"], 0.0), grade * 90.0
    rows = pd.concat([ego, other]).sort_values("t", kind="stable")
    write_recording(tmp_path, rows)
    decks = [
        ROAD.format(id=1, length=300.0, x=-300.0, y=0, heading=0, elevation=elevation((0.0,) * 5)),
        ROAD.format(id=2, length=400.0, x=0.0, y=0, heading=0, elevation=elevation((0.0, 0.0, up, 0.0, 0.0))),
        ROAD.format(
            id=3, length=400.0, x=0.0, y=0, heading=0, elevation=elevation((0.0, 0.0, down, 0.0, 0.0))
        ),
    ]
    text = f'<OpenDRIVE><header revMajor="1" revMinor="6" name=""/>{"".join(decks)}</OpenDRIVE>'
    (tmp_path / "map.xodr").write_text(text)
    drive = resimulate(read_recording(tmp_path), load_build(BUILDS / "constant_velocity-1.0.toml")).drives[
        "rGT"
    ]
    assert [c.id for c in drive.collisions] == ["o"]


@pytest.mark.parametrize("gap", [8.0, 12.0, 15.0, 25.0])
@pytest.mark.parametrize("above", [2.4, 3.4, 5.0])
def test_after_a_gap_in_the_map_a_simulated_drive_is_not_on_the_road_below(tmp_path, gap, above):
    """The lower road begins before the upper one, on which all are, goes on."""
    t = np.arange(0.0, 12.01, 0.05)
    ego, other = (
        straight("ego", t, -100.0, -1.75, 0.0, 20.0, above),
        straight("o", t, -65.0, -1.75, 0.0, 17.0, above),
    )
    write_recording(tmp_path, pd.concat([ego, other]).sort_values("t", kind="stable"))
    parts = ((1, -300.0, 300.0, above), (2, gap, 300.0, above), (3, gap - 2.0, 300.0, 0.0))
    decks = [
        ROAD.format(id=n, length=length, x=x, y=0, heading=0, elevation=elevation((0.0, z, 0.0, 0.0, 0.0)))
        for n, x, length, z in parts
    ]
    text = f'<OpenDRIVE><header revMajor="1" revMinor="6" name=""/>{"".join(decks)}</OpenDRIVE>'
    (tmp_path / "map.xodr").write_text(text)
    drive = resimulate(read_recording(tmp_path), load_build(BUILDS / "constant_velocity-1.0.toml")).drives[
        "rGT"
    ]
    assert drive.end == "off_road" or [c.id for c in drive.collisions] == ["o"]


def test_a_scenario_keeps_heights_in_its_file(tmp_path):
    made = load_build(BUILDS / "constant_velocity-1.0.toml")
    result = resimulate(write_recording(tmp_path, crossing_rows(under, over), north=BRIDGE), made)
    scenario = result.described["GT"]
    write_jscen(scenario, tmp_path / "a.json")
    again = read_jscen(tmp_path / "a.json")
    t = np.linspace(0.0, 10.0, 57)
    for one in (scenario, again):
        z = one.tracks(result.network, t).z
        assert z is not None
        np.testing.assert_allclose(z[1], bridge_height(-84.0 + 14.0 * t), atol=0.25)
    write_jscen(again, tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


TOWN = DATA / "xodr" / "carla" / "Town04.xodr"


def written_height(road: str, s: float) -> float:
    """The height that the file says, by its own elements."""
    records = etree.parse(TOWN).getroot().findall(f"road[@id='{road}']/elevationProfile/elevation")
    a = [{name: float(value) for name, value in record.items()} for record in records]
    last = [record for record in a if record["s"] <= s][-1]
    ds = s - last["s"]
    return last["a"] + ds * (last["b"] + ds * (last["c"] + ds * last["d"]))


@pytest.mark.slow
@pytest.mark.skipif(not TOWN.is_file(), reason="no shared data")
def test_on_a_real_map_the_motorway_passes_over_the_road(tmp_path):
    """Road 39 lies 11 m over road 47 where they cross, without a junction."""
    network = load(TOWN)
    ways = [lane_path(network, "47", -4, 30.0, 60.0), lane_path(network, "39", -4, 20.0, 60.0)]
    s = np.arange(0.0, 60.0, 0.1)
    (x, y), (x2, y2) = (way.xy(s, 0.0 * s) for way in ways)
    i, j = np.unravel_index(np.hypot(x[:, None] - x2, y[:, None] - y2).argmin(), (len(s), len(s)))
    t = np.arange(0.0, 6.0, 0.05)
    rows = []
    for name, way, meets_at, z in (
        ("ego", ways[0], s[i], written_height("47", 60.0)),
        ("over", ways[1], s[j], 11.0),
    ):
        at = meets_at + 8.0 * (t - 3.0)
        x, y = way.xy(at, 0.0 * at)
        told = {
            "t": np.round(t, 6),
            "id": name,
            "x": x,
            "y": y,
            "heading": np.interp(at, way.s, way.heading),
            "v": 8.0,
        }
        rows.append(pd.DataFrame({**told, "length": 4.7, "width": 1.9, "kind": "car", "z": z}))
    assert written_height("39", 47.86) == pytest.approx(11.0)
    assert written_height("47", 59.82) == pytest.approx(0.0)
    gt = pd.concat(rows).sort_values("t", kind="stable")
    found = {}
    for name, table in (("z", gt), ("bare", gt.drop(columns="z"))):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "recording.toml").write_text(
            f'name = "town"\nmap = "{TOWN}"\nego = "ego"\n', encoding="utf-8"
        )
        table.to_csv(folder / "gt.csv", index=False)
        found[name] = meets(assessed(read_recording(folder)))
    assert found == {"z": False, "bare": True}
    drive = resimulate(
        read_recording(tmp_path / "z"), load_build(BUILDS / "constant_velocity-1.0.toml")
    ).drives["rGT"]
    assert drive.end == "duration"
    assert drive.truth.z is not None
    np.testing.assert_allclose(drive.truth.z[0], 0.0, atol=0.5)


@pytest.mark.parametrize("latency", [0.0, 0.3])
def test_a_perception_model_tells_the_height_of_the_place_that_it_tells(tmp_path, latency):
    made = load_build(BUILDS / "constant_velocity-1.0.toml")
    rows = crossing_rows(under, lambda t, x, y: bridge_height(y, 20.0))
    prepared = resimulate(write_recording(tmp_path, rows, north=SHORT), made)
    model = PerceptionModel.model_validate(
        {"schema": "resim-perception-1", "name": "late", "latency": {"position": latency}}
    )
    *_, last = over_seeds(prepared, PerceptionSetup(model, (1,)))
    (drive,) = last.perceived().values()
    for seen in drive.perceived:
        _, y = seen.map_positions()
        assert seen.z_ego is not None
        np.testing.assert_allclose(seen.z_ego, bridge_height(y, 20.0), atol=0.25)
    assert drive.end == "duration"


def test_results_have_heights_and_are_judged_by_them(tmp_path):
    made = load_build(BUILDS / "constant_velocity-1.0.toml")
    result = resimulate(write_recording(tmp_path, crossing_rows(under, over), north=BRIDGE), made)
    table = tracks_frame(result)
    for source in ("GT", "rGT"):
        rows = table[(table["source"] == source) & (table["id"] == "over")]
        np.testing.assert_allclose(rows["z"], bridge_height(rows["y"]), atol=0.25)
    blocks = assess_resimulation(result, AssessmentOptions()).blocks
    assert not meets(blocks["rGT"])


def test_a_repaired_gap_has_the_heights_between(tmp_path):
    rows = crossing_rows(under, lambda t, x, y: bridge_height(y, 20.0))
    write_recording(
        tmp_path / "gap", rows[~((rows["id"] == "over") & rows["t"].between(1.5, 2.0))], north=SHORT
    )
    repair_recording(tmp_path / "gap", tmp_path / "whole")
    again = pd.read_csv(tmp_path / "whole" / "gt.csv")
    filled = again[(again["id"] == "over") & again["t"].between(1.49, 2.01)]
    assert len(filled) == 11
    np.testing.assert_allclose(filled["z"], bridge_height(filled["y"], 20.0), atol=0.25)


def test_who_is_varied_has_the_height_of_the_road_where_it_is_then(tmp_path):
    rows = crossing_rows(under, lambda t, x, y: bridge_height(y, 20.0))
    recording = write_recording(tmp_path, rows, north=SHORT)
    network = load(recording.map)
    varied = vary(describe_recording(recording, network)["GT"], network, "over", "gap", 20.0)
    tracks = varied.tracks(network, np.linspace(0.0, 10.0, 101))
    assert tracks.z is not None
    np.testing.assert_allclose(tracks.y[1], -64.0 + 14.0 * tracks.t, atol=0.1)
    np.testing.assert_allclose(tracks.z[1], bridge_height(tracks.y[1], 20.0), atol=0.3)


def test_one_above_the_other_are_two_objects():
    """At one place at all times, and on two levels: neither speaks for the other."""
    t = np.arange(0.0, 3.0, 0.1)
    rows = [
        straight(name, t, x, 0.0, 0.0, 0.0, z)
        for name, x, z in (("ego", -50.0, 0.0), ("a", 0.0, 0.0), ("b", 0.5, DECK))
    ]
    tracks = Tracks.from_frame(pd.concat(rows))
    for seen, two in ((tracks, True), (replace(tracks, z=None), False)):
        whom = ObjectIds.of(seen, ego="ego")
        assert whom.apart(*whom.others) is two
