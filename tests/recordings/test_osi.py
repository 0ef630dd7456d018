"""Traces of OSI become recordings without losing a digit, and damaged ones are refused by name and place."""

from __future__ import annotations

import io
import math
import random
import re
from pathlib import Path

import numpy as np
import pytest
from conftest import DATA, ROOT
from hypothesis import given
from hypothesis import strategies as st

from resim.core.errors import InputError
from resim.recordings import Recording, write_tables
from resim.recordings.checks import examine
from resim.recordings.formats.osi import read_osi
from resim.recordings.source import recording_of

pytest.importorskip("osi3")
from mcap.writer import Writer
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_object_pb2 import MovingObject
from osi3.osi_sensordata_pb2 import SensorData
from osi3.osi_sensorview_pb2 import SensorView

MAP = ROOT / "networks" / "proving_ground.xodr"


def truth(nanos: int, states: dict[int, tuple[float, ...]], host: int | None = 7) -> GroundTruth:
    """A message; states: x, y, heading, v of each id."""
    told = GroundTruth()
    told.timestamp.seconds, told.timestamp.nanos = divmod(nanos, 10**9)
    if host is not None:
        told.host_vehicle_id.value = host
    for number, (x, y, heading, v) in states.items():
        one = told.moving_object.add()
        one.id.value = number
        one.type = MovingObject.TYPE_VEHICLE
        one.vehicle_classification.type = MovingObject.VehicleClassification.TYPE_BUS
        one.base.position.x, one.base.position.y = x, y
        one.base.orientation.yaw = heading
        one.base.velocity.x, one.base.velocity.y = v * math.cos(heading), v * math.sin(heading)
        one.base.dimension.length, one.base.dimension.width = 4.5, 1.8
    return told


def write(path: Path, messages: list) -> Path:
    if path.suffix == ".osi":
        bodies = [one.SerializeToString() for one in messages]
        path.write_bytes(b"".join(len(body).to_bytes(4, "little") + body for body in bodies))
        return path
    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start()
    schema = writer.register_schema(f"osi3.{type(messages[0]).__name__}", "protobuf", b"")
    channel = writer.register_channel("truth", "protobuf", schema)
    for k, one in enumerate(messages):
        writer.add_message(channel, log_time=k, data=one.SerializeToString(), publish_time=k)
    writer.finish()
    path.write_bytes(buffer.getvalue())
    return path


def read(path: Path, **how) -> Recording:
    return recording_of(read_osi(path, **{"map": MAP, **how}))


FAR = st.sampled_from([0.0, 1e6, -5.4e6])
BEGIN = st.sampled_from([0, 1_700_000_000_123_456_789, 999_999_999])


@given(
    far=FAR, begin=BEGIN, heading=st.floats(-3.1, 3.1), v=st.floats(-5.0, 40.0),
    ending=st.sampled_from([".osi", ".mcap"]), as_view=st.booleans(), gap=st.integers(10**5, 10**9),
)  # fmt: skip
def test_no_digit_is_lost(
    tmp_path_factory: pytest.TempPathFactory, far: float, begin: int, heading: float, v: float, ending: str,
    as_view: bool, gap: int,
) -> None:  # fmt: skip
    """At UTM coordinates and times of today states are equal to 1e-6 m and 1e-9 s."""
    times = [begin + gap * k for k in range(5)]
    states = [{7: (far + k, 2 * far - k, heading, v), 12: (far - k, k, heading, v)} for k in range(5)]
    messages = [truth(t, state) for t, state in zip(times, states, strict=True)]
    if as_view:
        views = [SensorView(global_ground_truth=one, host_vehicle_id=one.host_vehicle_id) for one in messages]
        for view, one in zip(views, messages, strict=True):
            view.timestamp.CopyFrom(one.timestamp)
        messages = views
    path = write(tmp_path_factory.mktemp("osi") / f"trace{ending}", messages)
    found = read(path)
    assert (found.ego, found.gt.ids.tolist()) == ("7", ["7", "12"])
    np.testing.assert_allclose(found.gt.t, [gap * k * 1e-9 for k in range(5)], rtol=0, atol=1e-9)
    assert found.gt.x.tolist() == [[far + k for k in range(5)], [far - k for k in range(5)]]
    assert found.gt.y.tolist() == [[2 * far - k for k in range(5)], [float(k) for k in range(5)]]
    np.testing.assert_allclose(found.gt.v, v, atol=1e-9)
    np.testing.assert_allclose(found.gt.heading, heading, atol=1e-12)
    assert found.gt.kind.tolist() == ["bus", "bus"]
    assert found.provenance["first_message"] == f"{begin // 10**9}.{begin % 10**9:09d} s"


def moving(n: int = 4) -> list[GroundTruth]:
    return [truth(10**8 * k, {7: (2.0 * k, 0.0, 0.0, 20.0), 8: (30.0 + k, 0.0, 0.0, 10.0)}) for k in range(n)]


def test_what_is_not_said_is_not_made_up(tmp_path: Path) -> None:
    messages = moving()
    for one in messages:
        one.moving_object[1].type = MovingObject.TYPE_PEDESTRIAN
    found = read(write(tmp_path / "a.osi", messages))
    assert found.gt.a is None
    assert found.gt.kind.tolist() == ["bus", "pedestrian"]
    assert found.gt.z is None


def changed(messages: list[GroundTruth], how) -> list[GroundTruth]:
    how(messages)
    return messages


def own(messages: list[GroundTruth], k: int, n: int):
    return messages[k].moving_object[n].base


REFUSED = {
    "names no host vehicle; its moving objects are 7, 8": lambda m: [
        one.ClearField("host_vehicle_id") for one in m
    ],
    "message 3 is of 0.100 s, not after 0.100 s of the one before": lambda m: m[2].timestamp.CopyFrom(
        m[1].timestamp
    ),
    "message 2 has the moving object 8 twice": lambda m: m[1].moving_object.append(m[1].moving_object[1]),
    "message 4, moving object 8: base.position.y is missing": lambda m: own(m, 3, 1).position.ClearField("y"),
    "message 1, moving object 7: base.position.x is nan": lambda m: setattr(
        own(m, 0, 0).position, "x", math.nan
    ),
    "moving object 7: base.dimension.width is missing": lambda m: own(m, 0, 0).dimension.ClearField("width"),
    "moving object 8: base.velocity.x is inf": lambda m: setattr(own(m, 2, 1).velocity, "x", math.inf),
    "has no moving object in any message": lambda m: [one.ClearField("moving_object") for one in m],
}


@pytest.mark.parametrize("why", REFUSED)
def test_what_is_wrong_in_a_trace_is_named(tmp_path: Path, why: str) -> None:
    path = write(tmp_path / "trace.osi", changed(moving(), REFUSED[why]))
    with pytest.raises(InputError, match=r"trace\.osi") as told:
        read_osi(path, map=MAP)
    assert why in str(told.value)


@pytest.mark.parametrize("ending", [".osi", ".mcap"])
def test_a_damaged_trace_is_refused_or_read_but_never_a_traceback(tmp_path: Path, ending: str) -> None:
    whole = write(tmp_path / f"whole{ending}", moving()).read_bytes()
    draw = random.Random(1)
    refused = 0
    for k in range(300):
        raw = bytearray(whole)
        if k % 3 == 0:
            raw = raw[: draw.randrange(len(raw))]
        for _ in range(draw.randrange(1, 4)):
            if raw:
                raw[draw.randrange(len(raw))] = draw.randrange(256)
        path = tmp_path / f"damaged{ending}"
        path.write_bytes(raw)
        try:
            read_osi(path, map=MAP)
        except InputError:
            refused += 1
    assert refused > 100


def test_a_speed_that_is_not_said_is_left_to_the_check(tmp_path: Path) -> None:
    messages = moving()
    own(messages, 2, 1).ClearField("velocity")
    found = read_osi(write(tmp_path / "trace.osi", messages), map=MAP)
    assert found.gt["v"].isna().tolist() == [False] * 5 + [True] + [False] * 2
    assert [(f.code, f.object) for f in examine(found, None)] == [("MISSING_VALUES", "8")]


def test_nothing_is_cut_that_nobody_cuts(tmp_path: Path) -> None:
    """Others go on after the EGO's last sample, and it is away in between: the recording has it all."""
    messages = moving(8)
    for k in (3, 7):
        messages[k].moving_object.remove(messages[k].moving_object[0])
    found = read_osi(write(tmp_path / "trace.osi", messages), map=MAP)
    assert found.gt.groupby("id").size().to_dict() == {"7": 6, "8": 8}
    assert found.gt["t"].max() == pytest.approx(0.7)
    assert "1 rows before 0 s or after 0.6 s" in found.settings.provenance["without_ego"]
    cut = read_osi(write(tmp_path / "trace.osi", messages), map=MAP, start=0.1, end=0.6)
    assert cut.gt["t"].tolist() == pytest.approx([0.0, 0.0, 0.1, 0.1, 0.2, 0.3, 0.3, 0.4, 0.4, 0.5, 0.5])


def test_a_heading_that_is_not_said_is_left_to_the_check(tmp_path: Path) -> None:
    messages = moving()
    own(messages, 1, 1).ClearField("orientation")
    found = read_osi(write(tmp_path / "trace.osi", messages), map=MAP)
    assert found.gt["heading"].isna().sum() == 1


@pytest.mark.parametrize(("late", "left"), [(0.0, 4), (0.2, 2), (50.0, 0)])
def test_detections_at_other_times_than_the_hosts_are_told(tmp_path: Path, late: float, left: int) -> None:
    gt = write(tmp_path / "gt.osi", moving())
    seen = detections([(round(1e9 * (0.1 * k + late)), {31: (30.0, 0.0, 0.0, 0.0, 0.0)}) for k in range(4)])
    sd = write(tmp_path / "sd.osi", seen)
    if not left:
        with pytest.raises(
            InputError, match=r"SensorData is of 50 to 50\.3 s, in which the host vehicle is nowhere"
        ):
            read_osi(gt, map=MAP, sd=sd)
        return
    found = read_osi(gt, map=MAP, sd=sd)
    assert len(found.sd) == left
    assert ("sensor_data_left_out" in found.settings.provenance) is (left < 4)


def test_a_trace_of_no_detections_is_refused(tmp_path: Path) -> None:
    (tmp_path / "sd.osi").write_bytes(b"")
    with pytest.raises(InputError, match="has no message of SensorData"):
        read_osi(write(tmp_path / "gt.osi", moving()), map=MAP, sd=tmp_path / "sd.osi")


def test_a_flipped_bit_of_an_mcap_file_is_found(tmp_path: Path) -> None:
    """Chunks have checksums: a place that moved is none of theirs."""
    path = write(tmp_path / "a.mcap", moving(50))
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 4] ^= 4
    path.write_bytes(raw)
    with pytest.raises(InputError, match="is damaged"):
        read_osi(path, map=MAP)


def detections(
    states: list[tuple[int, float, dict[int, tuple[float, ...]]]], **how: object
) -> list[SensorData]:
    """Messages of a sensor 1.5 m before and 0.2 m left of the rear axle, turned by 90 degrees; ns, and by id x, y,
    heading, vx, vy in its frame."""
    out = []
    for nanos, objects in states:
        told = SensorData()
        told.timestamp.seconds, told.timestamp.nanos = divmod(nanos, 10**9)
        told.mounting_position.position.x, told.mounting_position.position.y = 1.5, 0.2
        told.mounting_position.orientation.yaw = math.pi / 2
        for number, (x, y, heading, vx, vy) in objects.items():
            one = told.moving_object.add()
            one.header.tracking_id.value = number
            one.header.ground_truth_id.add().value = 8
            one.header.existence_probability = 0.75
            one.base.position.x, one.base.position.y, one.base.orientation.yaw = x, y, heading
            one.base.velocity.x, one.base.velocity.y = vx, vy
            one.base.dimension.length, one.base.dimension.width = 4.0, 1.7
        out.append(told)
    return out


def test_what_a_sensor_detects_is_where_it_is_in_the_map(tmp_path: Path) -> None:
    """The host goes along +y at 20 m/s; what is 30 m ahead of its sensor's place, and 2 m to its left, at 15 m/s."""
    messages = [
        truth(10**8 * k, {7: (5.0, 2.0 * k, math.pi / 2, 20.0), 8: (3.0, 40.0 + 1.5 * k, math.pi / 2, 15.0)})
        for k in range(4)
    ]
    for one in messages:
        one.moving_object[0].vehicle_attributes.bbcenter_to_rear.x = -1.4
    seen = detections([(10**8 * k, {31: (2.0, -30.0, -math.pi / 2, 0.0, 5.0)}) for k in range(4)])
    sd = write(tmp_path / "sd.osi", seen)
    found = read(write(tmp_path / "gt.osi", messages), sd=sd)
    assert found.sd is not None
    assert (found.sd.ids.tolist(), found.sd_gt_id.tolist()) == (["31"], ["8"])
    np.testing.assert_allclose(found.sd.x, [[5.0 - 0.2 - 2.0] * 4], atol=1e-9)
    np.testing.assert_allclose(found.sd.y, [[2.0 * k - 1.4 + 1.5 + 30.0 for k in range(4)]], atol=1e-9)
    np.testing.assert_allclose(found.sd.heading, math.pi / 2, atol=1e-9)
    np.testing.assert_allclose(found.sd.v, 15.0, atol=1e-9)
    assert (found.existence_probability == 0.75).all()


def test_topics_that_do_not_fit_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic in ("one", "two"):
            schema = writer.register_schema("osi3.GroundTruth", "protobuf", b"")
            channel = writer.register_channel(topic, "protobuf", schema)
            writer.add_message(channel, log_time=0, data=b"", publish_time=0)
        writer.finish()
    with pytest.raises(
        InputError, match=r"has 2 topics of GroundTruth or SensorView, expected one; .*: one \(Ground"
    ):
        read_osi(path, map=MAP)


REAL = {
    "acc-test.osi": ("0", 2, 33.3),
    "alks_cut-in.osi": ("0", 2, 10.03),
    "osi_centerline_example.mcap": (None, 14, 9.0),
}


@pytest.mark.skipif(not (DATA / "osi").is_dir(), reason="needs ../shared/data")
@pytest.mark.parametrize("name", REAL)
def test_traces_of_others_come_in(name: str) -> None:
    """Speeds are those of the way driven, and vehicles drive where they head."""
    ego, count, lasts = REAL[name]
    found = read(DATA / "osi" / name, map=DATA / "osi" / "straight_500m.xodr", ego=ego).gt
    assert (len(found.ids), round(float(np.ptp(found.t)), 2)) == (count, lasts)
    for n in range(count):
        own = found.valid[n]
        x, y, v, t = found.x[n, own], found.y[n, own], found.v[n, own], found.t[own]
        way = np.hypot(np.diff(x), np.diff(y)).sum()
        assert way == pytest.approx(np.abs(0.5 * (v[1:] + v[:-1]) * np.diff(t)).sum(), rel=0.05, abs=0.3)


@pytest.mark.parametrize("of", ["acceleration.x", "orientation_rate.yaw", "position.z", "orientation.yaw"])
def test_what_could_not_be_read_again_is_not_written(tmp_path: Path, of: str) -> None:
    messages = [truth(k * 10**8, {7: (10.0 * k, 0.0, 0.0, 100.0)}) for k in range(3)]
    part, field = of.split(".")
    for one in messages:
        one.moving_object[0].base.dimension.height = 1.5
    for number in (1e300, math.inf):
        setattr(getattr(messages[1].moving_object[0].base, part), field, number)
        with pytest.raises(InputError, match=re.escape("a.osi")):
            write_tables(read_osi(write(tmp_path / "a.osi", messages), map=MAP), tmp_path / "out")
        assert not (tmp_path / "out").exists()


def test_a_window_between_two_messages_is_refused(tmp_path: Path) -> None:
    messages = [truth(k * 10**8, {7: (10.0 * k, 0.0, 0.0, 100.0)}) for k in range(3)]
    with pytest.raises(InputError, match=r"ego '7' has no sample from 0\.12 to 0\.18 s"):
        read(write(tmp_path / "a.osi", messages), start=0.12, end=0.18)
