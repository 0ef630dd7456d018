"""Inputs that once gave a traceback, a hang or gigabytes: each is refused in one line that says what to do."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import duckdb
import pytest
from damaged import DIGITS, DRIVE, GROUND, JSCEN, ROOT, convert, is_clear, places, written

from resim.core.errors import InputError, ResimError
from resim.recordings import read_recording, read_tables
from resim.recordings.checks import examine
from resim.recordings.source import recording_of
from resim.resimulation import ResimulationOptions, refuse_flaws, resimulate
from resim.road.flaws import flaws
from resim.road.opendrive import load
from resim.road.sumo import sumo_net
from resim.scenario.jscen import read_jscen
from resim.simulation.function.interface import load_build

REPLAY = ROOT / "adfunc" / "builds" / "replay-1.0.toml"

LINE = '<geometry s="0" x="0" y="0" hdg="0" length="{length}"><line/></geometry>'
LANE = '<lane id="{id}" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
ROAD = """<road id="{id}" length="{length}" junction="{junction}"><link>{link}</link><planView>{line}</planView>
<lanes><laneSection s="{s}"><right>{lanes}</right></laneSection></lanes></road>"""
INTO = '<{} elementType="junction" elementId="j"/>'
Rows = list[list[str]]


def road(name: str = "7", *, length: float = 100.0, lanes: int = 1, s: float = 0.0, line: str = LINE,
         junction: str = "-1", link: str = "") -> str:  # fmt: skip
    return ROAD.format(id=name, length=length, junction=junction, link=link, line=line.format(length=length), s=s,
                       lanes="".join(LANE.format(id=-k - 1) for k in range(lanes)))  # fmt: skip


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (road(line=LINE.replace('x="0"', f'x="{DIGITS}"')), "x='99999.* is not a finite number. Correct"),
        (road(length=9e5, lanes=5), "has 4500 km of lanes; maps of up to 4000 km are read"),
        (
            road(line=LINE.replace("<line/>", '<spiral curvStart="0" curvEnd="1e3"/>')),
            "<spiral> turns by up to 100000 rad, beyond 1000 rad",
        ),
        (
            road(line=LINE.replace("<line/>", '<arc curvature="-1e6"/>')),
            "<arc> turns by up to 1e.08 rad, beyond 1000 rad",
        ),
        (road(s=1e12), "no lane has a length"),
    ],
    ids=["digits", "long", "spiral", "arc", "far-section"],
)
def test_what_is_beyond_all_roads_is_refused(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "map.xodr"
    path.write_text(f"<OpenDRIVE>{text}</OpenDRIVE>")
    with pytest.raises(ResimError, match=says) as caught:
        convert(path)
    assert is_clear(caught.value, path)


@pytest.mark.parametrize(
    "raw", ["<OpenDRIVE/>".encode("cp037"), b"<OpenDRIVE>\0</OpenDRIVE>", b"<a>\x1b[2J</b>"]
)
def test_what_the_xml_parser_says_is_put_into_one_line(tmp_path: Path, raw: bytes) -> None:
    path = tmp_path / "map.xodr"
    path.write_bytes(raw)
    with pytest.raises(InputError, match="is not well-formed XML") as caught:
        load(path)
    assert is_clear(caught.value, path)


def test_a_junction_with_exponentially_many_ways_converts(tmp_path: Path) -> None:
    layers = [["in"], *([f"{k}a", f"{k}b"] for k in range(40)), ["out"]]
    roads = [road("in", link=INTO.format("successor")), road("out", link=INTO.format("predecessor"))]
    both = INTO.format("predecessor") + INTO.format("successor")
    roads += [road(name, length=10.0, junction="j", link=both) for layer in layers[1:-1] for name in layer]
    pairs = [(a, b) for before, after in pairwise(layers) for a in before for b in after]
    links = "".join(
        f'<connection id="{k}" incomingRoad="{a}" connectingRoad="{b}" contactPoint="start">'
        '<laneLink from="-1" to="-1"/></connection>'
        for k, (a, b) in enumerate(pairs)
    )
    path = tmp_path / "map.xodr"
    path.write_text(f'<OpenDRIVE>{"".join(roads)}<junction id="j" name="">{links}</junction></OpenDRIVE>')
    conversion = sumo_net(load(path), cache=tmp_path / "nets").conversion
    assert conversion.connections == 1
    assert sum(lane.worst is not None for lane in conversion.lanes) == 2 + 40


def test_links_that_lead_nowhere_are_refused_unless_accepted(tmp_path: Path) -> None:
    path = tmp_path / "map.xodr"
    nowhere = '<successor elementType="road" elementId="99" contactPoint="start"/>'
    path.write_text(f"<OpenDRIVE>{road(link=nowhere)}</OpenDRIVE>")
    network = load(path)
    with pytest.raises(
        InputError, match=r"map\.xodr: MISSING_ROAD: road 7: its successor is road 99.*--accept MISSING_ROAD"
    ):
        refuse_flaws(network, flaws(network), ())
    refuse_flaws(network, flaws(network), ["MISSING_ROAD"])


def with_column(column: int, values: Callable[[int], float]) -> Rows:
    return [[*row[:column], str(values(k)), *row[column + 1 :]] for k, row in enumerate(DRIVE)]


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        (with_column(0, lambda k: 1.7e18 + k * 1e8), "row 2 .*: t is 1.7e.18, expected a finite number up to 1e.12"),
        (with_column(0, lambda k: k * 1e6), "lasts 1.9e.07 s, .* up to 14400 s are read. Give t in s"),
        (with_column(0, lambda k: k * 1e-9), "samples are 1e-09 s apart, expected 0.0001 to 1000 s. Give t in seconds"),
        (with_column(0, lambda k: k * 1e-300), "samples are 1e-300 s apart"),
        (with_column(2, lambda k: 1e160), "x is 1e.160, expected a finite number up to 1e.12 or nothing"),
        (with_column(4, lambda k: 1e12), "heading is 10*.0, expected radians up to 10000"),
        (
            [*DRIVE, *([f"{k / 1e3}", f"o{k}", *DRIVE[0][2:]] for k in range(20_000))],
            "20001 objects at 20000 different times: too many",
        ),
    ],
    ids=["nanoseconds", "long", "fine", "finer", "far", "spinning", "own-times"],
)  # fmt: skip
def test_numbers_of_another_unit_or_size_are_refused(tmp_path: Path, rows: Rows, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        read_recording(written(tmp_path, rows))
    assert "gt.csv" in str(caught.value)


@pytest.mark.parametrize("kind", ["INTERVAL", "DATE", "DOUBLE", "BLOB", "VARCHAR[]", "BOOLEAN"])
def test_parquet_columns_of_any_type_are_read_as_text_or_refused(tmp_path: Path, kind: str) -> None:
    folder = written(tmp_path, DRIVE)
    source, target = folder / "gt.csv", folder / "gt.parquet"
    columns = f"* REPLACE (IF(t < 0.5, TRY_CAST('1' AS {kind}), NULL) AS id)"
    with duckdb.connect() as db:
        db.execute(f"CREATE TABLE track AS SELECT * FROM read_csv('{source}')")
        db.execute(f"COPY (SELECT {columns} FROM track) TO '{target}' (FORMAT parquet)")
    source.unlink()
    with pytest.raises(InputError, match=r"gt\.parquet: row [16] .*id is '', expected a name") as caught:
        read_recording(folder)
    assert is_clear(caught.value, target)


@pytest.mark.parametrize("column", [0, 2, 4, 5])
def test_samples_closer_than_any_clock_are_examined(tmp_path: Path, column: int) -> None:
    tables = read_tables(written(tmp_path, with_column(column, lambda k: k * 1e-300)))
    examine(tables, load(GROUND))


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        (
            with_column(2, lambda k: 1e11 + k),
            "EGO 'a' is 99999998 km from the roads of .* in the map's frame",
        ),
        ([*DRIVE, ["1000", *DRIVE[-1][1:]]], "EGO 'a' is there for 1000 s, from 0 to 1000 s; up to 600 s"),
        (
            [*DRIVE, *([row[0], "a~2", *row[2:]] for row in DRIVE)],
            "the id 'a~2' reads as a part of object 'a'",
        ),
    ],
    ids=["far", "long", "part"],
)
def test_what_cannot_be_simulated_is_refused_and_the_recording_named(
    tmp_path: Path, rows: Rows, says: str
) -> None:
    folder = written(tmp_path, rows)
    recording = recording_of(read_tables(folder), lenient=True)
    with pytest.raises(ResimError, match=says) as caught:
        resimulate(
            recording, load_build(REPLAY), ResimulationOptions(bases=("GT",)), accept=["GAP", "POSITION_JUMP"]
        )
    assert str(folder) in str(caught.value)


def every(field: str, value: object) -> Callable[[dict[str, Any]], None]:
    def change(case: dict[str, Any]) -> None:
        for parent, key in places(case):
            if key == field:
                parent[key] = value

    return change


def stretch(case: dict[str, Any]) -> None:
    maneuver = case["objectPool"]["ego"]["maneuver"]
    for spline in ("velocity", "heading"):
        maneuver[spline][-1]["endTime"] = 1e9


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            every("polynomParameter", [1e300, 0.0, 0.0, 0.0]),
            "polynomParameter.0: expected 1000000000000 or less",
        ),
        (every("odrLane", -(2**70)), "odrLane: expected -1000000 or more"),
        (every("duration", 1e300), "duration: expected 86400 or less"),
        (stretch, r"the trace lasts 1e\+09 s, expected at most 86400 s"),
    ],
    ids=["coefficient", "lane", "duration", "span"],
)
def test_numbers_that_no_trace_can_have_are_refused(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], says: str
) -> None:
    case = json.loads(json.dumps(JSCEN))
    change(case)
    path = tmp_path / "case.jscen.json"
    path.write_text(json.dumps(case))
    with pytest.raises(InputError, match=says) as caught:
        read_jscen(path)
    assert is_clear(caught.value, path)


READERS: dict[str, Callable[[Path], object]] = {
    "map.xodr": load, "case.jscen.json": read_jscen, "build.toml": load_build,
    "recording.toml": lambda path: read_recording(path.parent),
}  # fmt: skip


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("what", ["folder", "loop", "pipe", "device", "deep", "digits", "empty"])
def test_what_is_no_file_or_no_text_is_refused_at_once(tmp_path: Path, name: str, what: str) -> None:
    path, begin = tmp_path / name, time.monotonic()
    if what == "folder":
        path.mkdir()
    elif what == "pipe":
        os.mkfifo(path)
    elif what in ("loop", "device"):
        path.symlink_to(path.name if what == "loop" else "/dev/zero")
    else:
        path.write_text({"deep": "x = " + "[" * 5000, "digits": f"x = {DIGITS}", "empty": ""}[what])
    with pytest.raises(InputError) as caught:
        READERS[name](path)
    assert is_clear(caught.value, path)
    assert time.monotonic() - begin < 5.0


@pytest.mark.parametrize(
    ("factory", "says"),
    [
        ("builtins:print", None),
        ("_socket:gethostname", None),
        ("json.decoder:JSONDecoder", "has no reset"),
        ("_json:encode", "has no encode"),
    ],
)
def test_a_factory_in_a_built_in_or_compiled_module_is_no_crash(
    tmp_path: Path, factory: str, says: str | None
) -> None:
    path = tmp_path / "build.toml"
    path.write_text(f'name = "x"\nversion = "1"\nfactory = "{factory}"\n')
    if says is None:
        assert len(load_build(path).hash) == 64
    else:
        with pytest.raises(InputError, match=says):
            load_build(path)


def test_what_the_text_of_an_error_quotes_is_harmless() -> None:
    text = str(InputError("a\nb.xodr", f"x='\x1b[2J\u202e{DIGITS}' is no number", "Write one."))
    assert text.isprintable()
    assert text.startswith("a\\nb.xodr: x='\\x1b[2J\\u202e999")
    assert text.endswith("999' is no number. Write one.")
    assert len(text) < 2000
