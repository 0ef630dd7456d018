from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from resim.core.errors import InputError
from resim.core.tracks import Tracks
from resim.recordings import Recording, read_commonroad, write_recording

RECTANGLE = "<rectangle><length>4</length><width>2</width></rectangle>"


def exact(tag: str, value: object) -> str:
    return f"<{tag}><exact>{value}</exact></{tag}>"


def state(t: float, x: float, *, tag: str = "state", v: str = exact("velocity", 10), more: str = "") -> str:
    point = f"<position><point><x>{x}</x><y>1</y></point></position>"
    return f"<{tag}>{point}{exact('orientation', 0.1)}{exact('time', t)}{v}{more}</{tag}>"


def dynamic(
    name: str, states: str, *, shape: str = RECTANGLE, kind: str = "car", version: str = "2020a"
) -> str:
    inside = f"<type>{kind}</type><shape>{shape}</shape>"
    if version == "2018a":
        inside = f"<role>dynamic</role>{inside}<trajectory>{states}</trajectory>"
        return f'<obstacle id="{name}">{inside}</obstacle>'
    first, _, rest = states.partition("</state>")
    initial = first.replace("<state>", "<initialState>") + "</initialState>"
    return f'<dynamicObstacle id="{name}">{inside}{initial}<trajectory>{rest}</trajectory></dynamicObstacle>'


def read(
    tmp_path: Path, body: str, *, version: str = "2020a", head: str = "", start: float | None = None
) -> Recording:
    path, road = tmp_path / "s.xml", tmp_path / "s.xodr"
    road.write_text("<OpenDRIVE/>")
    root = f'<commonRoad commonRoadVersion="{version}" timeStepSize="0.1" benchmarkID="S">'
    path.write_text(f"{head}{root}{body}</commonRoad>")
    return read_commonroad(path, map=road, ego="1", start=start)


EGO = state(0, 0) + state(1, 1) + state(2, 2)


def test_times_are_steps_since_2018b_and_seconds_before(tmp_path: Path) -> None:
    steps = read(tmp_path, dynamic("1", EGO)).gt
    np.testing.assert_allclose(steps.t, [0.0, 0.1, 0.2])
    seconds = read(tmp_path, dynamic("1", EGO, version="2018a"), version="2018a").gt
    np.testing.assert_allclose(seconds.t, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(seconds.x, [[0.0, 1.0, 2.0]])


def test_intervals_count_as_their_middle_and_circles_as_squares(tmp_path: Path) -> None:
    span = "<intervalStart>9</intervalStart><intervalEnd>10</intervalEnd>"
    circle = "<circle><radius>0.3</radius></circle>"
    walker = state(1, 3, v=f"<velocity>{span}</velocity>", more=exact("acceleration", 0.5)) + state(2, 4)
    body = dynamic("1", EGO) + dynamic("7", walker, shape=circle, kind="pedestrian")
    gt = read(tmp_path, body).gt
    assert gt.kind.tolist() == ["car", "pedestrian"]
    np.testing.assert_array_equal(gt.v[1], [np.nan, 9.5, 10.0])
    assert gt.a is not None
    np.testing.assert_array_equal(gt.a[1], [np.nan, 0.5, np.nan])
    assert gt.yaw_rate is None
    assert (gt.length[1], gt.width[1]) == (0.6, 0.6)


def test_parked_vehicles_stand_for_the_whole_window_and_walls_are_left_out(tmp_path: Path) -> None:
    def static(name: str, kind: str) -> str:
        inside = f"<type>{kind}</type><shape>{RECTANGLE}</shape>{state(0, 8, tag='initialState', v='')}"
        return f'<staticObstacle id="{name}">{inside}</staticObstacle>'

    body = dynamic("1", EGO) + static("2", "parkedVehicle") + static("3", "building") + static("4", "unknown")
    gt = read(tmp_path, body, start=0.1).gt
    assert gt.ids.tolist() == ["1", "2", "4"]
    assert gt.kind.tolist() == ["car", "car", "unknown"]
    assert gt.valid.all()
    np.testing.assert_array_equal(gt.v[1:], 0.0)
    np.testing.assert_array_equal(gt.x[1:], 8.0)


BAD = {
    "version": ("", "2017a", "", r"commonRoadVersion is '2017a', expected one of 2018a, 2018b, 2020a"),
    "nobody": ("", "2020a", "", "has no dynamic obstacle"),
    "ego": (dynamic("2", EGO), "2020a", "", "ego '1' was not found; the file has 2"),
    "doctype": (dynamic("1", EGO), "2020a", '<!DOCTYPE a [<!ENTITY e "x">]>', "has a DOCTYPE"),
    "twice": (dynamic("1", EGO) * 2, "2020a", "", "obstacle id '1' is a duplicate"),
    "speed": (dynamic("1", state(0, 0) + state(1, 1, v="")), "2020a", "", "1, state 1: velocity is missing"),
    "number": (dynamic("1", EGO.replace("<x>2<", "<x>two<")), "2020a", "", "state 2: position x is 'two'"),
    "time": (dynamic("1", state(1, 0) + state(1, 1)), "2020a", "", "1, state 1: time 0.1 s does not follow 0.1 s"),
    "shape": (dynamic("1", EGO, shape="<polygon/>"), "2020a", "", "obstacle 1: shape is polygon, expected one"),
    "size": (dynamic("1", EGO, shape=RECTANGLE.replace("4", "0")), "2020a", "", "size is 0 x 2 m"),
    "turned": (
        dynamic("1", EGO, shape=RECTANGLE.replace("<length>", "<orientation>1</orientation><length>")),
        "2020a", "", "obstacle 1: its shape is offset or rotated",
    ),
    "empty": ('<dynamicObstacle id="1"/>', "2020a", "", "obstacle 1 has no trajectory"),
    "broken": ("<a>", "2020a", "", "is not well-formed XML"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (dynamic("1", EGO, shape=RECTANGLE.replace("<length>", "<x>abc</x><length>")), "obstacle 1: shape x is 'abc'"),
        (dynamic("1", EGO, shape="<circle><radius>1</radius><center><x>q</x></center></circle>"), "shape x is 'q'"),
        (dynamic("1", state(0, 1e300) + state(1, 1)), "state 0: position x is '1e+300'"),
        (dynamic("1", EGO.replace("0.1<", "1e20<")), "state 0: orientation is '1e20', expected a finite number up to"),
        (dynamic("1", EGO.replace(exact("velocity", 10), exact("velocity", 1e200))), "state 0: velocity is '1e+200'"),
    ],
)  # fmt: skip
def test_numbers_that_no_measurement_has_are_named(tmp_path: Path, body: str, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        read(tmp_path, body)


@pytest.mark.parametrize("name", ["", "a&#10;b"])
def test_an_id_that_is_no_name_is_not_written(tmp_path: Path, name: str) -> None:
    found = read(tmp_path, dynamic("1", EGO) + dynamic(name, EGO))
    with pytest.raises(InputError, match="expected a name of one line"):
        write_recording(found, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    far=st.sampled_from([0.0, 1e6, -5.4e6]), begin=st.sampled_from([0, 17 * 10**9]), heading=st.floats(-3.1, 3.1),
    v=st.floats(-5.0, 40.0), version=st.sampled_from(["2018a", "2020a"]),
)  # fmt: skip
def test_no_digit_is_lost(
    tmp_path: Path, far: float, begin: int, heading: float, v: float, version: str
) -> None:
    """At UTM's coordinates and times of today states are equal to 1e-6 m; times to what a number of 64 bits holds."""
    unit = 0.1 if version == "2018a" else 1
    every = [state(round((begin + k) * unit, 1), far + k, v=exact("velocity", v)) for k in range(4)]
    states = "".join(every).replace(exact("orientation", 0.1), exact("orientation", heading))
    gt = read(tmp_path, dynamic("1", states, version=version), version=version).gt
    np.testing.assert_allclose(gt.t, [0.0, 0.1, 0.2, 0.3], rtol=0, atol=1e-9 + 3e-16 * begin)
    np.testing.assert_allclose(gt.x[0], far + np.arange(4.0), rtol=0, atol=1e-6)
    np.testing.assert_allclose([gt.heading[0], gt.v[0]], [[heading] * 4, [v] * 4], rtol=0, atol=1e-9)


@pytest.mark.parametrize("case", BAD)
def test_refuses(tmp_path: Path, case: str) -> None:
    body, version, head, message = BAD[case]
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        read(tmp_path, body, version=version, head=head)
    assert str(caught.value).startswith(str(tmp_path / "s.xml"))


def test_refuses_no_file_and_no_commonroad(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_commonroad(tmp_path / "no.xml", map=tmp_path, ego="1")
    (tmp_path / "road.xml").write_text("<OpenDRIVE/>")
    with pytest.raises(InputError, match="the root element is <OpenDRIVE>"):
        read_commonroad(tmp_path / "road.xml", map=tmp_path, ego="1")


REAL = {  # vehicles, samples
    "USA_US101-5_1_T-1": (25, 101),
    "USA_US101-22_1_T-1": (54, 167),
    "USA_US101-10_1_T-1": (44, 81),
    "USA_US101-12_1_T-1": (35, 81),
    "USA_Lanker-1_17_T-1": (36, 41),
}


@pytest.mark.parametrize("name", REAL)
def test_real_drives(data: Path, name: str) -> None:
    """Position, heading and speed of each vehicle agree with each other: the frame and units are right."""
    vehicles, samples = REAL[name]
    xml = data / "ngsim" / f"{name}.xml"
    ego = re.findall(r'bstacle id="(\d+)"', xml.read_text())[-1]
    recording = read_commonroad(xml, map=xml.with_suffix(".xodr"), ego=ego)
    gt = recording.gt
    assert (len(gt), len(gt.t), recording.gt_rate) == (vehicles, samples, 10.0)
    assert gt.t[0] == 0.0
    along = velocity_along_heading(gt)
    fast = gt.v[:, 1:-1] > 3.0
    assert np.nanmedian(np.abs(along - gt.v[:, 1:-1])[fast]) < 0.5


def velocity_along_heading(t: Tracks) -> np.ndarray:
    step = t.t[2:] - t.t[:-2]
    vx, vy = (t.x[:, 2:] - t.x[:, :-2]) / step, (t.y[:, 2:] - t.y[:, :-2]) / step
    return np.asarray(vx * np.cos(t.heading[:, 1:-1]) + vy * np.sin(t.heading[:, 1:-1]))
