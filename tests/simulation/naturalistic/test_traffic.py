"""Traffic from SUMO: on the map's lanes, its truth where the motion is, nobody in anybody, the same for a seed."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from resim.core.distribution import RandomNumber, constant
from resim.core.errors import InputError
from resim.core.overlaps import first_overlaps
from resim.jobs.check import check
from resim.jobs.traffic import make_traffic
from resim.recordings import read_recording
from resim.recordings.formats.highd import read_highd
from resim.road.opendrive import load
from resim.road.sumo import sumo_net
from resim.simulation.naturalistic.demand import read_edges, routes_from, spawn
from resim.simulation.naturalistic.lay import SampledSpeed
from resim.simulation.naturalistic.settings import read_naturalistic

ROOT = Path(__file__).parents[3]
Call = Callable[..., tuple[int, str, str]]
MAPS = {name: ROOT / "networks" / f"{name}.xodr" for name in ("motorway", "urban")}
SETTINGS = {name: ROOT / "scenarios" / "traffic" / f"{name}.toml" for name in ("motorway", "urban")}
SECONDS = 60.0


def short(folder: Path, name: str) -> Path:
    """The settings that ship, with shorter recordings and a shorter warm-up."""
    text = SETTINGS[name].read_text()
    text = re.sub(
        r"warm_up = [\d.]+", "warm_up = 60.0", text.replace("recording = 120.0", "recording = 30.0", 1)
    )
    (folder / f"{name}.toml").write_text(text)
    return folder / f"{name}.toml"


@pytest.fixture(scope="module", params=["motorway", "urban"])
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp("traffic")
    settings = short(folder, request.param)
    list(
        make_traffic(
            MAPS[request.param], folder / "out", hours=SECONDS / 3600.0, settings=settings, seed=3, highd=True
        )
    )
    return request.param, folder / "out"


def test_recordings_have_no_finding_and_nobody_overlaps(made: tuple[str, Path]) -> None:
    _, out = made
    folders = sorted(path for path in out.iterdir() if path.name.isdigit())
    assert [path.name for path in folders] == ["000", "001"]
    for folder in folders:
        assert not check(folder).findings
        gt = read_recording(folder).gt
        assert len(gt) > 10
        assert not first_overlaps(gt)
        assert gt.t[-1] == 30.0


def test_motion_has_the_speeds_that_it_says(made: tuple[str, Path]) -> None:
    _, out = made
    k = read_recording(out / "000").gt
    assert k.yaw_rate is not None
    dt = k.t[2:] - k.t[:-2]
    place, told = k.x + 1j * k.y, (k.v * np.exp(1j * k.heading))[:, 1:-1]
    assert np.nanmax(np.abs((place[:, 2:] - place[:, :-2]) / dt - told)) < 0.2  # SUMO's accelerations step
    assert np.nanmedian(np.abs((place[:, 2:] - place[:, :-2]) / dt - told)) < 1e-3


def test_the_truth_of_lane_changes_is_where_the_lane_changes(made: tuple[str, Path]) -> None:
    name, out = made
    network, seen = load(MAPS[name]), 0
    for folder in (out / "000", out / "001"):
        truth = pd.read_csv(folder / "truth.csv")
        gt = read_recording(folder).gt
        for one in truth[truth["label"].str.startswith("lane_change")].itertuples():
            n = gt.index(str(one.object))
            near = np.flatnonzero(gt.valid[n] & (np.abs(gt.t - one.t) < 0.5))
            if len(near) < 20:
                continue
            at = network.to_road(gt.x[n, near], gt.y[n, near], heading=gt.heading[n, near])
            target = int(one.lane_to.partition("/")[2])
            late = gt.t[near[np.flatnonzero(at.lane == target)[0]]] - one.t
            assert -1e-6 <= late <= 0.04 + 1e-6
            assert one.start < one.t < one.end
            seen += 1
    assert seen > (5 if name == "motorway" else 0)


def test_highd_csv_reads_as_what_it_was_written_of(made: tuple[str, Path]) -> None:
    name, out = made
    gt = read_recording(out / "000").gt
    ego = read_recording(out / "000").ego
    again = read_highd(out / "highd" / "00_tracks.csv", map=MAPS[name], ego=ego, start=0.0, end=30.0).gt
    again = again.select(gt.ids)
    assert np.array_equal(again.valid, gt.valid)
    for column in ("x", "y", "v"):
        assert np.nanmax(np.abs(getattr(again, column) - getattr(gt, column))) < 1e-5
    assert np.nanmax(np.abs(np.angle(np.exp(1j * (again.heading - gt.heading))))) < 1e-6


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(tmp_path: Path, call: Call) -> None:
    settings = short(tmp_path, "urban")
    for name, seed in (("a", 2), ("b", 2), ("c", 5)):
        code, said, error = call(
            "traffic", MAPS["urban"], "--hours", 20.0 / 3600.0, "--settings", settings, "--seed", seed,
            "--out", tmp_path / name,
        )  # fmt: skip
        assert (code, error) == (0, "")
        assert "1 recordings" in said or "1 recording" in said
    for file in ("gt.parquet", "truth.csv", "recording.toml"):
        one, two, three = ((tmp_path / name / "000" / file).read_bytes() for name in "abc")
        assert one == two
        assert one != three


def test_drivers_who_cut_in_differ_from_others_by_what_is_said_alone() -> None:
    """Assertiveness and time between decisions go to SUMO by its names, and move no other draw of the same seed."""
    network = load(MAPS["motorway"])
    edges = read_edges(sumo_net(network).path)
    plain = read_naturalistic(SETTINGS["motorway"])
    own = {"assertive": RandomNumber(kind="uniform", min=20.0, max=200.0), "decides": constant(2.0)}
    other = plain.model_copy(update={"car": plain.car.model_copy(update=own)})
    names, cars = ("lcAssertive", "actionStepLength"), 0
    for one, two in zip(*(spawn(edges, network, told, 300.0, 1) for told in (plain, other)), strict=True):
        drawn = [dict(vehicle.parameters) for vehicle in (one, two)]
        mine, theirs = (tuple(told.pop(name) for name in names) for told in drawn)
        assert drawn[0] == drawn[1]
        assert (one.id, one.kind, one.depart, one.edges) == (two.id, two.kind, two.depart, two.edges)
        assert mine == (1.0, 0.2)
        if one.kind == "car":
            assert 20.0 <= theirs[0] <= 200.0
            assert theirs[1] == 2.0
            cars += 1
        else:
            assert theirs == mine
    assert cars > 0


def write_bent(file: Path, turns: list[float], length: float, lanes: int) -> Path:
    """A road of straight lines one after the other, each turned [rad] against the one before."""
    x, y, heading, lines = 0.0, 0.0, 0.0, ""
    for k, turn in enumerate(turns):
        heading += turn
        lines += (
            f'<geometry s="{k * length}" x="{x}" y="{y}" hdg="{heading}" length="{length}"><line/></geometry>'
        )
        x, y = x + length * np.cos(heading), y + length * np.sin(heading)
    right = "".join(
        f'<lane id="{-n}" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
        for n in range(1, lanes + 1)
    )
    file.write_text(
        f'''<OpenDRIVE><header revMajor="1" revMinor="7"/><road name="" length="{length * len(turns)}" id="1"
        junction="-1"><type s="0" type="motorway"/><planView>{lines}</planView><lanes><laneSection s="0">
        <center><lane id="0" type="none"/></center><right>{right}</right></laneSection></lanes></road></OpenDRIVE>'''
    )
    return file


def test_who_would_leap_where_the_line_has_a_kink_is_left_out(tmp_path: Path) -> None:
    """At a kink of 0.03 rad the centre of lane -1 leaps by 5 cm, that of lane -2 by 16 cm."""
    road, settings = write_bent(tmp_path / "kinked.xodr", [0.0, 0.03], 300.0, 2), short(tmp_path, "motorway")
    [made] = make_traffic(road, tmp_path / "out", hours=30.0 / 3600.0, settings=settings, seed=3)
    leap = [why for _, why in made.left_out if "the map makes it leap by 0.16 m at" in why]
    assert leap
    gt = read_recording(made.folder).gt
    place = gt.x + 1j * gt.y
    assert np.nanmax(np.abs(np.diff(place, 2, axis=1))) < 0.2  # each leap would be of 0.05 and 0.16 m, twice


def test_a_map_on_which_everybody_leaps_is_blamed(tmp_path: Path) -> None:
    road = write_bent(tmp_path / "torn.xodr", [0.2, -0.2] * 20, 3.0, 1)
    with pytest.raises(InputError, match=r"left out, the first because the map makes it leap by 0\.[23]"):
        list(make_traffic(road, tmp_path / "out", hours=0.005, settings=short(tmp_path, "motorway"), seed=3))


def test_a_map_with_errors_is_refused_unless_they_are_accepted(tmp_path: Path) -> None:
    road = write_bent(tmp_path / "gap.xodr", [0.0, 0.0], 300.0, 2)
    road.write_text(road.read_text(encoding="utf-8").replace('x="300.0"', 'x="303.0"'), encoding="utf-8")
    asked = {"hours": 30.0 / 3600.0, "settings": short(tmp_path, "motorway"), "seed": 3}
    with pytest.raises(InputError, match=r"LINE_GAP: .* jumps by 3.000 m.*--accept LINE_GAP"):
        list(make_traffic(road, tmp_path / "out", **asked))
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="LINE_GAPS"):
        list(make_traffic(road, tmp_path / "out", accept=["LINE_GAPS"], **asked))
    [made] = make_traffic(road, tmp_path / "out", accept=["LINE_GAP"], **asked)
    assert any("the map makes it leap by 3.00 m" in why for _, why in made.left_out)


def test_demand_is_what_the_settings_say() -> None:
    network = load(MAPS["motorway"])
    edges = read_edges(sumo_net(network).path)
    settings = read_naturalistic(SETTINGS["motorway"])
    vehicles = spawn(edges, network, settings, 36_000.0, 1)
    entered = {to for edge in edges.values() for to in edge.after}
    sources = [name for name in edges if name not in entered]
    assert len(sources) == 3  # both carriageways, and the on-ramp
    expected = 10.0 * (6.0 * settings.demand.per_lane + settings.demand.ramp)
    assert len(vehicles) == pytest.approx(expected, rel=0.03)
    assert np.mean([v.kind == "truck" for v in vehicles]) == pytest.approx(
        settings.demand.truck_share, abs=0.02
    )
    main = next(name for name in sources if edges[name].lanes[0][0] == "1")
    routes = routes_from(edges, network, main, settings.demand.exit_share)
    leaves = [share for route, share in routes if edges[route[-1]].lanes[0][0] == "5"]
    assert leaves == [pytest.approx(settings.demand.exit_share)]
    assert sum(share for _, share in routes) == pytest.approx(1.0)


def test_speeds_are_linear_between_sumos_steps() -> None:
    speed = SampledSpeed(np.array([1.0, 1.2, 1.4]), np.array([10.0, 12.0, 10.0]))
    way, v, a = speed.states(np.array([1.0, 1.1, 1.2, 1.4, 2.4]))
    assert way == pytest.approx([0.0, 1.05, 2.2, 4.4, 14.4])
    assert v == pytest.approx([10.0, 11.0, 12.0, 10.0, 10.0])
    assert a[:3] == pytest.approx([10.0, 10.0, -10.0])
    assert [speed.time_at(w) for w in (0.0, 1.05, 4.4, 14.4)] == pytest.approx([1.0, 1.1, 1.4, 2.4])


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("per_lane = ", "per_lanes = ", "demand.per_lanes: there is no such field, did you mean 'per_lane'?"),
        ("truck_share = 0.05", "truck_share = 1.5", "demand.truck_share: expected 1 or less, found 1.5"),
        ("recording = 30.0", "recording = 5000.0", "recording: expected 900 or less, found 5000.0"),
        (
            "recording = 30.0",
            'recording = 30.0\nego.reactive.drivers = "sumo"',
            "functions drive without SUMO here",
        ),
    ],
)
def test_faults_are_told(tmp_path: Path, old: str, new: str, told: str) -> None:
    settings = short(tmp_path, "urban")
    settings.write_text(settings.read_text().replace(old, new, 1))
    with pytest.raises(InputError) as e:
        list(make_traffic(MAPS["urban"], tmp_path / "out", hours=0.01, settings=settings))
    assert told in str(e.value)
