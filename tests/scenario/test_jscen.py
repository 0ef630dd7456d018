from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import resim.scenario
from resim.core.errors import InputError
from resim.scenario.jscen import read_jscen, schema, write_jscen
from resim.scenario.scenario import RoadPosition, Scenario, ScenarioObject

APPENDIX = Path(__file__).with_name("appendix_a1.jscen.json")
PUBLISHED = Path(resim.scenario.__file__).with_name("jscen.schema.json")
Change = Callable[[dict[str, Any]], object]


def member(name: str, start: float = 0.0, kind: str = "car", lane: int = -1) -> ScenarioObject:
    knots = np.array([start, start + 1.1, start + 2.7])
    v = CubicSpline(knots, [10.0, 1.0 / 3.0, 7.3], bc_type="natural")
    heading = CubicSpline(knots[[0, 2]], [0.1, -0.2], bc_type="natural")
    return ScenarioObject(name, kind, 4.7, 1.9, RoadPosition("1", lane, 12.3, 0.1), v, heading)


def scenario(*objects: ScenarioObject, ego: ScenarioObject | None = None, **change: Any) -> Scenario:
    fields = {
        "map": "road.xodr",
        "duration": 2.7,
        "description": "Überholen",
        "environment": {"fogDensity": "None"},
    }
    return Scenario(ego=ego or member("ego"), objects=objects, **(fields | change))


@pytest.fixture
def changed(tmp_path: Path) -> Callable[[Change], Path]:
    """Write the appendix example with one change."""

    def write(change: Change) -> Path:
        data = json.loads(APPENDIX.read_text())
        change(data)
        path = tmp_path / "changed.jscen.json"
        path.write_text(json.dumps(data))
        return path

    return write


def test_the_appendix_example_loads() -> None:
    s = read_jscen(APPENDIX)
    assert (s.map, s.duration) == ("proving_ground.xodr", 9.199949741363525)
    assert s.environment["dateTime"] == "2019-03-12T17:30:27.077079-07:00"
    (to,) = s.objects
    assert (to.id, to.kind, to.spawn_time) == ("1", "unknown", 0.00497889518737793)
    assert to.start == RoadPosition("8005", -1, 2378.7244738907502, -0.37117342098455985)
    assert s.ego.start == RoadPosition("8005", -2, 2389.9265704435356, -0.2974222258353594)
    # highest power first, in the time since the segment's start: the second begins where the first ends
    assert float(to.v(to.spawn_time)) == 32.549377788836615
    width = 0.8018612868509138 - 0.00497889518737793
    first = ((-0.7943151516043908 * width + 0.0) * width + 1.685027119965802) * width + 32.549377788836615
    assert first == pytest.approx(33.49019298585831, abs=1e-12)
    assert float(to.v(0.8018612868509138)) == 33.49019298585831
    assert float(to.heading(to.spawn_time)) == 0.18418863294385404


def test_what_is_written_comes_back_bit_by_bit(tmp_path: Path) -> None:
    one = scenario(member("1", 0.5), member("b-7", kind="truck"))
    write_jscen(one, tmp_path / "a.jscen.json")
    two = read_jscen(tmp_path / "a.jscen.json")
    assert (two.map, two.duration, two.description, two.environment) == (
        one.map, one.duration, one.description, one.environment,
    )  # fmt: skip
    for a, b in zip((one.ego, *one.objects), (two.ego, *two.objects), strict=True):
        assert (a.id, a.kind, a.length, a.width, a.start, a.color) == (
            b.id, b.kind, b.length, b.width, b.start, b.color,
        )  # fmt: skip
        for p, q in ((a.v, b.v), (a.heading, b.heading)):
            np.testing.assert_array_equal(p.c, q.c)
            np.testing.assert_array_equal(p.x, q.x)
    write_jscen(two, tmp_path / "b.jscen.json")
    assert (tmp_path / "a.jscen.json").read_bytes() == (tmp_path / "b.jscen.json").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.jscen.json", "b.jscen.json"]


def test_a_file_of_the_published_version_can_be_written_anew(tmp_path: Path) -> None:
    write_jscen(read_jscen(APPENDIX), tmp_path / "new.json")
    data = json.loads((tmp_path / "new.json").read_text())
    assert data["fileVersion"] == {"major": 0, "minor": 10}
    assert data["objectPool"]["vehicles"][0]["objectId"] == 1
    np.testing.assert_array_equal(read_jscen(tmp_path / "new.json").ego.v.c, read_jscen(APPENDIX).ego.v.c)


def test_ids_that_look_alike_stay_apart(tmp_path: Path) -> None:
    names = ["7", "007", "-7", "7.0", "٧", "sd:3"]
    write_jscen(scenario(*map(member, names)), tmp_path / "a.json")
    assert [o.id for o in read_jscen(tmp_path / "a.json").objects] == names


def test_the_published_schema_is_that_of_the_code() -> None:
    text = PUBLISHED.read_text(encoding="utf-8")
    assert text == json.dumps(schema(), indent=2) + "\n", "write it anew from resim.scenario.jscen.schema()"


def test_the_schema_takes_what_is_written_and_the_appendix(tmp_path: Path) -> None:
    published = json.loads(PUBLISHED.read_text())
    check = jsonschema.Draft202012Validator(published)
    check.check_schema(published)
    write_jscen(scenario(member("1", 0.5)), tmp_path / "a.json")
    written = json.loads((tmp_path / "a.json").read_text())
    assert not list(check.iter_errors(written))
    assert not list(check.iter_errors(json.loads(APPENDIX.read_text())))
    del written["objectPool"]["ego"]["maneuver"]["heading"]
    assert [e.message for e in check.iter_errors(written)] == ["'heading' is a required property"]


def vehicle(data: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = data["objectPool"]["vehicles"][0]
    return found


FAULTS: list[tuple[Change, str]] = [
    (lambda d: d.update(weather=1), "weather: there is no such field"),
    (lambda d: vehicle(d)["model"].update(colour="red"), "objectPool.vehicles.0.model.colour: there is no such field"),
    (lambda d: d["fileVersion"].update(major=1, minor=0), "fileVersion.major: expected 0, found 1; fileVersion.minor"),
    (lambda d: d["fileVersion"].update(minor=12), "fileVersion.minor: expected 9, 10 or 11"),
    (lambda d: d.pop("fileVersion"), "fileVersion: is missing"),
    (lambda d: vehicle(d)["maneuver"].pop("heading"), "objectPool.vehicles.0.maneuver.heading: is missing"),
    (lambda d: d["objectPool"].pop("ego"), "objectPool.ego: is missing"),
    (
        lambda d: vehicle(d)["maneuver"]["velocity"][1].update(startTime=0.5),
        "objectPool.vehicles.0.maneuver.velocity: segment 1 starts at 0.5 s, but segment 0 ends at 0.801861 s",
    ),
    (
        lambda d: vehicle(d)["maneuver"]["velocity"][1].update(startTime=0.9),
        "segment 1 starts at 0.9 s, but segment 0 ends at 0.801861 s",
    ),
    (
        lambda d: vehicle(d)["maneuver"]["velocity"][0].update(endTime=-1.0),
        "objectPool.vehicles.0.maneuver.velocity.0: endTime -1 is not after startTime 0.0049",
    ),
    (
        lambda d: d["objectPool"]["ego"]["maneuver"]["velocity"].pop(),
        "objectPool.ego.maneuver: velocity and heading must end together: 7.5 s and 9.19995 s",
    ),
    (
        lambda d: vehicle(d)["maneuver"]["velocity"][0].update(polynomParameter=[1.0, 2.0, 3.0]),
        "objectPool.vehicles.0.maneuver.velocity.0.polynomParameter: expected at least 4 items",
    ),
    (lambda d: vehicle(d)["maneuver"].update(velocity=[]), "maneuver.velocity: expected at least 1 item"),
    (lambda d: vehicle(d).update(spawningTime=1.0), "spawningTime 1 s is not the start of its trace, 0.0049"),
    (lambda d: vehicle(d).update(objectId="ego"), "objectPool: objectId ego stands more than once"),
    (lambda d: vehicle(d)["model"].update(type="Tank"), "model.type: type 'Tank' is none of Car, Van"),
    (lambda d: vehicle(d)["model"].update(length=0), "model.length: expected more than 0"),
    (lambda d: d.update(duration=float("nan")), "duration: expected"),
    (lambda d: d.update(duration=-1.0), "duration: expected more than 0"),
    (lambda d: d.update(map="../x.xodr"), "map: map '../x.xodr' must be a file in the folder of the JSCEN file"),
    (lambda d: d.update(map="sub/../../x.xodr"), "map: map 'sub/../../x.xodr' must be"),
    (lambda d: d.update(map="/etc/x.xodr"), "map: map '/etc/x.xodr' must be"),
    (lambda d: d.update(map="..\\x.xodr"), "must be a file in the folder"),
    (lambda d: d.update(map="C:\\x.xodr"), "must be a file in the folder"),
    (lambda d: d.update(map=""), "must be a file in the folder"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "text"), FAULTS, ids=[text[:60] for _, text in FAULTS])
def test_a_fault_is_named_with_its_place(
    changed: Callable[[Change], Path], change: Change, text: str
) -> None:
    path = changed(change)
    with pytest.raises(InputError) as caught:
        read_jscen(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_all_faults_are_named_at_once(changed: Callable[[Change], Path]) -> None:
    def spoil(data: dict[str, Any]) -> None:
        data.update(map="/x", duration=0)
        vehicle(data).pop("objectId")

    with pytest.raises(InputError, match=r"vehicles\.0\.objectId.*map '/x'|map '/x'.*vehicles\.0\.objectId"):
        read_jscen(changed(spoil))


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (APPENDIX.read_bytes()[:900], "is not JSON: "),
        (b"", "is not JSON: Expecting value at line 1, column 1"),
        (b"<OpenDRIVE/>", "is not JSON"),
        (b"\xff\xfe\x00", "is not UTF-8 text"),
        (b"[1, 2]", "the whole: expected"),
        (b"[" * 100_000, "is JSON that cannot be read"),
        (b'{"duration": ' + b"9" * 5000 + b"}", "is JSON that cannot be read"),
    ],
    ids=["truncated", "empty", "xml", "binary", "list", "deep", "long number"],
)
def test_what_is_no_jscen_is_refused(tmp_path: Path, content: bytes, text: str) -> None:
    path = tmp_path / "x.jscen.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=text):
        read_jscen(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_jscen(tmp_path / "none.json")


def test_a_scenario_that_the_format_cannot_hold_is_not_written(tmp_path: Path) -> None:
    for bad in (scenario(map="../road.xodr"), scenario(duration=-3.0), scenario(member("ego"))):
        with pytest.raises(InputError, match="this scenario cannot be written"):
            write_jscen(bad, tmp_path / "a.json")
    assert not list(tmp_path.iterdir())
