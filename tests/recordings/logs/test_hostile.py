"""Damaged and hostile logs are refused with file, place and remedy, or read; nothing else happens to the user."""

from __future__ import annotations

import importlib.util
import json
import os
import random
import re
import resource
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from recordings.logs import written as w
from recordings.mapped.strangers import MAP, drive

from resim.core.errors import InputError
from resim.recordings.logs import apart, decoders
from resim.recordings.logs.cdr import CdrReader, MessageField
from resim.recordings.logs.definitions import definitions, parse
from resim.recordings.logs.raw import LogChannel
from resim.recordings.mapped.guess import guess
from resim.recordings.mapped.reader import read_mapped

ROS = w.Ros()
BYTES = [
    b"\xff" * 8,
    b"\0" * 8,
    b"\xff\xff\xff\x7f",
    b"\0\0\0\0\0\0\xf8\x7f",
    b"\0\0\0\0\0\0\xf0\x7f",
    b"\0\0\0\x80",
]
MOST_MEMORY = 300
"""MB that reading a small file may take beside what there was."""


def read(path: Path, mapping: str) -> None:
    columns = path.parent / "mapping.toml"
    columns.write_text(mapping, encoding="utf-8")
    read_mapped(path, map=MAP, columns=columns)


def told(path: Path, mapping: str) -> str:
    """The error, which has to be clear and to come without much memory."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError) as e:
        read(path, mapping)
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e3 < MOST_MEMORY
    assert str(path) in str(e.value)
    return str(e.value)


def is_readable(path: Path, mapping: str) -> bool:
    """Whether a log can be read; where not, a clear error says so."""
    try:
        read(path, mapping)
    except InputError as e:
        if str(path) not in str(e) or len(str(e)) > 1600:
            pytest.fail(f"unclear: {e}")
        return False
    return True


def damaged(data: bytes, draw: random.Random) -> bytes:
    """The bytes cut off, flipped, overwritten or shortened."""
    out, place = bytearray(data), draw.randrange(len(data))
    how = draw.randrange(4)
    if how == 0:
        del out[place:]
    elif how == 1:
        for _ in range(draw.randrange(1, 5)):
            out[draw.randrange(len(out))] ^= 1 << draw.randrange(8)
    elif how == 2:
        new = draw.choice(BYTES)
        out[place : place + len(new)] = new
    else:
        del out[place : place + draw.randrange(1, 200)]
    return bytes(out)


def logs(folder: Path) -> dict[str, tuple[Path, str]]:
    from mcap.writer import CompressionType

    truth = drive(steps=4)
    found = {}
    for name in ("NONE", "ZSTD", "LZ4"):
        options = {"compression": CompressionType[name], "enable_crcs": name == "ZSTD"}
        path = w.to_mcap(ROS, w.sent(ROS, truth), folder / f"{name}.mcap", **options)
        found[name] = (path, w.autoware_mapping())
    for encoding in ("json", "protobuf"):
        options = {"compression": CompressionType.NONE, "enable_crcs": False}
        found[encoding] = (
            w.to_scene_mcap(truth, folder / f"{encoding}.mcap", encoding, **options),
            w.SCENE_MAPPING,
        )
    bag = w.to_bag(ROS, w.sent(ROS, truth), folder / "bag")
    found["db3"] = (next(bag.glob("*.db3")), w.autoware_mapping())
    return found


@pytest.mark.slow
def test_damaged_logs(tmp_path: Path) -> None:
    draw = random.Random(5)
    every = logs(tmp_path)
    ended = {True: 0, False: 0}
    for _ in range(400):
        source, mapping = every[draw.choice(sorted(every))]
        path = tmp_path / f"damaged{source.suffix}"
        path.write_bytes(damaged(source.read_bytes(), draw))
        ended[is_readable(path, mapping)] += 1
    assert min(ended.values()) > 40  # else it is no test of both


def test_a_damaged_byte_under_a_checksum_is_never_read(tmp_path: Path) -> None:
    path = w.to_mcap(ROS, w.sent(ROS, drive(steps=4)), tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    chunk = data.index(b"zstd", 60) + 40
    data[chunk + 60] ^= 4
    path.write_bytes(data)
    assert "is damaged" in told(path, w.autoware_mapping())


def test_a_log_that_was_not_written_to_its_end(tmp_path: Path) -> None:
    bag = next(w.to_bag(ROS, w.sent(ROS, drive(steps=40)), tmp_path / "other").glob("*.db3"))
    for path, message in (
        (logs(tmp_path)["ZSTD"][0], "was not written to its end. Write"),
        (bag, "is damaged or incomplete"),
    ):
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 5])
        assert message in told(path, w.autoware_mapping())


def record(code: int, body: bytes) -> bytes:
    return struct.pack("<BQ", code, len(body)) + body


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def chunk(
    records: bytes, *, size: int | None = None, compression: str = "", length: int | None = None
) -> bytes:
    head = struct.pack("<QQQI", 0, 0, len(records) if size is None else size, 0)
    return record(
        6, head + text(compression) + struct.pack("<Q", len(records) if length is None else length) + records
    )


def mcap_of(folder: Path, *records: bytes) -> Path:
    path = folder / "made.mcap"
    path.write_bytes(
        b"\x89MCAP0\r\n" + record(1, text("") + text("")) + b"".join(records) + record(15, b"\0" * 4)
    )
    return path


def channel(encoding: str = "json", schema: int = 0, topic: str = "scene") -> bytes:
    return record(4, struct.pack("<HH", 1, schema) + text(topic) + text(encoding) + struct.pack("<I", 0))


def schema(encoding: str, definition: bytes, name: str = "a/msg/A") -> bytes:
    return record(
        3,
        struct.pack("<H", 1) + text(name) + text(encoding) + struct.pack("<I", len(definition)) + definition,
    )


def message(body: bytes, time: int = 0) -> bytes:
    return record(5, struct.pack("<HIQQ", 1, 7, time, time) + body)


def packed(data: bytes, how: str) -> bytes:
    import lz4.frame
    import zstandard

    return zstandard.ZstdCompressor().compress(data) if how == "zstd" else bytes(lz4.frame.compress(data))


def ros(
    definition: str, body: bytes = b"", encapsulation: bytes = b"\0\1\0\0", written: str = "ros2msg"
) -> tuple[bytes, ...]:
    """Records of one message of the type a/msg/A, which has this definition."""
    return schema(written, definition.encode()), channel("cdr", 1), message(encapsulation + body)


def sent(body: bytes, encoding: str = "json") -> tuple[bytes, ...]:
    """Records of one message without a schema."""
    return channel(encoding), message(body)


NESTED = "B[] boxes\n" + "=" * 80 + "\nMSG: a/B\nuint8 x"
HOSTILE: dict[str, tuple[Callable[[], tuple[bytes, ...]], str]] = {
    "a record of 4 EiB": (lambda: (struct.pack("<BQ", 5, 1 << 62),), "damaged, at byte 25"),
    "a chunk that claims 2 GB": (lambda: (chunk(b"", size=2 << 30),), "claims 2147483648 bytes, expected up to"),
    "a chunk that holds more": (
        lambda: (chunk(packed(bytes(300 << 20), "zstd"), size=1000, compression="zstd"),), "size or checksum"),
    "the same by lz4": (
        lambda: (chunk(packed(bytes(100 << 20), "lz4"), size=1000, compression="lz4"),), "size or checksum"),
    "a bomb": (
        lambda: (chunk(packed(record(99, bytes(1 << 27)), "zstd"), size=(1 << 27) + 9, compression="zstd"),) * 3,
        "the chunk at byte .* claims 134217737 bytes: what compression made so small is no measurement"),
    "an unknown compression": (lambda: (chunk(b"", compression="brotli"),), "is compressed by 'brotli'"),
    "records that are less": (
        lambda: (chunk(b"1234", length=1 << 40),), "claims 1099511627776 bytes of records, 4 are there"),
    "a channel without schema": (lambda: (channel(schema=9),), "has schema 9, which no record before it describes"),
    "a message without channel": (lambda: (message(b"{}"),), "is of channel 1, which no record before it describes"),
    "a time beyond": (lambda: (channel(), message(b"{}", 1 << 63)), "that is no time"),
    "ros1": (lambda: sent(b"", "ros1"), "encoded as 'ros1'.*rosbags-convert"),
    "an unknown encoding": (lambda: sent(b"", "flatbuffer"), "'flatbuffer'. Supported: cdr, protobuf, json"),
    "no JSON": (lambda: sent(b"{"), "message 7 of scene at 0 ns: Expecting"),
    "JSON without fields": (lambda: sent(b"[1]"), "it has no list 'boxes': it has a list"),
    "deep JSON": (lambda: sent(b"[" * 200_000), "nested too deeply"),
    "deep structures": (
        lambda: sent(b'{"boxes":[' + b'{"a":' * 60 + b"1" + b"}" * 60 + b"]}"), "nested deeper than 30"),
    "elements of one kind": (lambda: sent(b'{"boxes":[1,2]}'), "an element of boxes is a number"),
    "a list that is a text": (lambda: sent(b'{"boxes":"abc"}'), "boxes is a text, expected a list"),
    "too many elements": (
        lambda: sent(b'{"boxes":[' + b"{}," * 300_000 + b"{}]}"), "has 300001 elements, expected up to"),
    "a protobuf schema of no bytes": (
        lambda: (schema("protobuf", b""), channel("protobuf", 1), message(b"")), "its schema 'a/msg/A' is wrong"),
    "a protobuf schema that lies": (
        lambda: (schema("protobuf", b"\x0a\xff"), channel("protobuf", 1), message(b"")), "its schema .* is wrong"),
    "a definition that is none": (lambda: ros("float64 x y z\n?"), r"'\?' is no field"),
    "a type that contains itself": (lambda: ros("A[] boxes"), "the type a/msg/A contains itself"),
    "a type that nothing defines": (lambda: ros("B[] boxes"), "the type a/msg/B is not defined"),
    "a list of nothing": (lambda: ros("uint8[0] boxes"), "is a list of 0"),
    "a wide text": (lambda: ros("wstring boxes"), "wstring, which is not read"),
    "no encapsulation": (lambda: ros("uint8 boxes", b"\0", b"\0\7\0\0"), "encapsulation is 00 07"),
    "4 billion elements": (lambda: ros(NESTED, b"\xff" * 4), "claims 4294967295 elements in 0 bytes"),
    "a million elements": (
        lambda: ros(NESTED, struct.pack("<I", 1 << 20) + bytes(1 << 20)), "more than 200000 elements"),
    "another type than it says": (lambda: ros("uint8 boxes", bytes(50)), "49 bytes are left"),
    "an IDL that is none": (lambda: ros("module a {", written="ros2idl"), "definition of a/msg/A cannot be read"),
    "an IDL of many levels": (
        lambda: ros("struct A {" + "sequence<" * 99_999, written="ros2idl"), "a list of lists is not read"),
    "an IDL of no end": (lambda: ros("/* " * 999_999, written="ros2idl"), "the type a/msg/A is not defined"),
    "types that nobody knows": (lambda: sent(b"\0\1\0\0", "cdr"), "the type  is not defined"),
}  # fmt: skip
"""Records of an MCAP file, and what is said."""


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_mcap(tmp_path: Path, case: str) -> None:
    made, message_told = HOSTILE[case]
    said = told(mcap_of(tmp_path, *made()), w.SCENE_MAPPING)
    assert re.search(message_told, said), said


def database(folder: Path, *statements: str) -> Path:
    path = folder / "made.db3"
    with sqlite3.connect(path) as db:
        for one in statements:
            db.execute(one)
    db.close()
    return path


TOPICS = "CREATE TABLE topics (id INTEGER, name TEXT, type TEXT, serialization_format TEXT)"
MESSAGES = "CREATE TABLE messages (id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB)"
ENDLESS = """CREATE VIEW messages AS
WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id, 1 AS topic_id FROM n"""
ONE = (TOPICS, "INSERT INTO topics VALUES (1, 'scene', 'a/msg/A', 'cdr')")


@pytest.mark.parametrize(
    ("statements", "message"),
    [
        ((TOPICS,), "is an SQLite file, and no bag: its tables are topics"),
        ((TOPICS, ENDLESS), "is an SQLite file, and no bag"),
        ((*ONE, "CREATE TABLE messages (id INTEGER)"), "is damaged or incomplete .no such column"),
        ((TOPICS, MESSAGES), "has no messages of topic 'scene'.*Its topics are: none"),
        ((*ONE, MESSAGES, "INSERT INTO messages VALUES (1, 1, 'now', 5)"), "has the time 'now'"),
        ((*ONE, MESSAGES, "INSERT INTO messages VALUES (1, 1, 2, x'28b52ffd04ffffffffff')"), "is damaged"),
        (
            (*ONE, MESSAGES, "INSERT INTO messages VALUES (1, 1, 2, zeroblob(20000000))"),
            "more than 16777216 bytes",
        ),
    ],
)
def test_hostile_bags(tmp_path: Path, statements: tuple[str, ...], message: str) -> None:
    said = told(database(tmp_path, *statements), w.SCENE_MAPPING)
    assert re.search(message, said), said


def test_messages_that_are_still_in_the_journal_are_told(tmp_path: Path) -> None:
    path = database(tmp_path, TOPICS, MESSAGES)
    path.with_name("made.db3-wal").write_bytes(b"x")
    assert "holds messages that are not in it yet. Merge them" in told(path, w.SCENE_MAPPING)


def test_what_is_no_log_is_told(tmp_path: Path) -> None:
    for name, data, message in (
        ("a.bag", b"#ROSBAG V2.0\n", "is a bag of ROS 1, which is not read. Convert it: rosbags-convert"),
        ("a.mcap.zst", b"\x28\xb5\x2f\xfd", "compressed. Decompress it first: zstd -d"),
        ("a.h5", b"\x89HDF\r\n\x1a\n", "is an HDF5 file"),
        ("a.npy", b"\x93NUMPY\x01\0", "is a NumPy array, whose columns have no names"),
    ):
        (tmp_path / name).write_bytes(data)
        assert message in told(tmp_path / name, w.SCENE_MAPPING)
    (tmp_path / "folder").mkdir()
    assert "is a folder without the files of a bag (.db3 or .mcap); it has nothing" in told(
        tmp_path / "folder", w.SCENE_MAPPING
    )
    os.mkfifo(tmp_path / "pipe")
    assert "it is not a file" in told(tmp_path / "pipe", w.SCENE_MAPPING)
    with pytest.raises(InputError, match="it is not a file"):
        guess(tmp_path / "pipe", tmp_path / "out.toml")


def test_a_guess_names_the_topics(tmp_path: Path) -> None:
    path, _ = logs(tmp_path)["json"]
    with pytest.raises(
        InputError, match=r"is a log of topics, of which a mapping cannot be guessed.*They are: scene\."
    ):
        guess(path, tmp_path / "out.toml")


def test_values_that_are_none_are_told_with_their_row(tmp_path: Path) -> None:
    def written(**changed: object) -> Path:
        box = {"name": "ego", "place": {"x": 0.0, "y": 0.0}, "yaw": 0.0, "speed": 5.0, "size": [4.0, 2.0]}
        rows = [
            {"stamp": {"seconds": 5, "nanos": k * 10**8}, "boxes": [{**box, **(changed if k == 2 else {})}]}
            for k in range(4)
        ]
        return mcap_of(tmp_path, channel(), *(message(json.dumps(row).encode()) for row in rows))

    assert "row 3: yaw (gt.heading) is 'left', expected a finite number" in told(
        written(yaw="left"), w.SCENE_MAPPING
    )
    assert "row 3: speed (gt.v) is 'True'" in told(written(speed=True), w.SCENE_MAPPING)
    assert "row 3: speed (gt.v) is" in told(written(speed=10**400), w.SCENE_MAPPING)
    assert "row 3: name (gt.id) is ''" in told(written(name=None), w.SCENE_MAPPING)
    assert "surrogates not allowed" in told(written(name="\ud800"), w.SCENE_MAPPING)
    read(written(yaw=float("nan"), size=[]), w.SCENE_MAPPING)  # missing, as in any table


@pytest.mark.slow
def test_a_measurement_that_is_damaged_or_missing_its_library(tmp_path: Path) -> None:
    pytest.importorskip("asammdf")
    rows = drive(steps=4)
    rows = rows[rows["id"] == "ego"]
    columns = {c: rows[c].to_numpy() for c in ("x", "y")} | {"time": rows["t"].to_numpy()}
    path = w.to_mdf({"Ego": columns}, tmp_path / "a.mf4")
    mapping = 'ego = "ego"\n[gt]\ntopic = "Ego"\nid = { value = "ego" }\nt = "time"\nx = "x"\ny = "y"\n'
    read(path, mapping)
    whole = path.read_bytes()
    draw = random.Random(3)
    for _ in range(8):
        path.write_bytes(damaged(whole, draw))
        assert is_readable(path, mapping) in (True, False)
    assert "channels have no list" in told(
        path, mapping.replace('topic = "Ego"', 'topic = "Ego"\nlist = "x"')
    )
    path.write_bytes(b"MDF     3.30    " + bytes(200))
    assert "is damaged or incomplete, or no MDF 4 file" in told(path, mapping)


@pytest.mark.parametrize("count", [5, 2000])
def test_samples_that_a_measurement_counts_and_does_not_hold_are_not_made_up(
    tmp_path: Path, count: int
) -> None:
    pytest.importorskip("asammdf")
    rows = drive(steps=4)
    rows = rows[rows["id"] == "ego"]
    columns = {c: rows[c].to_numpy() for c in ("x", "y")} | {"time": rows["t"].to_numpy()}
    path = w.to_mdf({"Ego": columns}, tmp_path / "a.mf4")
    data = bytearray(path.read_bytes())
    group = data.index(b"##CG")
    (links,) = struct.unpack("<Q", data[group + 16 : group + 24])
    at = group + 24 + 8 * links + 8
    assert struct.unpack("<Q", data[at : at + 8]) == (len(rows),)
    data[at : at + 8] = struct.pack("<Q", count)
    path.write_bytes(data)
    mapping = 'ego = "ego"\n[gt]\ntopic = "Ego"\nid = { value = "ego" }\nt = "time"\nx = "x"\ny = "y"\n'
    assert f"{count} samples are counted and {len(rows)} are there" in told(path, mapping)


def test_what_a_library_leaves_behind_goes_with_its_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("asammdf")
    there = tmp_path / "there"
    there.mkdir()
    monkeypatch.setenv("TMPDIR", str(there))  # of the process: this one has its folder already
    path = tmp_path / "a.mf4"
    path.write_bytes(b"MDF     4.10    " + bytes(400))
    told(path, 'ego = "e"\n[gt]\ntopic = "A"\nid = { value = "e" }\nt = "time"\nx = "x"\ny = "x"\n')
    assert [*there.iterdir()] == []


def test_a_measurement_that_runs_in_circles_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("asammdf")
    monkeypatch.setattr(apart, "SECONDS", 1.5)
    data = bytearray(
        w.to_mdf(
            {"A": {"time": drive()["t"].to_numpy()[:3], "x": drive()["x"].to_numpy()[:3]}}, tmp_path / "a.mf4"
        ).read_bytes()
    )
    group = data.index(b"##CN")
    data[group + 24 : group + 32] = struct.pack("<Q", group)  # the next channel is itself
    (tmp_path / "a.mf4").write_bytes(data)
    said = told(
        tmp_path / "a.mf4",
        'ego = "e"\n[gt]\ntopic = "A"\nid = { value = "e" }\nt = "time"\nx = "x"\ny = "x"\n',
    )
    assert "was not read within" in said or "is damaged or incomplete, or no MDF 4 file" in said


def test_a_long_text_is_read_and_one_that_is_not_wanted_is_passed_over() -> None:
    types = {
        "a": (MessageField("skipped", "string"), MessageField("text", "string"), MessageField("n", "int32"))
    }
    text = "x" * 70_000
    told = struct.pack("<I", len(text) + 1) + text.encode() + b"\0" + bytes(-(len(text) + 1) % 4)
    body = b"\0\1\0\0" + told + told + struct.pack("<i", 7)
    found = CdrReader(types, "a", {"text": None, "n": None}, ()).read(body)
    assert found == {"text": text, "n": 7}


@pytest.mark.parametrize("repeated", [False, True])
def test_lists_of_protobuf_are_known_by_what_its_version_has(repeated: bool) -> None:
    """Versions before 6.31 have no `is_repeated`, those from 7 on no `label`."""
    before = SimpleNamespace(LABEL_REPEATED=3, label=3 if repeated else 1)
    assert decoders._is_repeated(before) is repeated
    assert decoders._is_repeated(SimpleNamespace(is_repeated=repeated)) is repeated


DEFINITION = f"""# a comment
uint8 CAR=1
std_msgs/Header header
string<=5 name "x"
float64[<=3] few
float64[3] three
B[] many 5
{"=" * 80}
MSG: p/B
duration d
"""


def test_definitions_as_ros_writes_them() -> None:
    found = parse(DEFINITION, "p/A")
    assert [(f.name, f.type, f.size) for f in found["p/msg/A"]] == [
        ("header", "std_msgs/msg/Header", None), ("name", "string", None), ("few", "float64", 0),
        ("three", "float64", 3), ("many", "p/msg/B", 0),
    ]  # fmt: skip
    assert found["p/msg/B"][0].type == "builtin_interfaces/msg/Duration"


IDL = f"""{"=" * 80}
IDL: p/msg/A
#include "p/msg/B.idl"
module p {{ module msg {{
  module A_Constants {{ const uint8 CAR = ((1)); }};
  typedef double double__36[36];
  @verbatim (language="comment", text="One (1) object.")
  struct A {{
    @range (min=0.0, max=1.0)
    float share;
    sequence<p::msg::B, 100> many;
    double three[3];
    double__36 covariance;
    string<5> name;
    unsigned long long count;
  }};
}}; }};
{"=" * 80}
IDL: p/msg/B
module p {{ module msg {{ struct B {{ @value (default=False)
 boolean moves; }}; }}; }};
"""


def test_definitions_in_idl(tmp_path: Path) -> None:
    found = definitions(tmp_path, LogChannel("a", "p/msg/A", "cdr", "ros2idl", IDL.encode()), None)
    assert [(f.name, f.type, f.size) for f in found["p/msg/A"]] == [
        ("share", "float32", None), ("many", "p/msg/B", 0), ("three", "float64", 3), ("covariance", "float64", 36),
        ("name", "string", None), ("count", "uint64", None),
    ]  # fmt: skip
    assert [(f.name, f.type) for f in found["p/msg/B"]] == [("moves", "bool")]


@pytest.mark.parametrize(
    ("name", "module", "extra"),
    [("ZSTD", "zstandard", "ros"), ("LZ4", "lz4", "ros"), ("protobuf", "google.protobuf", "ros")],
)
def test_a_missing_library_is_told_with_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, module: str, extra: str
) -> None:
    path, mapping = logs(tmp_path)[name]

    def missing(asked: str) -> None:
        raise ModuleNotFoundError(asked)

    monkeypatch.setattr(importlib.util, "find_spec", missing)
    assert f"need {module}. In resim's own folder: pip install '.[{extra}]'" in told(path, mapping)
