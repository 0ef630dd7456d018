"""OpenSCENARIO files come in as far as they say where everybody is; what a player decides is refused by element."""

from __future__ import annotations

import copy
import os
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import DATA, ROOT
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from junction import write_junction
from lxml import etree
from scipy.interpolate import PPoly

from resim.core.errors import InputError
from resim.core.geometry import wrap_angle
from resim.recordings.formats.openscenario import read_openscenario
from resim.road.opendrive import load
from resim.scenario.openscenario import VERSIONS, openscenario
from resim.scenario.scenario import RoadPosition, Scenario, ScenarioObject

MAP = ROOT / "networks" / "proving_ground.xodr"
NETWORK = load(MAP)
ROAD, LANE = next(
    (road.id, lane)
    for road in NETWORK.roads.values()
    for lane, of in road.sections[0].lanes.items()
    if of.drivable and lane != 0 and road.length > 300.0
)
FUZZ = settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture]
)  # fmt: skip

BOX = '<BoundingBox><Center x="{x}" y="{y}" z="0.7"/><Dimensions length="5" width="2" height="1.5"/></BoundingBox>'
VEHICLE = '<Vehicle name="v" vehicleCategory="{kind}">' + BOX + "</Vehicle>"
TREE = (
    '<ScenarioObject name="tree"><MiscObject name="t" mass="1" miscObjectCategory="tree">'
    f"{BOX.format(x=0, y=0)}</MiscObject></ScenarioObject>"
)
AT = (
    '<StartTrigger><ConditionGroup><Condition name="c" delay="0" conditionEdge="none"><ByValueCondition>'
    '<SimulationTimeCondition value="{t}" rule="greaterOrEqual"/></ByValueCondition></Condition></ConditionGroup>'
    "</StartTrigger>"
)
PARAMETER = (
    '<ParameterDeclarations><ParameterDeclaration name="{name}" parameterType="double" value="{value}"/>'
    "</ParameterDeclarations>"
)
_VERTEX = '<Vertex time="{}">{}</Vertex>'
LANE_PLACE = (
    f'<Position><LanePosition roadId="{ROAD}" laneId="{LANE}" s="{{s}}" offset="{{offset}}"/></Position>'
)


def entity(name: str = "Ego", kind: str = "car", x: float = 1.5, y: float = 0.0) -> str:
    return f'<ScenarioObject name="{name}">{VEHICLE.format(kind=kind, x=x, y=y)}</ScenarioObject>'


def teleport(position: str) -> str:
    return f"<PrivateAction><TeleportAction>{position}</TeleportAction></PrivateAction>"


def speed(target: str, shape: str = "step", dimension: str = "time", value: str = "0") -> str:
    return (
        "<PrivateAction><LongitudinalAction><SpeedAction>"
        f'<SpeedActionDynamics dynamicsShape="{shape}" dynamicsDimension="{dimension}" value="{value}"/>'
        f'<SpeedActionTarget><AbsoluteTargetSpeed value="{target}"/></SpeedActionTarget>'
        "</SpeedAction></LongitudinalAction></PrivateAction>"
    )


def follow(
    shape: str, timing: str | None = 'domainAbsoluteRelative="absolute" scale="1" offset="0"', mode: str = "position"
) -> str:  # fmt: skip
    timed = "<None/>" if timing is None else f"<Timing {timing}/>"
    return (
        '<PrivateAction><RoutingAction><FollowTrajectoryAction><TrajectoryRef><Trajectory name="t" closed="false">'
        f"<Shape>{shape}</Shape></Trajectory></TrajectoryRef><TimeReference>{timed}</TimeReference>"
        f'<TrajectoryFollowingMode followingMode="{mode}"/></FollowTrajectoryAction></RoutingAction></PrivateAction>'
    )


def world(x: float, y: float, h: float | None = None) -> str:
    told = "" if h is None else f' h="{h!r}"'
    return f'<Position><WorldPosition x="{x!r}" y="{y!r}"{told}/></Position>'


def polyline(*vertices: tuple[float, str]) -> str:
    return "<Polyline>" + "".join(map(_VERTEX.format, *zip(*vertices, strict=True))) + "</Polyline>"


def event(t: float | str, action: str, priority: str = "parallel", name: str = "e") -> str:
    return f'<Event name="{name}" priority="{priority}"><Action name="a">{action}</Action>{AT.format(t=t)}</Event>'


def story(*events: str, actor: str = "Ego") -> str:
    return (
        '<Story name="s"><Act name="act"><ManeuverGroup name="g" maximumExecutionCount="1">'
        f'<Actors selectTriggeringEntities="false"><EntityRef entityRef="{actor}"/></Actors>'
        f'<Maneuver name="m">{"".join(events)}</Maneuver></ManeuverGroup>{AT.format(t=0)}</Act></Story>'
    )


def scenario(
    init: dict[str, str], stories: str = "", *, entities: str | None = None, stop: float | str = 4.0, top: str = "",
    version: str = "2",
) -> str:  # fmt: skip
    inits = "".join(f'<Private entityRef="{name}">{own}</Private>' for name, own in init.items())
    ends = AT.format(t=stop).replace("StartTrigger", "StopTrigger")
    return (
        f'<OpenSCENARIO><FileHeader revMajor="1" revMinor="{version}" date="2020-01-01T00:00:00" description="d" '
        f'author="a"/>{top}<RoadNetwork><LogicFile filepath="road.xodr"/></RoadNetwork>'
        f"<Entities>{entities or ''.join(entity(name) for name in init)}</Entities>"
        f"<Storyboard><Init><Actions>{inits}</Actions></Init>{stories}{ends}</Storyboard></OpenSCENARIO>"
    )


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("xosc")
    shutil.copyfile(MAP, folder / "road.xodr")
    return folder


def read(home: Path, text: str | bytes, **options):
    path = home / "drive.xosc"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_openscenario(path, **options).gt


def of(gt, name: str = "Ego"):
    n = gt.index(name)
    return gt.t, gt.x[n], gt.y[n], gt.heading[n], gt.v[n]


# --- there and back


@st.composite
def course(draw: st.DrawFn, begin: float, lasts: float) -> tuple[PPoly, PPoly]:
    """Cubic splines of speed and heading from begin on."""
    a, jerk = draw(st.floats(-4.0, 4.0)), draw(st.floats(-2.0, 2.0))
    v0, turn, h0 = draw(st.floats(-5.0, 40.0)), draw(st.floats(-0.3, 0.3)), draw(st.floats(-3.1, 3.1))
    x = np.array([begin, begin + lasts])
    return PPoly(np.array([[0.0], [0.5 * jerk], [a], [v0]]), x), PPoly(
        np.array([[0.0], [0.05], [turn], [h0]]), x
    )


@st.composite
def drives(draw: st.DrawFn) -> Scenario:
    lasts = 0.02 * draw(st.integers(10, 120)) + draw(st.sampled_from([0.0, 0.0, 0.0031]))
    objects = []
    for n in range(draw(st.integers(1, 4))):
        kind = draw(st.sampled_from(["car", "truck", "pedestrian", "bicycle", "motorcycle"])) if n else "car"
        begin = 0.02 * draw(st.integers(0, int(lasts / 0.02) - 5)) if n else 0.0
        until = draw(st.floats(0.08, lasts)) if n else lasts
        v, heading = draw(course(begin, until))
        start = RoadPosition(
            ROAD, LANE, draw(st.floats(1.0, NETWORK.roads[ROAD].length - 1.0)), draw(st.floats(-9, 9))
        )
        size = draw(st.floats(0.4, 18.0)), draw(st.floats(0.4, 2.6))
        objects.append(ScenarioObject("ego" if not n else f"{n}", kind, *size, start, v, heading))
    return Scenario("road.xodr", lasts, objects[0], tuple(objects[1:]))


@settings(max_examples=40, deadline=None)
@given(drive=drives(), version=st.sampled_from(VERSIONS))
def test_what_is_exported_comes_back(home: Path, drive: Scenario, version: str) -> None:
    """Centres equal to 1e-6 m, times to 1e-9 s, headings to 1e-9 rad; speeds by differences over 0.02 s."""
    pytest.importorskip("scenariogeneration")
    gt = read(home, openscenario(drive, NETWORK, name="there", version=version))
    own = np.arange(int(np.floor(drive.duration / 0.02 + 1e-9)) + 1) * 0.02
    if drive.duration - own[-1] > 1e-9:
        own = np.append(own, drive.duration)
    np.testing.assert_allclose(gt.t, own, rtol=0.0, atol=1e-9)
    true = drive.tracks(NETWORK, own)
    for n, one in enumerate((drive.ego, *drive.objects)):
        k = gt.index("Ego" if not n else f"object_{one.id}")
        last = min(float(one.v.x[-1]), drive.duration)
        there = (own >= one.v.x[0] - 1e-9) & (own <= last + 1e-9)
        assert gt.valid[k].tolist() == there.tolist()
        vertices = there & (own <= one.v.x[0] + 0.02 * np.floor((last - one.v.x[0]) / 0.02 + 1e-9) + 1e-9)
        off = np.hypot(gt.x[k] - true.x[n], gt.y[k] - true.y[n])
        assert off[vertices].max() <= 1e-6
        assert np.abs(wrap_angle(gt.heading[k] - true.heading[n]))[vertices].max() <= 1e-9
        if there.sum() > 4:
            assert np.abs(gt.v[k] - true.v[n])[there][1:-2].max() < 0.05
        assert gt.length[k] == one.length
        assert gt.width[k] == one.width
        assert gt.kind[k] == one.kind


def test_a_shipped_drive_comes_back(tmp_path: Path) -> None:
    """As a command, and its recording can be read."""
    pytest.importorskip("scenariogeneration")
    from resim.jobs.export import export_openscenario
    from resim.recordings import read_recording

    source = ROOT / "scenarios" / "cut_in_brake"
    export_openscenario(source, tmp_path / "out")
    order = [
        ROOT / "nothing",
        "import",
        "openscenario",
        tmp_path / "out" / "GT.xosc",
        "--out",
        tmp_path / "back",
    ]
    done = subprocess.run(
        [os.sys.executable, "-m", "resim", *map(str, order[1:])], capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    assert "2 objects over 9.20 s, EGO Ego" in done.stdout
    true, found = read_recording(source).gt, read_recording(tmp_path / "back").gt
    for name, own in (("ego", "Ego"), (str(true.ids[true.ids != "ego"][0]), None)):
        k = found.index(own or f"object_{name}")
        n = true.index(name)
        t = true.t - true.t[0]
        inside = true.valid[n] & (t <= found.t[-1])
        x = np.interp(t[inside], found.t, found.x[k])
        assert np.abs(x - true.x[n][inside]).max() < 0.05
        assert np.abs(np.interp(t[inside], found.t, found.v[k]) - true.v[n][inside]).max() < 0.5


# --- what files say


def test_the_reference_point_is_the_rear_axle(home: Path) -> None:
    init = {"Ego": teleport(world(10.0, 20.0, np.pi / 2))}
    t, x, y, heading, v = of(read(home, scenario(init, entities=entity(x=1.5, y=0.25))))
    assert (x[0], y[0], heading[0]) == (pytest.approx(9.75), pytest.approx(21.5), pytest.approx(np.pi / 2))
    assert (v == 0.0).all()
    assert (t[-1], len(t)) == (4.0, 201)


def test_who_has_a_speed_alone_keeps_its_lane(home: Path) -> None:
    init = {"Ego": teleport(LANE_PLACE.format(s=100, offset=0.4)) + speed("${$kmh / 3.6}")}
    top = PARAMETER.format(name="kmh", value=72)
    t, x, y, heading, v = of(read(home, scenario(init, entities=entity(x=0.0), top=top)))
    assert v == pytest.approx(20.0)
    found = NETWORK.to_road(x, y)
    assert set(found.lane.tolist()) == {LANE}
    assert found.t == pytest.approx(0.4, abs=1e-6)
    assert np.abs(wrap_angle(heading - NETWORK.lane_heading(ROAD, LANE, found.s))).max() < 1e-6
    way = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
    np.testing.assert_allclose(way, 20.0 * t, atol=1e-3)


def test_others_are_kept_where_the_ego_ends_early(home: Path) -> None:
    """They show that the drive lasted longer, so that what was not seen of it is INVALID."""
    lanes = {
        name: teleport(LANE_PLACE.format(s=s, offset=0)) + speed("5") for name, s in (("b", 100), ("Ego", 60))
    }
    gone = story(
        event(
            2,
            "<GlobalAction><EntityAction entityRef='Ego'><DeleteEntityAction/></EntityAction></GlobalAction>",
        )
    )
    path = home / "early.xosc"
    path.write_text(scenario(lanes, gone), encoding="utf-8")
    found = read_openscenario(path)
    last = {name: found.gt.t[found.gt.valid[found.gt.index(name)]][-1] for name in lanes}
    assert last == {"Ego": pytest.approx(2.0), "b": pytest.approx(4.0)}
    assert "100 rows before 0 s or after 2 s" in found.provenance["without_ego"]
    cut = read_openscenario(path, end=2.0)
    assert cut.gt.t[-1] == pytest.approx(2.0)
    assert "without_ego" not in cut.provenance


def test_parameters_count_where_they_are_declared(home: Path) -> None:
    """A story's own one comes before the file's; outside of it that is as it was."""
    told = story(event(1, speed("$v")), actor="$owner").replace(
        '<Story name="s">', '<Story name="s">' + PARAMETER.format(name="owner", value="Ego")
    )
    told = told.replace(
        "</ParameterDeclarations>",
        '<ParameterDeclaration name="v" value="${$w + 1}"/></ParameterDeclarations>',
    )
    top = PARAMETER.format(name="v", value=5).replace(
        "</ParameterDeclarations>", '<ParameterDeclaration name="w" value="8"/></ParameterDeclarations>'
    )
    init = {"Ego": teleport(LANE_PLACE.format(s=100, offset=0)) + speed("$v")}
    v = of(read(home, scenario(init, told, top=top)))[4]
    assert (v[0], v[-1]) == (5.0, 9.0)


def relative(kind: str, to: str = "Ego", **values: float | str) -> str:
    told = " ".join(f'{name}="{value}"' for name, value in values.items())
    return f'<Position><Relative{kind}Position entityRef="{to}" {told}/></Position>'


def relative_speed(value: float, kind: str = "delta", continuous: str = "false") -> str:
    how = f'value="{value}" speedTargetValueType="{kind}" continuous="{continuous}"'
    return speed("0").replace(
        '<AbsoluteTargetSpeed value="0"/>', f'<RelativeTargetSpeed entityRef="Ego" {how}/>'
    )


def test_who_is_put_relative_to_others_at_the_start_is_there_wherever_it_stands_in_the_file(
    home: Path,
) -> None:
    init = {
        "third": teleport(relative("Object", "second", dx=-10, dy=2)) + relative_speed(0.5, "factor"),
        "second": teleport(relative("Lane", dLane=-1, ds=30, offset=0.25)) + relative_speed(-5),
        "Ego": teleport(LANE_PLACE.format(s=100, offset=0.4).replace(f'laneId="{LANE}"', 'laneId="-1"'))
        + speed("20"),
    }
    gt = read(home, scenario(init, entities="".join(entity(name, x=0.0) for name in init)))
    (_, x, y, heading, v), (_, x3, y3, heading3, v3) = of(gt, "second"), of(gt, "third")
    found = NETWORK.to_road(x[0], y[0])
    assert (found.lane[0], found.s[0], found.t[0]) == (
        -2, pytest.approx(130.0, abs=1e-6), pytest.approx(0.25, abs=1e-6),
    )  # fmt: skip
    assert (v[0], v3[0], heading3[0]) == (15.0, 10.0, pytest.approx(heading[0]))
    to = (x3[0] - x[0] + 1j * (y3[0] - y[0])) * np.exp(-1j * heading[0])
    assert (to.real, to.imag) == (pytest.approx(-10.0), pytest.approx(2.0))


@pytest.mark.parametrize(("ds", "dt"), [(30.0, -3.5), (-12.5, 0.25), (0.0, 0.0)])
def test_who_is_put_relative_to_others_along_the_road_is_there(home: Path, ds: float, dt: float) -> None:
    init = {
        "second": teleport(relative("Road", ds=ds, dt=dt)) + relative_speed(-5),
        "Ego": teleport(LANE_PLACE.format(s=100, offset=0.4).replace(f'laneId="{LANE}"', 'laneId="-1"'))
        + speed("20"),
    }
    gt = read(home, scenario(init, entities="".join(entity(name, x=0.0) for name in init)))
    (_, x, y, heading, v), (_, x0, y0, heading0, _) = of(gt, "second"), of(gt, "Ego")
    turned = np.exp(-1j * heading0[0])  # the road is straight
    to = (x[0] - x0[0] + 1j * (y[0] - y0[0])) * turned
    assert (to.real, to.imag) == (pytest.approx(ds, abs=1e-9), pytest.approx(dt, abs=1e-9))
    assert (v[0], heading[0]) == (15.0, pytest.approx(heading0[0]))


def test_along_a_lane_that_widens_players_differ(tmp_path: Path) -> None:
    """Two lanes of a road along x, of which the inner one is 3 m wide at 0 m, and 4 m wide from 100 m on."""
    lane = (
        '<lane id="{}" type="driving" level="false"><width sOffset="0" a="{}" b="{}" c="0" d="0"/>{}</lane>'
    )
    wide = '<width sOffset="100" a="4" b="0" c="0" d="0"/>'
    lanes = f"<right>{lane.format(-1, 3, 0.01, wide)}{lane.format(-2, 3, 0, '')}</right>"
    (tmp_path / "road.xodr").write_text(
        '<OpenDRIVE><header revMajor="1" revMinor="4"/><road id="1" length="400" junction="-1" name=""><planView>'
        '<geometry s="0" x="0" y="0" hdg="0" length="400"><line/></geometry></planView><lanes><laneSection s="0">'
        f'<center><lane id="0" type="none" level="false"/></center>{lanes}</laneSection></lanes></road></OpenDRIVE>',
        encoding="utf-8",
    )
    for begin, held in ((150, True), (50, False)):
        place = f'<Position><LanePosition roadId="1" laneId="-2" s="{begin}"/></Position>'
        init = {"Ego": teleport(place), "b": teleport(relative("Road", ds=40, dt=1.5))}
        if held:
            (_, x, y, *_) = of(
                read(tmp_path, scenario(init, entities=entity("Ego", x=0.0) + entity("b", x=0.0))), "b"
            )
            assert (x[0], y[0]) == (pytest.approx(190.0), pytest.approx(-4.0))
        else:
            with pytest.raises(InputError, match=r"of lane -2 of road 1 from -5 to -5.4 m"):
                read(tmp_path, scenario(init, entities=entity("Ego") + entity("b")))


def test_where_a_lane_forks_the_player_decides_and_where_it_ends_so_does_the_track(tmp_path: Path) -> None:
    """120 m of road 1 to the junction; from road 10, which leads straight on, 140 m to the end of the map."""
    write_junction(tmp_path / "road.xodr")
    place = '<Position><LanePosition roadId="{}" laneId="-1" s="0"/></Position>'
    driving = {"Ego": teleport(place.format(1)) + speed("20")}
    with pytest.raises(
        InputError, match=r"road 1 section 0 lane -1 after 120.0 m, which goes on into several"
    ):
        read(tmp_path, scenario(driving, stop=10.0))
    assert read(tmp_path, scenario(driving, stop=5.9)).t[-1] == pytest.approx(5.9)
    driving["Ego"] = driving["Ego"].replace('roadId="1"', 'roadId="10"')
    t, x, *_ = of(read(tmp_path, scenario(driving, stop=10.0, entities=entity(x=0.0))))
    assert (t[-1], x[-1]) == (pytest.approx(7.0), pytest.approx(140.0))
    said = read_openscenario(tmp_path / "drive.xosc").provenance["says_no_more_of"]
    assert said == "Ego: its lane ends at 7.000 s"


@pytest.mark.parametrize("shape", ["linear", "cubic", "sinusoidal"])
@pytest.mark.parametrize("dimension", ["time", "rate"])
def test_speeds_change_as_their_formulas_say(home: Path, shape: str, dimension: str) -> None:
    """From 10 to 16 m/s from 1 s on: over 2 s, or by 3 m/s² at most; ways are those of the speeds."""
    value = 2.0 if dimension == "time" else 3.0
    steepest = {"linear": 1.0, "cubic": 1.5, "sinusoidal": np.pi / 2}[shape]
    lasts = 2.0 if dimension == "time" else steepest * 6.0 / 3.0
    text = scenario(
        {"Ego": teleport(LANE_PLACE.format(s=100, offset=0)) + speed("10")},
        story(event(1.0, speed("16", shape, dimension, str(value)))), entities=entity(x=0.0), stop=6.0,
    )  # fmt: skip
    t, x, y, _, v = of(read(home, text))
    u = np.clip((t - 1.0) / lasts, 0.0, 1.0)
    part = {"linear": u, "cubic": 3 * u**2 - 2 * u**3, "sinusoidal": 0.5 * (1 - np.cos(np.pi * u))}[shape]
    np.testing.assert_allclose(v, 10.0 + 6.0 * part, atol=1e-9)
    if dimension == "rate":
        assert np.max(np.diff(v) / np.diff(t)) == pytest.approx(3.0, rel=1e-2)
    way = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
    np.testing.assert_allclose(way, np.r_[0.0, np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))], atol=2e-3)


def test_an_event_that_overrides_stops_the_change_of_speed(home: Path) -> None:
    """From 10 to 20 m/s over 5 s from 1 s on, stopped at 3 s."""
    gone = '<GlobalAction><EntityAction entityRef="b"><DeleteEntityAction/></EntityAction></GlobalAction>'
    init = {
        "Ego": teleport(LANE_PLACE.format(s=100, offset=0)) + speed("10"),
        "b": teleport(world(0.0, 0.0)),
    }
    events = event(1.0, speed("20", "linear", "time", "5")), event(3.0, gone, "{}")
    for priority, last in (("override", 14.0), ("parallel", 20.0)):
        t, _, _, _, v = of(read(home, scenario(init, story(*events).format(priority), stop=8.0)))
        assert v[t >= 6.0] == pytest.approx(last)
        assert v[np.isclose(t, 3.0)] == pytest.approx(14.0)


def test_times_are_scaled_and_shifted(home: Path) -> None:
    line = polyline((0.0, world(0.0, 0.0)), (1.0, world(10.0, 0.0)))
    timing = 'domainAbsoluteRelative="relative" scale="2" offset="0.5"'
    init = {"Ego": teleport(world(0.0, 0.0, 0.0))}
    text = scenario(init, story(event(0.5, follow(line, timing))), entities=entity(x=0.0))
    t, x, _, _, v = of(read(home, text))
    np.testing.assert_allclose(x, np.interp(t, [1.0, 3.0], [0.0, 10.0]), atol=1e-9)
    assert t[-1] == pytest.approx(3.0)  # where it drives on, the file does not say
    assert v[(t > 1.1) & (t < 2.9)] == pytest.approx(5.0)


def test_orientations_count_from_the_lane_where_they_are_relative(tmp_path: Path) -> None:
    """Road 3 leads to the north."""
    write_junction(tmp_path / "road.xodr")
    turned = '<Position><LanePosition roadId="3" laneId="-1" s="9"><Orientation{} h="0.5"/></LanePosition></Position>'
    for told, heading in ((' type="relative"', 0.5 * np.pi + 0.5), (' type="absolute"', 0.5), ("", 0.5)):
        _, _, _, found, _ = of(read(tmp_path, scenario({"Ego": teleport(turned.format(told))})))
        assert found == pytest.approx(heading)


def test_triggers_wait_for_their_delay_and_for_all_of_a_group(home: Path) -> None:
    both = AT.format(t=1).replace('delay="0"', 'delay="0.5"')
    second = AT.format(t=2)
    second = second[second.index("<Condition ") : second.index("</ConditionGroup>")]
    for trigger, begins in (
        (both, 1.5),
        (both.replace("</ConditionGroup>", second + "</ConditionGroup>"), 2.0),
    ):
        happens = event(1, speed("7")).replace(AT.format(t=1), trigger)
        t, _, _, _, v = of(read(home, scenario(DRIVING, story(happens))))
        assert t[v > 0.0][0] == pytest.approx(begins)


def test_far_vertices_have_samples_between_them_and_tangents(home: Path) -> None:
    corner = polyline((0.0, world(0.0, 0.0)), (2.0, world(20.0, 0.0)), (4.0, world(20.0, 10.0)))
    t, _x, _y, heading, v = of(read(home, scenario({"Ego": follow(corner)}, entities=entity(x=0.0))))
    assert np.diff(t).max() < 0.0401
    assert (heading[t < 1.99] == 0.0).all()
    assert heading[t > 2.01] == pytest.approx(np.pi / 2)
    assert heading[np.isclose(t, 2.0)] == pytest.approx(np.pi / 4)
    assert v[(t > 0.1) & (t < 1.9)] == pytest.approx(10.0)
    assert v[t > 2.1] == pytest.approx(5.0)


def test_who_stands_at_its_trajectorys_end_stays(home: Path) -> None:
    line = polyline((0.0, world(0.0, 0.0, 0.1)), (1.0, world(5.0, 0.0, 0.1)), (2.0, world(5.0, 0.0, 0.1)))
    init = {"Ego": teleport(world(50.0, 0.0)), "b": follow(line)}
    gt = read(home, scenario(init))
    t, x, _, heading, _ = of(gt, "b")
    assert gt.valid.all()
    assert heading == pytest.approx(0.1)
    assert x[t >= 1.0] == pytest.approx(5.0 + 1.5 * np.cos(0.1))


def test_without_times_the_speed_counts(home: Path) -> None:
    line = polyline((0.0, world(0.0, 0.0)), (0.0, world(30.0, 40.0)))
    init = {"Ego": teleport(world(0.0, 0.0, 0.0)) + speed("10") + follow(line, None)}
    t, x, y, _, v = of(read(home, scenario(init, entities=entity(x=0.0), stop=9.0)))
    assert t[-1] == pytest.approx(5.0)
    assert v == pytest.approx(10.0)
    np.testing.assert_allclose(np.hypot(x, y), 10.0 * t, atol=1e-9)


def test_a_clothoid_bends_evenly(home: Path) -> None:
    """Against its definition, summed in steps of 1 mm."""
    shape = (
        '<Clothoid curvature="0.02" curvaturePrime="-0.0015" length="60" startTime="0" stopTime="4">'
        f"{world(100.0, -20.0, 0.7)}</Clothoid>"
    )
    t, x, y, heading, v = of(read(home, scenario({"Ego": follow(shape)}, entities=entity(x=0.0))))
    s = np.linspace(0.0, 60.0, 60_001)
    turn = 0.7 + 0.02 * s - 0.5 * 0.0015 * s**2
    middle = 0.5 * (turn[1:] + turn[:-1])
    for found, start, step in ((x, 100.0, np.cos(middle)), (y, -20.0, np.sin(middle))):
        np.testing.assert_allclose(
            found, np.interp(15.0 * t, s, start + np.r_[0.0, np.cumsum(step) * 1e-3]), atol=1e-6
        )
    np.testing.assert_allclose(heading, wrap_angle(np.interp(15.0 * t, s, turn)), atol=1e-6)
    assert v == pytest.approx(15.0, abs=5e-3)


def test_a_nurbs_of_a_quarter_circle_is_one(home: Path) -> None:
    points = [(0.0, 1.0, 30.0, 0.0), (2.0, 0.5**0.5, 30.0, 30.0), (4.0, 1.0, 0.0, 30.0)]
    shape = "".join(
        f'<ControlPoint time="{t}" weight="{w!r}">{world(x, y)}</ControlPoint>' for t, w, x, y in points
    ) + "".join(f'<Knot value="{k}"/>' for k in (0, 0, 0, 1, 1, 1))
    text = scenario({"Ego": follow(f'<Nurbs order="3">{shape}</Nurbs>')}, entities=entity(x=0.0))
    _t, x, y, heading, _ = of(read(home, text))
    np.testing.assert_allclose(np.hypot(x, y), 30.0, atol=1e-3)
    assert np.abs(wrap_angle(heading - np.arctan2(y, x) - np.pi / 2)).max() < 0.01
    assert (x[0], y[-1]) == (pytest.approx(30.0), pytest.approx(30.0))


def test_vertices_on_lanes_and_roads_are_where_the_map_has_them(home: Path) -> None:
    on_road = f'<Position><RoadPosition roadId="{ROAD}" s="50" t="2.5"/></Position>'
    line = polyline((0.0, LANE_PLACE.format(s=20, offset=0.5)), (4.0, on_road))
    _, x, y, _, _ = of(read(home, scenario({"Ego": follow(line)}, entities=entity(x=0.0))))
    np.testing.assert_allclose((x[0], y[0]), NETWORK.to_xy(ROAD, LANE, 20.0, 0.5), atol=1e-9)
    x0, y0, h = NETWORK.reference_line(ROAD, 50.0)
    np.testing.assert_allclose((x[-1], y[-1]), (x0 - 2.5 * np.sin(h), y0 + 2.5 * np.cos(h)), atol=1e-9)


def test_who_is_added_and_deleted_is_there_no_longer(home: Path) -> None:
    of_b = '<GlobalAction><EntityAction entityRef="b">{}</EntityAction></GlobalAction>'
    add = of_b.format(f"<AddEntityAction>{world(5.0, 5.0, 0.0)}</AddEntityAction>")
    gone = of_b.format("<DeleteEntityAction/>")
    text = scenario(
        {"Ego": teleport(world(0.0, 0.0)), "tree": teleport(world(9.0, 9.0))}, story(event(1.0, add), event(3.0, gone)),
        entities=entity() + entity("b", "bus") + entity("never") + TREE,
    )  # fmt: skip
    gt = read(home, text)
    left = read_openscenario(home / "drive.xosc").provenance["left_out"]
    assert left == "never (put nowhere); tree (a part of the site)"
    assert gt.ids.tolist() == ["Ego", "b"]
    assert gt.kind.tolist() == ["car", "bus"]
    seen = gt.t[gt.valid[1]]
    assert (seen[0], seen[-1]) == (pytest.approx(1.0), pytest.approx(3.0))


CATALOG = (
    '<OpenSCENARIO><FileHeader revMajor="1" revMinor="1" date="2020-01-01T00:00:00" description="" author=""/>'
    '<Catalog name="cars"><Vehicle name="van" vehicleCategory="van"><ParameterDeclarations>'
    '<ParameterDeclaration name="long" parameterType="double" value="6"/></ParameterDeclarations><BoundingBox>'
    '<Center x="1" y="0" z="1"/><Dimensions length="$long" width="2" height="2"/></BoundingBox></Vehicle></Catalog>'
    "</OpenSCENARIO>"
)
LOCATED = '<CatalogLocations><VehicleCatalog><Directory path="{}"/></VehicleCatalog></CatalogLocations>'
OF_CATALOG = (
    '<ScenarioObject name="Ego"><CatalogReference catalogName="cars" entryName="van"><ParameterAssignments>'
    '<ParameterAssignment parameterRef="long" value="7.5"/></ParameterAssignments></CatalogReference></ScenarioObject>'
)


def test_vehicles_come_from_catalogs(home: Path) -> None:
    folder = home / "catalogs"
    folder.mkdir(exist_ok=True)
    (folder / "cars.xosc").write_text(CATALOG)
    init = {"Ego": teleport(world(0.0, 0.0))}
    (folder / "a_scrap.xosc").write_text(CATALOG[:-30])  # nobody asks for what is in it
    gt = read(home, scenario(init, entities=OF_CATALOG, top=LOCATED.format("./catalogs")))
    assert (gt.kind[0], gt.length[0]) == ("van", 7.5)


@pytest.mark.parametrize(
    ("where", "why"),
    [
        ("pipes", "device or pipe"),
        ("../nowhere", "cannot be read"),
        ("/dev", "which is not there"),
        ("broken", "not well-formed"),
        ("deep", "not well-formed"),
    ],
)
def test_catalogs_that_are_none_are_refused_at_once(home: Path, where: str, why: str) -> None:
    for name in ("pipes", "broken", "deep"):
        (home / name).mkdir(exist_ok=True)
    if not (home / "pipes" / "a.xosc").exists():
        os.mkfifo(home / "pipes" / "a.xosc")
    (home / "broken" / "a.xosc").write_text(CATALOG[:-40])
    (home / "deep" / "a.xosc").write_text("<a>" * 20_000 + "</a>" * 20_000)
    text = scenario({"Ego": teleport(world(0.0, 0.0))}, entities=OF_CATALOG, top=LOCATED.format(where))
    with pytest.raises(InputError, match=why):
        read(home, text)


# --- what is refused

LANE_CHANGE = (
    "<PrivateAction><LateralAction><LaneChangeAction><LaneChangeTarget/></LaneChangeAction></LateralAction>"
    "</PrivateAction>"
)
HEADWAY = (
    "<ByEntityCondition><TriggeringEntities/><EntityCondition>"
    '<TimeHeadwayCondition entityRef="Ego" value="1"/></EntityCondition></ByEntityCondition>'
)
DRIVING = {"Ego": teleport(LANE_PLACE.format(s=1, offset=0))}
STANDING = {"Ego": teleport(world(0.0, 0.0, 0.0))}
LINE = polyline((0.0, world(0.0, 0.0)), (4.0, world(40.0, 0.0)))


def put(at: str) -> dict[str, str]:
    return {"Ego": teleport(world(0.0, 0.0)).replace("0.0", at)}


def by_value(condition: str) -> str:
    at = AT.format(t=1)
    begin, end = at.index("<ByValue"), at.index("</ByValueCondition>") + len("</ByValueCondition>")
    return at[:begin] + condition + at[end:]


REFUSED = {
    "LaneChangeAction is not read: from 1 s on the player decides how it moves. --end 1 imports": scenario(
        STANDING, story(event(1, LANE_CHANGE))
    ),
    "TimeHeadwayCondition[@entityRef='Ego'] is not read": scenario(
        STANDING, story(event(1, speed("3")).replace(AT.format(t=1), by_value(HEADWAY)))
    ),
    "ActivateControllerAction is not read": scenario(
        {"Ego": STANDING["Ego"] + '<PrivateAction><ControllerAction><ActivateControllerAction lateral="true"/>'
         "</ControllerAction></PrivateAction>"}
    ),
    "SynchronizeAction is not read": scenario(
        {"Ego": STANDING["Ego"] + "<PrivateAction><SynchronizeAction/></PrivateAction>"}
    ),
    "RelativeLanePosition[@entityRef='gone'] is not read: it depends on": scenario(
        {"Ego": teleport(relative("Lane", "gone", dLane=0, ds=1, offset=0))}
    ),
    "RelativeLanePosition[@entityRef='Ego'] is not read: players differ": scenario(
        {"Ego": teleport(world(0.0, 0.0)), "b": teleport(relative("Lane", dLane=0, ds=1))}
    ),
    "RelativeRoadPosition[@entityRef='Ego'] is not read: players differ": scenario(
        {"Ego": teleport(world(0.0, 0.0)), "b": teleport(relative("Road", dt=0, ds=1))}
    ),
    "RelativeRoadPosition[@entityRef='Ego'] leads to lane": scenario(
        {**DRIVING, "b": teleport(relative("Road", dt=0, ds=-2))}
    ),
    "RelativeObjectPosition[@entityRef='b'] is not read": scenario(
        {"Ego": teleport(relative("Object", "b", dx=1, dy=1)), "b": teleport(relative("Object", dx=1, dy=1))}
    ),
    "leads to lane -1 of road 1 at s 9100 m": scenario(
        {"Ego": teleport(LANE_PLACE.format(s=100, offset=0).replace(f'"{LANE}"', '"-1"')),
         "b": teleport(relative("Lane", dLane=0, ds=9000))}
    ),
    "RelativeTargetSpeed[@entityRef='Ego'] is not read": scenario(
        {"Ego": STANDING["Ego"] + speed("3"), "b": STANDING["Ego"] + relative_speed(1, continuous="true")}
    ),
    "'refpoint_x_offset'] moves the reference point, in esmini alone": scenario(
        STANDING,
        entities=entity().replace(
            "</Vehicle>", '<Properties><Property name="refpoint_x_offset" value="2.9"/></Properties></Vehicle>'
        ),
    ),
    "makes -2 m/s, expected 0 to 300": scenario(
        {"Ego": STANDING["Ego"] + speed("3"), "b": STANDING["Ego"] + relative_speed(-5)}
    ),
    "begins at 1 s, as another of its entity does (line 1): the player decides": scenario(
        DRIVING, story(event(1, speed("3")), event(1, speed("4"), name="f"))
    ),
    "begins at 0 s, as another of its entity does": scenario(
        STANDING, story(event(0, follow(LINE))) + story(event(0, follow(LINE)))
    ),
    "followingMode is 'follow'": scenario({"Ego": follow(LINE, mode="follow")}),
    "time 0.5 s does not follow 1 s": scenario(
        {"Ego": follow(polyline((0.0, world(0.0, 0.0)), (1.0, world(1.0, 0.0)), (0.5, world(2.0, 0.0))))}
    ),
    "SpeedActionDynamics is linear over distance": scenario(
        {"Ego": STANDING["Ego"] + speed("3", "linear", "distance", "5")}
    ),
    "x is 'nan', expected a finite number": scenario({"Ego": teleport(world(float("nan"), 0.0))}),
    "y is '1e+308', expected a finite number up to 1e+12": scenario({"Ego": teleport(world(0.0, 1e308))}),
    "names the parameter 'a', which needs its own value": scenario(
        put("$a"),
        top='<ParameterDeclarations><ParameterDeclaration name="a" value="$b"/>'
        '<ParameterDeclaration name="b" value="${$a + 1}"/></ParameterDeclarations>',
    ),
    "names the parameter 'gone', which is not declared": scenario(put("$gone")),
    "is no arithmetic (ZeroDivisionError)": scenario(put("${1/0}")),
    "which is no arithmetic of OpenSCENARIO": scenario(put("${().a}")),
    "names road 'no', which is not on the map": scenario(
        {"Ego": teleport(LANE_PLACE.format(s=1, offset=0).replace(f'roadId="{ROAD}"', 'roadId="no"'))}
    ),
    "names lane 77": scenario(
        {"Ego": teleport(LANE_PLACE.format(s=1, offset=0).replace(f'laneId="{LANE}"', 'laneId="77"'))}
    ),
    "is on no lane that vehicles drive on, and has a speed": scenario(
        {"Ego": teleport(world(1e5, 1e5)) + speed("3")}
    ),
    "changes the speed of who follows a trajectory": scenario({"Ego": follow(LINE)}, story(event(2, speed("3")))),
    "its first vertex is at 2 s": scenario(
        {"Ego": STANDING["Ego"] + speed("5") + follow(polyline((2.0, world(9.0, 0.0)), (3.0, world(0.0, 0.0))))}
    ),
    "ego 'Ego' is put nowhere": scenario({"Ego": ""}),
    "has 0 entities called Ego or hero; its entities are b": scenario({"b": teleport(world(0.0, 0.0))}),
    "size is 0 x 2 m": scenario(STANDING, entities=entity().replace('length="5"', 'length="0"')),
    "is of version 1.7": scenario(STANDING, version="7"),
    "ends at 0 s": scenario(STANDING, stop=0),
    "ends at 1e+06 s": scenario(STANDING, stop=1e6),
    "has a DOCTYPE": '<!DOCTYPE a [<!ENTITY b "c">]>' + scenario(STANDING),
    "maximumExecutionCount is 3": scenario(STANDING, story(event(1, speed("3"))).replace('Count="1"', 'Count="3"')),
}  # fmt: skip


@pytest.mark.parametrize("why", REFUSED)
def test_what_is_refused_is_named(home: Path, why: str) -> None:
    with pytest.raises(InputError, match=r"drive\.xosc") as told:
        read(home, REFUSED[why])
    assert why.replace("size is", "is") in str(told.value)


def test_the_error_has_line_and_path_of_the_element(home: Path) -> None:
    text = scenario(STANDING, "\n\n" + story("\n" + event(1, LANE_CHANGE, name="change")))
    with pytest.raises(InputError) as told:
        read(home, text)
    path = (
        "line 4: Storyboard/Story[@name='s']/Act[@name='act']/ManeuverGroup[@name='g']/Maneuver[@name='m']/"
        "Event[@name='change']/Action[@name='a']/PrivateAction/LateralAction/LaneChangeAction"
    )
    assert path in str(told.value)


def test_a_stop_that_depends_on_the_player_needs_an_end(home: Path) -> None:
    text = scenario(STANDING).replace(AT.format(t=4.0).replace("StartT", "StopT"), "<StopTrigger/>")
    with pytest.raises(InputError, match=r"has no StopTrigger.*Name the end by --end"):
        read(home, text)
    text = text.replace("<StopTrigger/>", by_value(HEADWAY).replace("StartT", "StopT"))
    with pytest.raises(InputError, match=r"StopTrigger.*TimeHeadwayCondition.*Name the end by --end"):
        read(home, text)
    assert read(home, text, end=2.0).t[-1] == pytest.approx(2.0)


def test_what_is_before_the_end_that_is_asked_for_comes_in(home: Path) -> None:
    gt = read(home, scenario(STANDING, story(event(1, LANE_CHANGE))), end=1.0)
    assert gt.t[-1] == pytest.approx(1.0)


# --- damage

WHOLE = scenario(
    {
        "Ego": teleport(LANE_PLACE.format(s=100, offset=0)) + speed("${$v * 2}"),
        "b": follow(LINE), "c": teleport(world(0.0, 0.0, 0.5)),
    },
    story(event(1, speed("7", "cubic", "rate", "2")), event(2, speed("4", "sinusoidal", "time", "1"), "override"))
    + story(event(1, follow(LINE, 'domainAbsoluteRelative="relative" scale="1" offset="0"')), actor="c"),
    top=PARAMETER.format(name="v", value=4),
)  # fmt: skip
HOSTILE = ("nan", "inf", "-1", "0", "1e308", "-1e12", "", "1_0", "$v", "${$v", "${$v}", "${9**9**9}",
           "${" + "-" * 900 + "1}", "${" + "(" * 400 + "1" + ")" * 400 + "}", "x" * 5000, "true",
           "'\"", "\u202e", "0x1f", "1e-320")  # fmt: skip


def survives(home: Path, text: bytes) -> bool:
    """Whether it is read; what is refused is so in words, and soon."""
    begin = time.perf_counter()
    try:
        gt = read(home, text)
    except InputError:
        return False
    finally:
        assert time.perf_counter() - begin < 10.0
    assert np.isfinite(gt.x[gt.valid]).all()
    assert np.isfinite(gt.v[gt.valid]).all()
    return True


def test_the_file_that_is_damaged_below_is_read(home: Path) -> None:
    assert survives(home, WHOLE.encode())


@FUZZ
@given(data=st.data())
def test_damage_is_never_a_traceback(home: Path, data: st.DataObject) -> None:
    """Elements gone, doubled or moved, attributes hostile or gone."""
    root = etree.fromstring(WHOLE)
    for _ in range(data.draw(st.integers(1, 4))):
        every = [*root.iter()]
        one = every[data.draw(st.integers(1, len(every) - 1))] if len(every) > 1 else root
        how = data.draw(st.sampled_from(["remove", "double", "move", "attribute", "drop", "rename"]))
        keys = sorted(one.attrib)
        if how == "remove" and one.getparent() is not None:
            one.getparent().remove(one)
        elif how == "double" and one.getparent() is not None:
            one.addnext(copy.deepcopy(one))
        elif how == "move":
            target = every[data.draw(st.integers(0, len(every) - 1))]
            if target not in [one, *one.iterdescendants()] and one is not root:
                target.append(one)
        elif how == "rename":
            one.tag = data.draw(st.sampled_from(sorted({other.tag for other in every} | {"Trailer"})))
        elif keys:
            key = data.draw(st.sampled_from(keys))
            if how == "drop":
                del one.attrib[key]
            else:
                one.set(key, data.draw(st.sampled_from(HOSTILE)))
    survives(home, etree.tostring(root))


@FUZZ
@given(cut=st.integers(0, len(WHOLE)), noise=st.binary(max_size=8))
def test_cut_files_are_never_a_traceback(home: Path, cut: int, noise: bytes) -> None:
    survives(home, WHOLE.encode()[:cut] + noise)


def test_large_counts_end_soon(home: Path) -> None:
    many = [(0.001 * n, world(0.01 * n, 0.0)) for n in range(20_000)]
    gt = read(home, scenario({"Ego": follow(polyline(*many))}, stop=20.0))
    assert 1500 < len(gt.t) < 2500
    many_events = "".join(event(0.001 * n, speed(str(n % 30)), "override") for n in range(2000))
    assert not survives(home, scenario(DRIVING, story(many_events)).encode())
    assert survives(home, scenario(DRIVING, story(many_events.rpartition("<Event")[0])).encode())
    bomb = '<!DOCTYPE a [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>' + scenario(STANDING).replace(
        "drive", "&b;"
    )
    assert not survives(home, bomb.encode())
    assert not survives(home, scenario(STANDING, "<Story>" * 5000 + "</Story>" * 5000).encode())
    assert not survives(
        home,
        scenario({"Ego": teleport(LANE_PLACE.format(s=1, offset=0)) + speed("299")}, stop=14000).encode(),
    )


ALKS = DATA / "xosc" / "alks"


@pytest.mark.skipif(not ALKS.is_dir(), reason="needs ../shared/data")
def test_what_a_controller_drives_is_refused_and_what_is_before_comes_in(tmp_path: Path) -> None:
    """The scenarios of UN R157: the EGO is its controller's from 3 s on."""
    shutil.copytree(ALKS, tmp_path / "alks")
    shutil.copytree(DATA / "xodr" / "alks", tmp_path / "alks" / "road_networks")
    files = sorted((tmp_path / "alks").glob("*.xosc"))
    assert len(files) == 15
    came = []
    for file in files:
        with pytest.raises(InputError, match=r"line \d+: Storyboard/.* is not read"):
            read_openscenario(file)
        try:
            gt = read_openscenario(file, end=3.0).gt
        except InputError:
            continue
        came.append(file.name[14:19])
        assert gt.v[gt.index("Ego")] == pytest.approx(60.0 / 3.6)
        assert np.ptp(gt.x[0]) == pytest.approx(50.0, abs=0.5)
        if (
            file.name[14:19] == "4_1_3"
        ):  # the truck: a lane to the left, half a metre to its right, axle beside axle
            assert gt.y[gt.index("SideVehicle")] - gt.y[0] == pytest.approx(3.5 - 0.5, abs=1e-9)
            assert gt.v[gt.index("SideVehicle")] == pytest.approx(60.0 / 3.6)
    assert came == ["4_1_1", "4_1_3", "4_2_1", "4_2_2", "4_2_4", "4_6_1"]
