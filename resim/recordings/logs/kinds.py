"""What kind of file somebody gives, by its content."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from resim.core.errors import InputError
from resim.core.files import open_file

LogKind = Literal["mcap", "db3", "folder", "mdf"]
MCAP = b"\x89MCAP0\r\n"
SQLITE = b"SQLite format 3\0"
_HEADS: dict[bytes, LogKind] = {MCAP: "mcap", SQLITE: "db3", b"MDF     ": "mdf", b"UnFinMF ": "mdf"}
_REFUSED = {
    b"#ROSBAG V": (
        "is a bag of ROS 1, which is not read",
        "Convert it: rosbags-convert --src FILE.bag --dst FOLDER (pip install rosbags).",
    ),
    b"\x28\xb5\x2f\xfd": ("is a file that zstd compressed", "Decompress it first: zstd -d FILE."),
    b"\x1f\x8b": ("is a file that gzip compressed", "Decompress it first: gunzip FILE."),
    b"\x89HDF\r\n\x1a\n": ("is an HDF5 file", "Write its signals as MDF4, CSV or Parquet."),
}
_LONGEST = 16
_NUMPY = b"\x93NUMPY"
_COMMA = {"global_pose", "CAN"}
"""Folders of a segment of comma2k19."""


def log_kind(path: Path) -> LogKind | None:
    """Give the kind of log that a file or folder is by its first bytes; None for what may be a table.

    Raises InputError for what cannot be opened, and for logs that resim does not read, with the way around.
    """
    if path.is_dir():
        refuse_unsuited(path)
        return "folder"
    if path.suffix == ".parquet" or not path.exists():
        return None
    refuse_unsuited(path)
    with open_file(path, "Check the path, and file in the mapping.") as file:
        head = file.read(_LONGEST)
    for begin, (problem, remedy) in _REFUSED.items():
        if head.startswith(begin):
            raise InputError(path, problem, remedy)
    return next((kind for begin, kind in _HEADS.items() if head.startswith(begin)), None)


def refuse_unsuited(path: Path) -> None:
    """Raise InputError for data that no recording can be made of, with what they lack: comma2k19, and NumPy arrays."""
    if path.is_dir():
        if not all((path / name).is_dir() for name in _COMMA):
            return
    elif not path.is_file() or not _starts_with(path, _NUMPY):
        return
    elif not any({p.name for p in above.iterdir()} >= _COMMA for above in list(path.absolute().parents)[:4]):
        problem = "is a NumPy array, whose columns have no names"
        raise InputError(
            path, problem, "Write it as CSV or Parquet, with a header, one row per time and object."
        )
    raise InputError(
        path,
        "belongs to comma2k19, which lacks what a recording needs: true tracks of the other vehicles (its radar has "
        "neither sizes nor kinds, and nothing to compare it with) and an OpenDRIVE map of the road",
        "Take a data set with object tracks, and a map of its road.",
    )


def _starts_with(path: Path, begin: bytes) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(begin)) == begin
    except OSError:
        return False
