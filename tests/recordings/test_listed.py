"""The recordings that a suite or a sweep names by a glob."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from conftest import ROOT

from resim.core.errors import InputError
from resim.recordings.listed import RecordingEntry, found_folders


def test_what_is_no_recording_any_more_does_not_drop_out_of_a_glob(tmp_path: Path) -> None:
    for name in ("good", "bad"):
        shutil.copytree(ROOT / "scenarios" / "rear_end", tmp_path / "set" / name)
    (tmp_path / "set" / "notes").mkdir()
    (tmp_path / "set" / "readme.txt").touch()
    entry = RecordingEntry(folder="set/*")
    assert set(found_folders(tmp_path / "suite.toml", [entry])[0]) == {"good", "bad"}
    (tmp_path / "set" / "bad" / "recording.toml").unlink()
    with pytest.raises(InputError, match=r"set/bad has no recording\.toml"):
        found_folders(tmp_path / "suite.toml", [entry])
    shutil.rmtree(tmp_path / "set" / "bad")
    (tmp_path / "set" / "bad").symlink_to(tmp_path / "gone")
    with pytest.raises(InputError, match=r"set/bad has no recording\.toml"):
        found_folders(tmp_path / "suite.toml", [entry])


def test_the_root_folder_has_a_name_as_well(tmp_path: Path) -> None:
    named, _ = found_folders(tmp_path / "suite.toml", [RecordingEntry(folder="/")])
    assert named == {"root": Path("/")}
