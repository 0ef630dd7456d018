"""Bags hold what the drive holds: read back by their mapping, and by rosbags."""

from __future__ import annotations

import io
import json
import re
import struct
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import HealthCheck, given, settings

from resim.jobs.export import export_drive, recorded_drive
from resim.recordings import Recording, read_recording
from resim.recordings.formats.table import read_mapped
from resim.recordings.source import recording_of
from resim.road.opendrive import load

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
from exports.drives import MAP, assert_same, recordings
from mcap.reader import NonSeekingReader
from mcap.stream_reader import CRCValidationError
from rosbags.highlevel import AnyReader

from resim.exports import rosbag
from resim.exports.states import numbers


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow], max_examples=30)
@given(recording=recordings())
def test_what_goes_out_comes_in_again(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("out")
    drive = recorded_drive(recording, load(MAP))
    rosbag.write(drive, folder)
    found = recording_of(read_mapped(folder / "bag", map=MAP, columns=folder / "mapping.toml"))
    names = {f"{number:032x}": name for name, number in numbers(drive).items()}
    origin = float(recording.gt.t[0]) - float(found.gt.t[0])  # a clock that is no Unix time stays as it is
    sd = recording.sd_by_gt()
    if sd is not None and not recording.senses_ego:
        sd = sd.without(recording.ego)
    assert (found.sd is None) == (sd is None)
    for back, true in ((found.gt, recording.gt), (found.sd, sd)):
        if true is None:
            continue
        ids = np.array([names.get(name, name) for name in back.ids.tolist()])
        assert_same(type(back)(**{**vars(back), "ids": ids}), true, origin, only=("x", "y", "v"))
    if sd is not None:
        ids = [names.get(name, name) for name in found.sd.ids.tolist()]
        true = [name if name in recording.gt.ids.tolist() else "" for name in ids]
        assert [names.get(name, name) for name in found.sd_gt_id.tolist()] == true


@pytest.fixture(scope="module")
def bag(result: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("bag") / "out"
    export_drive(result, out, "rosbag")
    return out


def test_a_bag_holds_all_of_a_drive(result: Path, bag: Path) -> None:
    judged = json.loads((result / "assessment.json").read_text(encoding="utf-8"))
    true = read_recording(ROOT / "scenarios" / "cut_in_brake").gt
    with AnyReader([bag / "bag"]) as reader:
        found: dict[str, list] = {}
        for connection, _, raw in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    assert {
        f"/{s}/{kind}"
        for s in ("GT", "SD", "rGT", "rSD")
        for kind in ("ego", "objects", "markers", "verdicts")
    } <= set(found)
    assert {"/perceived_rGT/objects", "/rGT/plan", "/rGT_M0/ego"} <= set(found)
    for source in ("GT", "SD", "rGT", "rSD"):
        (told,) = found[f"/{source}/verdicts"]
        assert json.loads(told.data)["verdict"] == judged[source]["verdict"]
    (told,) = found["/verdicts"]
    assert json.loads(told.data)["decides"] == judged["decides"]
    assert json.loads(told.data)["sources"]["rGT+M"] == judged["rGT+M"]["verdict"]
    assert all(re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", topic) for topic in found)
    row = true.index("1")
    for k, told in enumerate(found["/GT/objects"]):
        (one,) = told.objects
        at = one.kinematics.pose_with_covariance.pose.position
        assert (at.x, at.y) == (true.x[row, k], true.y[row, k])
        assert told.header.frame_id == "map"
    markers = found["/GT/markers"][0].markers
    assert [m.text for m in markers if m.type == 9] == ["EGO GT", "1"]


def test_the_same_drive_gives_the_same_bag(tmp_path: Path) -> None:
    for name in ("a", "b"):
        export_drive(ROOT / "scenarios" / "rear_end", tmp_path / name, "rosbag")
    for file in ("bag/bag.mcap", "bag/metadata.yaml", "mapping.toml"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


def test_a_flipped_bit_is_found(bag: Path) -> None:
    """By the reader of MCAP, which holds all checksums there are: of chunks, and of the whole data section."""
    (file,) = bag.rglob("*.mcap")
    raw = file.read_bytes()

    def count(content: bytes) -> int:
        return len([*NonSeekingReader(io.BytesIO(content), validate_crcs=True).iter_messages()])

    assert count(raw) > 100
    assert struct.unpack_from("<I", raw, len(raw) - 12) != (0,)  # the footer's
    (length,) = struct.unpack_from("<Q", raw, raw.index(b"\x06", 50) + 1)
    random = np.random.default_rng(0)
    for at in random.integers(1000, min(length, len(raw) // 2), 20).tolist():
        changed = bytearray(raw)
        changed[at] ^= 1 << int(random.integers(8))
        with pytest.raises(CRCValidationError):
            count(bytes(changed))
