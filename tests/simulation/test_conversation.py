"""Conversations with a process: recorded, in its place, and held against it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import duckdb
import msgpack
import pytest
from conftest import ROOT
from hypothesis import given
from hypothesis import strategies as st

from resim.core.errors import InputError, ResimError
from resim.function import framed, packed
from resim.jobs.function import check_function
from resim.simulation.function.conversation import Conversation, Speaker, read_conversation
from resim.simulation.function.interface import load_build

FUNCTION = """
import os, sys
from resim.function import Command, serve

class Follow:
    def __init__(self, gain=0.4, dies=0):
        self.gain, self.dies, self.asked = gain, dies, 0

    def reset(self, setup):
        self.wanted = setup.start.v
        sys.stderr.write("ready\\n")

    def step(self, p):
        self.asked += 1
        if self.asked == self.dies:
            os._exit(3)
        return Command(self.gain * (self.wanted - p.ego.v) - 0.1 * len(p.v), 0.0)

    def close(self):
        print("after", self.asked, "lists")

serve(Follow)
"""
BUILD = (
    'name = "follow"\nversion = "1"\n[process]\ncommand = ["{python}", "talk.py"]\n[parameters]\n{parameters}'
)


def write(folder: Path, parameters: str = "") -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "talk.py").write_text(FUNCTION, encoding="utf-8")
    build = folder / "follow.toml"
    build.write_text(BUILD.format(python=sys.executable, parameters=parameters), encoding="utf-8")
    return build


def run(build: Path, out: Path, *more: str, recording: str = "rear_end") -> subprocess.CompletedProcess[str]:
    order = [sys.executable, "-m", "resim", "run", str(ROOT / "scenarios" / recording), "--build", str(build)]
    order += ["--out", str(out), "--basis", "gt", *more]
    return subprocess.run(order, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result folder with a recorded conversation."""
    folder = tmp_path_factory.mktemp("recorded")
    done = run(write(folder / "own"), folder / "out", "--record")
    assert done.returncode == 0, done.stderr
    return folder / "out"


def test_what_was_recorded_drives_the_same_without_the_function(recorded: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone"
    alone.mkdir()
    for name in ("recorded.toml", "rGT.conversation"):
        shutil.copy(recorded / name, alone)
    done = run(alone / "recorded.toml", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    for table in ("tracks", "answers", "plans"):
        assert (tmp_path / "out" / f"{table}.parquet").read_bytes() == (
            recorded / f"{table}.parquet"
        ).read_bytes()
    assert "not pinned" not in " ".join(done.stdout.split())


@pytest.mark.parametrize(
    ("recording", "more", "why"),
    [
        ("cut_in_brake", (), "was recorded for another drive: start[0] is 300.0"),
        ("rear_end", ("--step", "0.02"), "was recorded for another drive: cycle is 0.02, recorded was 0.04"),
        ("rear_end", ("--seed", "3"), "was recorded for another drive: seed is 3, recorded was 0"),
        ("rear_end", ("--vehicle", "single-track"), "recorded was"),
    ],
)
@pytest.mark.slow
def test_another_drive_fails_and_says_where_it_differs(
    recorded: Path, tmp_path: Path, recording: str, more: tuple[str, ...], why: str
) -> None:
    done = run(recorded / "recorded.toml", tmp_path / "out", *more, recording=recording)
    assert done.returncode == 3
    assert why in done.stderr, done.stderr


@pytest.mark.slow
def test_a_death_is_recorded_too(tmp_path: Path) -> None:
    build = write(tmp_path / "own", "dies = 90\n")
    assert run(build, tmp_path / "out", "--record").returncode == 3
    again = run(tmp_path / "out" / "recorded.toml", tmp_path / "again")
    assert again.returncode == 3
    assert "failed when it was recorded: follow-1 at t = 0.56 s ended its process with code 3" in again.stderr
    same = [f"{folder}/answers.parquet" for folder in (tmp_path / "out", tmp_path / "again")]
    assert (
        duckdb.sql(f"select * from '{same[0]}'").fetchall()
        == duckdb.sql(f"select * from '{same[1]}'").fetchall()
    )


def test_a_process_is_held_against_what_was_recorded(recorded: Path, tmp_path: Path) -> None:
    conversation = recorded / "rGT.conversation"
    (check,) = check_function(write(tmp_path / "same"), [conversation]).checks
    assert check.holds, check.found
    other = write(tmp_path / "other")
    script = other.with_name("talk.py")
    script.write_text(script.read_text().replace("- 0.1 *", "- 0.1000001 *"), encoding="utf-8")
    (check,) = check_function(other, [conversation]).checks
    assert not check.holds
    assert check.found.startswith("answer 2, at t = -3.00 s: acceleration is -0.0997")
    with pytest.raises(ResimError, match="is Python of this environment"):
        check_function(ROOT / "adfunc" / "builds" / "idm-1.0.toml", [conversation])


def test_what_a_process_says_is_kept_with_its_run(recorded: Path) -> None:
    assert (recorded / "rGT.words.txt").read_text(encoding="utf-8") == "ready\nafter 197 lists\n"


def test_every_byte_of_a_conversation_is_in_the_hash(recorded: Path, tmp_path: Path) -> None:
    for name in ("recorded.toml", "rGT.conversation"):
        shutil.copy(recorded / name, tmp_path)
    before = load_build(tmp_path / "recorded.toml")
    assert before.parameters == {}
    assert before.label == "follow-1"
    found = read_conversation(tmp_path / "rGT.conversation")
    *others, (asked, answered) = found.exchanges
    changed = replace(found, exchanges=(*others, (asked, answered[:-1] + bytes([answered[-1] ^ 1]))))
    (tmp_path / "rGT.conversation").write_bytes(changed.packed())
    assert load_build(tmp_path / "recorded.toml").hash != before.hash


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ('[recorded]\nconversations = "none"', "there is no .conversation in the folder 'none'"),
        ('cycle_time = 0.1\n[recorded]\nconversations = "."', "cycle_time: .recorded. has its own"),
        ('[recorded]\nconversations = "."\n[parameters]\na = 1', "parameters: .recorded. has its own"),
    ],
)
def test_a_build_file_that_asks_for_more_is_refused(
    recorded: Path, tmp_path: Path, text: str, why: str
) -> None:
    shutil.copy(recorded / "rGT.conversation", tmp_path)
    build = tmp_path / "build.toml"
    build.write_text(f'name = "follow"\nversion = "1"\n{text}\n', encoding="utf-8")
    with pytest.raises(InputError, match=why):
        load_build(build)


def test_recording_python_of_this_environment_is_refused(tmp_path: Path) -> None:
    done = run(ROOT / "adfunc" / "builds" / "idm-1.0.toml", tmp_path / "out", "--record")
    assert done.returncode == 2
    assert "there is no conversation to record" in done.stderr
    assert not (tmp_path / "out").exists()


def beside(folder: Path, good: Conversation, bad: Conversation, first: bool) -> Path:
    """A build of two conversations; first: whether the name of the bad one is."""
    folder.mkdir()
    for name, one in zip("ab", (bad, good) if first else (good, bad), strict=True):
        (folder / f"{name}.conversation").write_bytes(one.packed())
    return folder / "recorded.toml"


def differing(found: Conversation) -> dict[str, Conversation]:
    """What another recording of the same drive may hold."""
    some, (asked, answered) = found.exchanges[:100], found.exchanges[100]
    changed = (asked, answered.replace(b"curvature", b"curvaturf"))
    return {
        "failed on closing": replace(found, failure="ended its process by SIGSEGV"),
        "failed between two answers": replace(found, exchanges=some, failure="was killed"),
        "died": replace(found, exchanges=(*some, (asked, b"")), failure="was killed"),
        "answered otherwise": replace(found, exchanges=(*some, changed, *found.exchanges[101:])),
    }


@pytest.mark.parametrize("named", ["in it", "beside it"])
def test_a_build_is_not_replaced_by_the_results_of_its_run(
    recorded: Path, tmp_path: Path, named: str
) -> None:
    out = tmp_path / "out"
    shutil.copytree(recorded, out)
    build = out / "recorded.toml"
    if named == "beside it":
        text = build.read_text(encoding="utf-8").replace('conversations = "."', 'conversations = "out"')
        build = tmp_path / "beside.toml"
        build.write_text(text, encoding="utf-8")
    before = {file.name: file.read_bytes() for file in out.iterdir()}
    done = run(build, out)
    assert (done.returncode, "lies within --out, and would be lost" in done.stderr) == (2, True), done.stderr
    assert {file.name: file.read_bytes() for file in out.iterdir()} == before


@pytest.mark.slow
@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize(
    "how", ["failed on closing", "failed between two answers", "died", "answered otherwise"]
)
def test_two_recordings_of_a_drive_that_differ_fail_it_whatever_their_names(
    recorded: Path, tmp_path: Path, how: str, first: bool
) -> None:
    good = read_conversation(recorded / "rGT.conversation")
    build = beside(tmp_path / "both", good, differing(good)[how], first)
    shutil.copy(recorded / "recorded.toml", build)
    done = run(build, tmp_path / "out")
    assert done.returncode == 3, done.stderr
    why = "answers differ between recordings (not deterministic): a.conversation and b.conversation"
    assert why in done.stderr, done.stderr


@pytest.mark.slow
def test_a_failure_is_told_of_a_drive_that_goes_on_where_its_recording_failed(
    recorded: Path, tmp_path: Path
) -> None:
    found = differing(read_conversation(recorded / "rGT.conversation"))["failed between two answers"]
    (tmp_path / "a.conversation").write_bytes(found.packed())
    shutil.copy(recorded / "recorded.toml", tmp_path)
    done = run(tmp_path / "recorded.toml", tmp_path / "out")
    assert (done.returncode, "failed when it was recorded: was killed" in done.stderr) == (3, True), (
        done.stderr
    )


@pytest.mark.slow
def test_a_recording_of_a_shorter_drive_beside_costs_nothing(recorded: Path, tmp_path: Path) -> None:
    found = read_conversation(recorded / "rGT.conversation")
    build = beside(tmp_path / "both", found, replace(found, exchanges=found.exchanges[:100]), first=True)
    shutil.copy(recorded / "recorded.toml", build)
    assert run(build, tmp_path / "out").returncode == 0


SPEAKER = Speaker("a", "1", "0" * 64, None, 1.0)
FIRST = b"\x10\x00\x00\x00\x82\xaaparameters\x80\xa1a\x01"


@pytest.mark.slow
def test_answers_of_one_build_do_not_pass_for_those_of_another(recorded: Path, tmp_path: Path) -> None:
    shutil.copy(recorded / "rGT.conversation", tmp_path)
    file = tmp_path / "recorded.toml"
    text = (recorded / "recorded.toml").read_text(encoding="utf-8")
    for of, other in (('name = "follow"', 'name = "safe"'), ('version = "1"', 'version = "2"')):
        file.write_text(text.replace(of, other), encoding="utf-8")
        with pytest.raises(InputError, match="but its conversations are of 'follow', version '1'"):
            load_build(file)
    file.write_text(text, encoding="utf-8")
    done = run(file, tmp_path / "out")
    assert "note: follow-1: answers were recorded of its hash " in " ".join(done.stdout.split())


@pytest.mark.parametrize(
    ("field", "value"),
    [("name", 3), ("cycle_time", "0.1"), ("cycle_time", -1.0), ("time_limit", 1e9), ("hash", None)],
)
def test_what_a_conversation_says_of_who_spoke_has_its_limits(
    recorded: Path, tmp_path: Path, field: str, value: object
) -> None:
    found = read_conversation(recorded / "rGT.conversation")
    file = tmp_path / "x.conversation"
    file.write_bytes(replace(found, speaker=replace(found.speaker, **{field: value})).packed())
    with pytest.raises(InputError, match=f"speaker's {field}: "):
        read_conversation(file)


def test_parameters_have_names_of_text(recorded: Path, tmp_path: Path) -> None:
    found = read_conversation(recorded / "rGT.conversation")
    asked, answered = found.exchanges[0]
    first = packed({**msgpack.unpackb(asked[4:]), "parameters": {b"a": 1, "b": 2}})
    file = tmp_path / "x.conversation"
    file.write_bytes(replace(found, exchanges=((first, answered),)).packed())
    with pytest.raises(InputError, match="has no parameters, each with a text as name"):
        read_conversation(file)


def test_a_changed_conversation_is_refused_and_named(recorded: Path, tmp_path: Path) -> None:
    raw = (recorded / "rGT.conversation").read_bytes()
    last = (
        raw.rindex(b"acceleration") + len(b"acceleration") + 1
    )  # nothing is asked after it that would differ
    build = shutil.copy(recorded / "recorded.toml", tmp_path)
    for changed in (
        raw[:last] + bytes([raw[last] ^ 0x80]) + raw[last + 1 :],
        raw.replace(b"name", b"mane", 1),
    ):
        (tmp_path / "rGT.conversation").write_bytes(changed)
        with pytest.raises(InputError, match="was changed after it was recorded") as refused:
            load_build(Path(build))
        assert str(tmp_path / "rGT.conversation") in str(refused.value)


@pytest.mark.parametrize(
    ("raw", "why"),
    [
        (b"", "it is empty"),
        (b"\x01\0\0\0\xc1", "its first message is no msgpack"),
        (packed({"a": 1}) * 3, "does not begin with conversation = 2"),
    ],
)
def test_what_is_no_conversation_is_told_why(tmp_path: Path, raw: bytes, why: str) -> None:
    path = tmp_path / "a.conversation"
    path.write_bytes(raw)
    with pytest.raises(InputError, match=f"is no recorded conversation: {why}"):
        read_conversation(path)


@pytest.mark.parametrize("question", [b"\xc1", b"\x91\x01", b"\x81\x91\x01\x01"])
def test_a_question_that_is_no_map_is_refused(tmp_path: Path, question: bytes) -> None:
    path = tmp_path / "a.conversation"
    path.write_bytes(Conversation(SPEAKER, [(FIRST, b"x"), (framed(question), b"x")]).packed())
    with pytest.raises(InputError, match="question 2 is"):
        read_conversation(path)


@pytest.mark.slow
def test_another_map_with_the_same_lanes_is_another_drive(recorded: Path, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "scenarios" / "rear_end", tmp_path / "slow")
    text = (ROOT / "networks" / "proving_ground.xodr").read_text(encoding="utf-8")
    (tmp_path / "slow" / "map.xodr").write_text(text.replace('max="130"', 'max="60"'), encoding="utf-8")
    file = tmp_path / "slow" / "recording.toml"
    told = file.read_text(encoding="utf-8").replace("../../networks/proving_ground.xodr", "map.xodr")
    file.write_text(told, encoding="utf-8")
    done = run(recorded / "recorded.toml", tmp_path / "out", recording=str(tmp_path / "slow"))
    assert done.returncode == 3, done.stderr
    assert "was recorded for another drive: road.hash is" in done.stderr


MESSAGES = st.dictionaries(st.text(max_size=5), st.integers(0, 9), max_size=3).map(packed)


@given(st.lists(st.tuples(MESSAGES, st.binary(max_size=40)), max_size=5), st.data())
def test_a_file_gives_what_was_written_and_a_cut_one_is_refused(
    tmp_path_factory: pytest.TempPathFactory, pairs: list[tuple[bytes, bytes]], data: st.DataObject
) -> None:
    exchanges = [(FIRST, b"x"), *pairs]
    path = tmp_path_factory.mktemp("c") / "a.conversation"
    raw = Conversation(SPEAKER, exchanges).packed()
    path.write_bytes(raw)
    found = read_conversation(path)
    assert (found.speaker, list(found.exchanges)) == (SPEAKER, exchanges)
    path.write_bytes(raw[: data.draw(st.integers(0, len(raw) - 1))])
    with pytest.raises(InputError, match=r"is no recorded conversation|was changed after it was recorded"):
        read_conversation(path)
