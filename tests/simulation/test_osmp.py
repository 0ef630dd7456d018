"""A traffic participant model of OSMP drives as the same function in Python does: it reads and writes OSI by itself."""

from __future__ import annotations

import math
import re
import subprocess
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import duckdb
import numpy as np
import pages
import pandas as pd
import pytest
from conftest import ROOT
from simulation.test_fmi import HEADERS, HERE, run

from resim.core.errors import InputError
from resim.function import EgoState, ObjectList
from resim.jobs.function import check_function
from resim.simulation.function import fmu
from resim.simulation.function.interface import load_build

pytest.importorskip("osi3")
from osi3.osi_common_pb2 import Orientation3d
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_object_pb2 import MovingObject
from osi3.osi_sensorview_pb2 import SensorView
from osi3.osi_trafficupdate_pb2 import TrafficUpdate

from resim.function.osmp import HOST, TrafficParticipant, within_view

MESSAGES = (
    ("OSMPSensorViewIn", "input"), ("OSMPTrafficUpdateOut", "output"),
    ("OSMPSensorViewInConfigRequest", "calculatedParameter"), ("OSMPSensorViewInConfig", "parameter"),
    ("OSMPTrafficCommandIn", "input"),
)  # fmt: skip
FMI2 = (
    '<?xml version="1.0"?><fmiModelDescription fmiVersion="2.0" modelName="osi" guid="{osi}">'
    '<CoSimulation modelIdentifier="osi"/><ModelVariables>'
    + "".join(
        f'<ScalarVariable name="{prefix}.{part}" valueReference="{3 * k + i}" causality="{causality}" '
        'variability="discrete"><Integer start="0"/></ScalarVariable>'
        for k, (prefix, causality) in enumerate(MESSAGES)
        for i, part in enumerate(("base.lo", "base.hi", "size"))
    )
    + '<ScalarVariable name="plain" valueReference="20" causality="parameter"><Integer start="0"/></ScalarVariable>'
    "</ModelVariables></fmiModelDescription>"
)
FMI3 = """<?xml version="1.0"?>
<fmiModelDescription fmiVersion="3.0" modelName="osi" instantiationToken="{osi}">
<CoSimulation modelIdentifier="osi"/><ModelVariables>
<Binary name="OSMPSensorViewIn" valueReference="0" causality="input"/>
<Binary name="OSMPTrafficUpdateOut" valueReference="1" causality="output"/>
<Binary name="OSMPGroundTruthInit" valueReference="2" causality="parameter" variability="fixed"/>
<Int32 name="plain" valueReference="3" causality="parameter"/>
</ModelVariables></fmiModelDescription>"""
BUILD = """name = "osi"
version = "1"
[fmi]
file = "osi.fmu"
osmp = true
[parameters]
plain = {plain}
"""
PYTHON = """
from resim.function import Command

class Follow:
    def reset(self, setup):
        self.length, self.cycle = setup.length, setup.cycle

    def step(self, p):
        a = 0.4 * (25.0 - p.ego.v)
        for x, y, heading, v, length in zip(p.x_ego, p.y_ego, p.heading_ego, p.v, p.length):
            if x > 0.0 and abs(y) <= 1.5:
                lead = v * __import__("math").cos(heading)
                gap = x - 0.5 * (length + self.length)
                a = min(a, 0.25 * (gap - 4.0 - 1.2 * p.ego.v) + 0.8 * (lead - p.ego.v))
        a = min(max(a, -8.0), 2.0)
        return Command(max(a, -p.ego.v / self.cycle), 0.0)

    def close(self):
        pass
"""


def unit(folder: Path, version: int = 2, description: str = "", plain: int = 0) -> Path:
    """A build of the unit of FMI 2 or 3; a description of its own has no library."""
    folder.mkdir(exist_ok=True)
    place = {2: "linux64", 3: "x86_64-linux"}[version]
    with zipfile.ZipFile(folder / "osi.fmu", "w") as packed:
        packed.writestr("modelDescription.xml", description or {2: FMI2, 3: FMI3}[version])
        packed.writestr(f"binaries/{place}/osi.so", "" if description else compiled(folder, version))
    (folder / "osi.toml").write_text(BUILD.format(plain=plain), encoding="utf-8")
    return folder / "osi.toml"


def compiled(folder: Path, version: int) -> bytes:
    header = (HEADERS / f"fmi{version}Functions.h").read_text(encoding="utf-8")
    names = re.findall(rf"^#define (fmi{version}\w+) +fmi{version}FullName", header, re.MULTILINE)
    others = folder / "others.c"  # every unit has all functions of the standard
    others.write_text("".join(f"__attribute__((weak)) int {name}(void) {{ return 3; }}\n" for name in names))
    flags = [f"-DFMI={version}", "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-I", HEADERS]
    order = ["cc", *flags, HERE / "fmi_osi.c", others, "-lm", "-o", folder / "osi.so"]
    subprocess.run(order, check=True)
    return (folder / "osi.so").read_bytes()


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    folder = tmp_path_factory.mktemp("python")
    (folder / "osi.py").write_text(PYTHON, encoding="utf-8")
    (folder / "osi.toml").write_text(
        'name = "osi"\nversion = "1"\nfactory = "osi:Follow"\n', encoding="utf-8"
    )
    return driven(folder / "osi.toml", folder / "out")


def driven(path: Path, out: Path) -> pd.DataFrame:
    done = run(path, out)
    assert done.returncode in (0, 1), done.stderr
    return duckdb.read_parquet(str(out / "tracks.parquet")).df()


@pytest.mark.parametrize(("version", "plain"), [(2, 0), (3, 0), (2, 1), (2, 2)])
@pytest.mark.slow
def test_a_unit_that_speaks_osi_drives_as_the_same_function_in_python_does(
    expected: pd.DataFrame, tmp_path: Path, version: int, plain: int
) -> None:
    """Whether it gives its state and trajectory, its state alone (1), or its trajectory alone (2)."""
    found = driven(unit(tmp_path / "unit", version, plain=plain), tmp_path / "out")
    assert found.shape == expected.shape
    numbers = expected.select_dtypes("number").columns
    ego = expected[expected["id"] == "ego"]
    assert np.ptp(ego["v"]) > 5.0
    # of a trajectory the speed at the end is half a step behind: the last difference between its points
    within = 1e-6 if plain < 2 else 0.3
    np.testing.assert_allclose(found[numbers], expected[numbers], rtol=0.0, atol=within)


@pytest.mark.slow
def test_a_unit_is_checked_as_any_other_by_the_guides_example(tmp_path: Path) -> None:
    path = unit(tmp_path)
    path.with_name("osi.fmu").rename(path.with_name("participant.fmu"))
    said = pages.named(ROOT / "docs" / "guides" / "outside.md", "toml")["participant.toml"]
    path.write_text(said, encoding="utf-8")
    found = check_function(path)
    assert found.good, found.checks


@pytest.mark.parametrize(
    ("version", "old", "new", "why"),
    [
        (2, "OSMPTrafficUpdateOut", "OSMPSensorDataOut", "its messages are: OSMPSensorDataOut"),
        (2, 'name="OSMPSensorViewIn.', 'name="OSMPSensorViewIn[1].', "the unit has no OSMPSensorViewIn"),
        (2, 'name="OSMPTrafficUpdateOut.size"', 'name="OSMPTrafficUpdateOut.length"', "is no message of OSMP"),
        (2, 'causality="output"', 'causality="local"', "OSMPTrafficUpdateOut is no message of OSMP"),
        (3, "Binary", "String", "OSMPSensorViewIn is no message of OSMP, expected one variable of type Binary, or"),
    ],
)  # fmt: skip
def test_a_unit_that_is_no_traffic_participant_is_refused(
    tmp_path: Path, version: int, old: str, new: str, why: str
) -> None:
    description = {2: FMI2, 3: FMI3}[version].replace(old, new)
    with pytest.raises(InputError, match=r"osi\.toml") as told:
        load_build(unit(tmp_path, version, description))
    assert why in str(told.value)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("osmp = true", "", "outputs: acceleration is missing, or osmp = true"),
        ("osmp = true", 'osmp = true\noutputs = {acceleration = "a"}', "with osmp the answer is"),
    ],
)
def test_a_build_says_how_its_unit_answers(tmp_path: Path, old: str, new: str, why: str) -> None:
    path = unit(tmp_path, 2, FMI2)
    path.write_text(path.read_text().replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=why):
        load_build(path)


def test_without_osi_its_install_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = unit(tmp_path, 2, FMI2)
    monkeypatch.setattr(fmu.importlib.util, "find_spec", lambda name: None if name == "osi3" else name)
    with pytest.raises(
        InputError, match=r"needs osi-python. In resim's own folder: pip install '.\[fmi,osi\]'"
    ):
        load_build(path)


class _Setup:
    length, width, cycle, goal = 4.0, 2.0, 0.1, (50.0, 60.0)


def seen(heading: float = 0.0, v: float = 20.0, t: float = -0.2) -> ObjectList:
    one = [np.array([value]) for value in (10.0, 2.0, 0.5, 5.0, 4.5, 1.8, np.nan)]
    return ObjectList(t, EgoState(1.0, 2.0, heading, v, 1.0, 0.1), np.array(["7a"]), np.array(["bus"]), *one)


def update(heading: float, v: float) -> TrafficUpdate:
    told = TrafficUpdate()
    own = told.update.add()
    own.id.value = 1
    own.base.orientation.yaw = heading
    own.base.velocity.x, own.base.velocity.y = v * math.cos(heading), v * math.sin(heading)
    return told


@pytest.mark.parametrize(("radius", "heading"), [(50.0, 0.3), (-20.0, 3.13), (1e6, -3.14)])
def test_the_answer_is_what_brings_the_ego_to_the_state_of_the_update(radius: float, heading: float) -> None:
    v = 22.0
    turned = 0.5 * (20.0 + v) * _Setup.cycle / radius
    given = update(heading + turned, v).SerializeToString()
    a, curvature, plan = TrafficParticipant(_Setup()).answer(given, seen(heading), 0.0)
    assert (a, curvature, plan) == (pytest.approx(20.0), pytest.approx(1.0 / radius), None)


def test_who_stands_does_not_turn() -> None:
    answer = TrafficParticipant(_Setup()).answer(update(0.1, 0.0).SerializeToString(), seen(0.0, 0.0), 0.0)
    assert answer == (0.0, 0.0, None)


def test_a_trajectory_is_the_plan_in_the_time_of_the_scenario() -> None:
    told = update(0.0, 20.0)
    for k in range(4):
        point = told.update[0].future_trajectory.add()
        point.timestamp.seconds, point.timestamp.nanos = 3, 500_000_000 + k * 100_000_000
        point.position.x, point.position.y = 1.0 + 3.0 * k, 2.0 + 4.0 * k
    plan = TrafficParticipant(_Setup()).answer(told.SerializeToString(), seen(), 3.5)[2]
    rows = [[-0.2 + 0.1 * k, 1.0 + 3.0 * k, 2.0 + 4.0 * k, 50.0] for k in range(4)]
    np.testing.assert_allclose(plan, rows, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda told: told.ClearField("update"), "0 updates of the host vehicle"),
        (lambda told: told.update.append(told.update[0]), "2 updates of the host vehicle"),
        (
            lambda told: told.update[0].ClearField("base"),
            r"neither base.velocity.x and y nor a future_trajectory",
        ),
        (lambda told: told.update[0].base.velocity.ClearField("y"), r"neither base.velocity.x and y nor"),
        (
            lambda told: [told.update[0].future_trajectory.add() for _ in "ab"],
            r"\[0\].timestamp.seconds is missing",
        ),
        (lambda told: trajectory(told, times=(0.0, 0.0)), "do not increase"),
        (lambda told: trajectory(told).position.ClearField("y"), r"\[0\].position.y is missing"),
        (lambda told: trajectory(told, begin=-3.0), "ends 2.8 s before now, which is 5 s"),
        (
            lambda told: only(told, begin=100.0),
            "lasts from 100 to 100.2 s after now, without the end of the step at 0.1 s",
        ),
        (lambda told: only(told, begin=-0.15), "lasts from -0.15 to 0.05 s after now"),
    ],
)
def test_an_update_that_says_nothing_is_no_answer(change, why: str) -> None:
    told = update(0.0, 20.0)
    change(told)
    with pytest.raises(ValueError, match=why):
        TrafficParticipant(_Setup()).answer(told.SerializeToString(), seen(), 5.0)


def trajectory(
    told: TrafficUpdate, *, v: float = 20.0, heading: float = 0.0, yaw: bool = True, begin: float = 0.0,
    times: tuple[float, ...] = (0.0, 0.1, 0.2),
) -> Any:  # fmt: skip
    """Add a straight trajectory from 5 s of the unit on, and give its first point."""
    for t in times:
        point = told.update[0].future_trajectory.add()
        nanos = round((5.0 + begin + t) * 1e9)
        point.timestamp.seconds, point.timestamp.nanos = divmod(nanos, 1_000_000_000)
        point.position.x = 1.0 + v * t * math.cos(heading)
        point.position.y = 2.0 + v * t * math.sin(heading)
        if yaw:
            point.orientation.yaw = heading
    return told.update[0].future_trajectory[0]


def only(told: TrafficUpdate, **given: Any) -> None:
    told.update[0].ClearField("base")
    trajectory(told, **given)


@pytest.mark.parametrize("v", [20.0, -20.0])
@pytest.mark.parametrize(
    "change",
    [
        lambda told, v: only(told, heading=1.0, v=v),
        lambda told, v: only(told, heading=1.0, v=v, yaw=False),
        lambda told, v: told.update[0].base.ClearField("orientation"),
        lambda told, v: told.update[0].base.orientation.CopyFrom(Orientation3d(roll=0.0)),
        lambda told, v: (told.update[0].base.ClearField("velocity"), trajectory(told, heading=1.0, v=v)),
        lambda told, v: (told.update[0].base.velocity.Clear(), trajectory(told, heading=1.0, v=v, yaw=False)),
        lambda told, v: (told.update[0].base.orientation.Clear(), trajectory(told, heading=1.0, v=v)),
    ],
)  # fmt: skip
def test_what_an_update_lacks_follows_from_the_rest_of_it(change, v: float) -> None:
    told = update(1.0, v)
    change(told, v)
    a, curvature, plan = TrafficParticipant(_Setup()).answer(told.SerializeToString(), seen(1.0, v), 5.0)
    assert (a, curvature) == (pytest.approx(0.0, abs=1e-6), pytest.approx(0.0, abs=1e-6))
    assert plan is None or plan[:, 3] == pytest.approx(v)


def test_headings_of_positions_follow_a_bend_and_stay_where_it_stops() -> None:
    told = TrafficUpdate()
    told.update.add().id.value = 1
    for k in range(6):
        turned = 2.0 * min(k, 3) / 50.0
        point = told.update[0].future_trajectory.add()
        point.timestamp.seconds, point.timestamp.nanos = 5, k * 100_000_000
        point.position.x, point.position.y = 50.0 * math.sin(turned), 50.0 * (1.0 - math.cos(turned))
    curvature = TrafficParticipant(_Setup()).answer(told.SerializeToString(), seen(), 5.0)[1]
    assert curvature == pytest.approx(1.0 / 50.0, rel=0.01)


def test_what_the_function_sees_is_in_the_view() -> None:
    speaker = TrafficParticipant(_Setup())
    speaker.view(seen(), 0.0)
    view = SensorView.FromString(speaker.view(seen(math.pi / 2, t=0.3), 12.3456789))
    assert (view.timestamp.seconds, view.timestamp.nanos) == (12, 345_678_900)
    truth = view.global_ground_truth
    ego, other = truth.moving_object
    assert (truth.host_vehicle_id.value, ego.id.value, other.id.value) == (1, 1, 2)
    assert [*other.source_reference[0].identifier] == ["7a"]
    assert other.vehicle_classification.type == MovingObject.VehicleClassification.TYPE_BUS
    base = other.base
    found = [base.position.x, base.position.y, base.orientation.yaw, base.velocity.x, base.velocity.y]
    turned = math.pi / 2 + 0.5
    np.testing.assert_allclose(
        found, [-1.0, 12.0, turned, 5 * math.cos(turned), 5 * math.sin(turned)], atol=1e-12
    )
    assert (base.dimension.length, base.dimension.width) == (4.5, 1.8)
    # ahead 1 m/s², and to the left v x yaw rate
    np.testing.assert_allclose([ego.base.acceleration.x, ego.base.acceleration.y], [-2.0, 1.0], atol=1e-12)


def test_the_lanes_are_those_of_the_map() -> None:
    """Against OSI's own rules: neighbours and successors point at each other."""
    from resim.function import LaneMap
    from resim.road.opendrive.network import load
    from resim.simulation.function.messages import _lanes

    class Setup(_Setup):
        road = LaneMap({"file": "map", "lanes": _lanes(load(ROOT / "networks" / "proving_ground.xodr"))})

    static = TrafficParticipant(Setup()).static()
    truth = GroundTruth.FromString(static)
    lanes = {one.id.value: one.classification for one in truth.lane}
    borders = {one.id.value: one for one in truth.lane_boundary}
    assert len(lanes) == len(Setup.road.lanes)
    pairs = 0
    for k, lane in lanes.items():
        for left in lane.left_adjacent_lane_id:
            assert k in [one.value for one in lanes[left.value].right_adjacent_lane_id]
        end, start = (lane.centerline[at] for at in (-1, 0))
        for pair in lane.lane_pairing:
            at, to = (
                (end, pair.successor_lane_id)
                if pair.HasField("successor_lane_id")
                else (start, pair.antecessor_lane_id)
            )
            other = lanes[to.value].centerline
            assert min(math.hypot(at.x - one.x, at.y - one.y) for one in (other[0], other[-1])) < 0.1
            pairs += 1
        (side,) = lane.left_lane_boundary_id
        assert borders[side.value].boundary_line
    assert pairs > 10
    merged = SensorView.FromString(within_view(static) + TrafficParticipant(Setup()).view(seen(), 0.0))
    assert len(merged.global_ground_truth.lane) == len(lanes)
    assert len(merged.global_ground_truth.moving_object) == 2


@pytest.mark.parametrize("older", [0.0, 0.04, 4.0])
def test_an_update_of_an_earlier_step_is_refused(older: float) -> None:
    setup = SimpleNamespace(cycle=0.04, length=4.7, width=1.9)
    update = TrafficUpdate()
    update.timestamp.seconds, update.timestamp.nanos = divmod(round((5.0 - older) * 1e9), 10**9)
    own = update.update.add()
    own.id.value, own.base.velocity.x, own.base.velocity.y, own.base.orientation.yaw = HOST, 20.0, 0.0, 0.0
    seen = SimpleNamespace(t=5.0, ego=EgoState(0.0, 0.0, 0.0, 20.0))
    participant = TrafficParticipant(setup)
    if not older:
        assert participant.answer(update.SerializeToString(), seen, 5.0)[0] == 0.0
    else:
        with pytest.raises(ValueError, match="older than this step"):
            participant.answer(update.SerializeToString(), seen, 5.0)
