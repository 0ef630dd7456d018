"""Random input: it gives a result or a clear error, and nothing else."""

from __future__ import annotations

import copy
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from damaged import DIGITS, DRIVE, GROUND, JSCEN, ROOT, convert, places, result_or_clear_error, written
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from resim.recordings import read_tables
from resim.recordings.checks import examine
from resim.recordings.source import recording_of
from resim.road.opendrive import load
from resim.scenario.jscen import read_jscen

NUMBERS = st.one_of(
    st.sampled_from(["nan", "inf", "-1", "0", "", "x", "1e308", "1e12", "-1e12", "1e-300", "1e6", "\u0663", DIGITS]),
    st.floats(-1e3, 1e3).map(repr), st.integers(-(2**70), 2**70).map(str),
)  # fmt: skip
KINDS = st.sampled_from(["line", "arc", "spiral", "poly3", "paramPoly3", "road", "lane"])


@st.composite
def maps(draw: st.DrawFn) -> str:
    """A map whose structure is right, with a few attributes that are not."""
    names = draw(
        st.lists(
            st.sampled_from(["1", "2", "a b", "\u00e4'<".replace("<", "&lt;"), "-1", ""]),
            min_size=1,
            max_size=3,
        )
    )

    def number(usual: str) -> str:
        return usual if draw(st.integers(0, 99)) else draw(NUMBERS).replace("'", "")

    def cubic(suffix: str = "") -> str:
        return " ".join(
            f'{c}{suffix}="{number(usual)}"' for c, usual in zip("abcd", ("3", "0.01", "0", "0"), strict=True)
        )

    def geometry(s: int) -> str:
        curve = {
            "arc": f'<arc curvature="{number("0.01")}"/>',
            "spiral": f'<spiral curvStart="{number("0")}" curvEnd="{number("0.02")}"/>',
            "poly3": f"<poly3 {cubic()}/>", "paramPoly3": f"<paramPoly3 {cubic('U')} {cubic('V')}/>",
        }.get(draw(KINDS), "<line/>")  # fmt: skip
        place = f'x="{number(str(s))}" y="{number("0")}" hdg="{number("0")}"'
        return f'<geometry s="{number(str(s))}" {place} length="{number("50")}">{curve}</geometry>'

    def lane(lane_id: int) -> str:
        link = f'<link><successor id="{number(str(lane_id))}"/></link>'
        width = f'<width sOffset="{number("0")}" {cubic()}/>'
        kind = draw(st.sampled_from(["driving", "driving", "shoulder", "none", "sidewalk", ""]))
        return f'<lane id="{number(str(lane_id))}" type="{kind}">{link}{width}</lane>'

    def one(name: str) -> str:
        side, other = draw(st.sampled_from(["predecessor", "successor"])), draw(st.sampled_from(names))
        kind = draw(st.sampled_from(["road", "road", "junction"]))
        section = (
            f'<laneSection s="{{}}"><left>{lane(1)}</left><right>{lane(-1)}{lane(-2)}</right></laneSection>'
        )
        sections = "".join(section.format(number(s)) for s in ("0", "50")[: draw(st.integers(1, 2))])
        return (
            f'<road id="{name}" length="100" junction="{draw(st.sampled_from(["-1", "-1", "1"]))}"><link>'
            f'<{side} elementType="{kind}" elementId="{other}" contactPoint="start"/></link>'
            f"<planView>{geometry(0)}{geometry(50)}</planView><elevationProfile><elevation s='0' {cubic()}/>"
            f"</elevationProfile><lanes><laneOffset s='{number('0')}' {cubic()}/>{sections}</lanes></road>"
        )

    connection = (
        f'<connection id="0" incomingRoad="{names[0]}" connectingRoad="{names[-1]}" contactPoint="end">'
    )
    ends = f'<junction id="1" name="">{connection}<laneLink from="-1" to="{number("-1")}"/></connection></junction>'
    return f"<OpenDRIVE>{''.join(map(one, dict.fromkeys(names)))}{ends}</OpenDRIVE>"


QUICK = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))


@settings(QUICK, max_examples=25)
@given(maps())
def test_random_maps_give_a_net_or_a_clear_error(text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.xodr"
        path.write_text(text)
        with result_or_clear_error(path):
            convert(path)
        assert {p.name for p in Path(folder).iterdir()} <= {"map.xodr", "nets"}
        assert all((net / "net.xml").is_file() for net in (Path(folder) / "nets").glob("*"))


CELLS = st.one_of(
    NUMBERS.filter(lambda text: len(text) < 100),
    st.sampled_from(["a", "b", "car", "truck", '"', " ", "\u00e9"]),
)


@st.composite
def tables(draw: st.DrawFn) -> list[list[str]]:
    """Rows of two objects, a few cells of which are anything, in an order of their own."""
    rows = [list(row) for row in DRIVE[:8]] + [[row[0], "b", *row[2:]] for row in DRIVE[:8]]
    for _ in range(draw(st.integers(0, 3))):
        rows[draw(st.integers(0, 15))][draw(st.integers(0, 8))] = draw(CELLS)
    column, factor = (
        draw(st.sampled_from([0, 2, 3, 4, 5, 6, 7])),
        draw(st.sampled_from([1.0, 1.0, 1e-3, 1e6, -1.0, 0.0])),
    )
    for row in rows:
        try:
            row[column] = repr(float(row[column]) * factor)
        except ValueError:
            continue
    return draw(st.permutations(rows)) if draw(st.booleans()) else rows


@QUICK
@given(tables())
def test_random_recordings_are_read_and_examined_or_refused(rows: list[list[str]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = written(Path(folder), rows)
        with result_or_clear_error(path / "gt.csv"):
            found = read_tables(path)
            examine(found, load(GROUND))
            recording_of(found, lenient=True)
            recording_of(found).sd_by_gt()


VALUES = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**70), 2**70), st.floats(), st.text(max_size=5), st.just([]), st.just({}),
    st.just([[[]]] * 3), st.sampled_from([1e12, -1e12, 1e-300, 86_400.0]),
)  # fmt: skip


@settings(QUICK, max_examples=150)
@given(st.data())
def test_random_jscen_are_read_or_refused(data: st.DataObject) -> None:
    case = json.loads(json.dumps(JSCEN))
    for _ in range(data.draw(st.integers(1, 2))):
        parent, key = data.draw(st.sampled_from(places(case)))
        parent[key] = copy.deepcopy(data.draw(VALUES))  # not to be changed by the next
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.jscen.json"
        path.write_text(json.dumps(case))
        with result_or_clear_error(path):
            scenario = read_jscen(path)
            assert np.isfinite(scenario.ego.v(scenario.ego.v.x)).all()


@pytest.mark.slow
def test_the_fuzzer_finds_no_failure_in_its_first_inputs() -> None:
    command = [sys.executable, str(ROOT / "tools" / "fuzz.py"), "60", "--seed", "11"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in done.stdout.splitlines()[2:]]
    assert [(row[0], row[1], row[4]) for row in rows] == [
        ("map", "24", "0"), ("recording", "18", "0"), ("jscen", "12", "0"), ("build", "6", "0"),
    ]  # fmt: skip


@pytest.mark.slow
def test_the_fuzzer_finds_no_failure_in_formats_of_others() -> None:
    command = [sys.executable, str(ROOT / "tools" / "fuzz.py"), "110", "--seed", "11", "--kind", "imports"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in done.stdout.splitlines()[2:]]
    assert {row[1] for row in rows} == {"10"}
    assert {"osi", "highd", "commonroad", "openscenario", "scenes", "bag"} <= {row[0] for row in rows}
    assert sum(int(row[2]) for row in rows) > 10  # else nothing is looked at but heads of files
