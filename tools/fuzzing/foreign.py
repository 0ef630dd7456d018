"""Makes one damaged recording in a format of others: the same kind, seed and number give the same bytes.

MDF and Feather need the packages of `.venv-formats`; without them their inputs are left out.
"""

from __future__ import annotations

import importlib.util
import io
import tempfile
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import duckdb
import pandas as pd

from fuzzing import messages, rows, trees
from fuzzing.bytewise import damaged
from fuzzing.foreign_bases import base
from fuzzing.values import NUMBERS

Structures = dict[str, Callable[[Random, bytes], bytes]]


class Foreign(NamedTuple):
    """How recordings of a kind are damaged and imported.

    form: name of the format. file: what is named. options: of its reader, but the map. structures: by the name of each
    file that is damaged, how.
    """

    form: str
    file: str
    options: dict[str, Any]
    structures: Structures


class Import(NamedTuple):
    """What is imported: the format's name, the file that a user would name, and the reader's options but the map."""

    form: str
    file: Path
    options: dict[str, Any]


def make(kind: str, rng: Random, folder: Path) -> Import:
    """Write the files of a damaged recording into the folder. kind: one of KINDS."""
    form, file, options, structures = KINDS[kind]
    files = dict(base(kind))
    hit = rng.choice(sorted(name for name in structures if name in files))
    way = rng.random()
    if way < 0.75:
        files[hit] = structures[hit](rng, files[hit])
    for name, data in files.items():
        files[name] = WRITERS.get(Path(name).suffix if kind != "scenes" else name, _as_it_is)(data)
    if way > 0.65:
        files[hit] = damaged(rng, files[hit], rng.choice(list(files.values())))
    if rng.random() < 0.02:
        del files[hit]
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    told = {key: folder / value if key in ("sd", "columns") else value for key, value in options.items()}
    if rng.random() < 0.1:
        told |= {"start": rng.choice((-1.0, 0.0, 0.3, 1e9)), "end": rng.choice((0.2, 0.5, 1e300))}
    return Import(form, folder / file, told)


def _as_it_is(data: bytes) -> bytes:
    return data


def _frame(data: bytes) -> pd.DataFrame:
    """The table of a CSV text, its columns numbers where most cells are."""
    frame = pd.read_csv(io.BytesIO(data), dtype=str, on_bad_lines="skip", keep_default_na=False)
    for name in frame:
        numbers = pd.to_numeric(frame[name], errors="coerce")
        if numbers.notna().mean() > 0.5:
            frame[name] = (
                numbers.astype("int64") if name == "timestamp_ns" and numbers.notna().all() else numbers
            )
    return frame


def _written(write: Callable[[pd.DataFrame], bytes]) -> Callable[[bytes], bytes]:
    """What writes a CSV text in another form; text that no table can be made of stays as it is."""

    def packed(data: bytes) -> bytes:
        try:
            return write(_frame(data))
        except (ValueError, TypeError, ArithmeticError, LookupError, AttributeError, duckdb.Error):
            return data

    return packed


def _feather(frame: pd.DataFrame) -> bytes:
    out = io.BytesIO()
    frame.to_feather(out, compression="lz4")
    return out.getvalue()


def _mdf(frame: pd.DataFrame) -> bytes:
    """A group of channels for each object, of all columns that are numbers."""
    from asammdf import MDF, Signal

    with tempfile.TemporaryDirectory() as folder, MDF(version="4.10") as made:
        made.header.abs_time = 1_714_550_400_123_456_789
        for name, of in frame.groupby("id", sort=False):
            channels = [c for c in of if c not in ("t", "id") and of[c].dtype.kind in "fi"]
            signals = [Signal(of[c].to_numpy(), of["t"].to_numpy(float), name=str(c)) for c in channels]
            made.append(signals, acq_name=str(name)[:100])
        made.save(Path(folder) / "a.mf4", overwrite=True)
        return (Path(folder) / "a.mf4").read_bytes()


def _parquet(frame: pd.DataFrame) -> bytes:
    with tempfile.TemporaryDirectory() as folder, duckdb.connect(config={"threads": 1}) as db:
        db.register("written", frame)
        db.execute(f"COPY written TO '{folder}/a.parquet' (FORMAT parquet)")
        return (Path(folder) / "a.parquet").read_bytes()


def _json(rng: Random, data: bytes) -> bytes:
    """Damage JSON, now and then with numbers that are none to it."""
    torn = trees.jsonised(rng, data)
    return torn.replace(b"1e+300", rng.choice(NUMBERS).encode()) if rng.random() < 0.5 else torn


def _bytes(rng: Random, data: bytes) -> bytes:
    return damaged(rng, data, data)


WRITERS = {
    ".feather": _written(_feather), ".mf4": _written(_mdf), ".parquet": _written(_parquet), "a.mcap": messages.scenes
}  # fmt: skip
"""By ending, or name of the scenes, what makes a file of the text that was damaged."""
_TABLES: Structures = {f"01_{name}.csv": rows.csv for name in ("tracks", "tracksMeta", "recordingMeta")}
_LOG: Structures = dict.fromkeys(
    ("annotations.feather", "city_SE3_egovehicle.feather", "tracker.feather"), rows.csv
)
_MAPPED = {"columns": "mapping.toml"}
KINDS = {
    "osi": Foreign("osi", "GT.osi", {"ego": "ego", "sd": "SD.osi"},
                   {"GT.osi": messages.trace("GroundTruth"), "SD.osi": messages.trace("SensorData")}),
    "osi_mcap": Foreign("osi", "drive.mcap", {}, {"drive.mcap": messages.mcap}),
    "openscenario": Foreign("openscenario", "GT.xosc", {}, {"GT.xosc": trees.xml}),
    "commonroad": Foreign("commonroad", "a.xml", {"ego": "1"}, {"a.xml": trees.xml}),
    "highd": Foreign("highd", "01_tracks.csv", {"ego": "1"}, _TABLES),
    "ind": Foreign("highd", "01_tracks.csv", {"ego": "1"}, _TABLES),
    "mcity": Foreign("mcity", ".", {"trial": "1"}, {"gts/t1.json": _json, "dets/d1.json": _json}),
    "forecast": Foreign("argoverse", "scenario_a.parquet", {}, {"scenario_a.parquet": rows.csv}),
    "log": Foreign("argoverse", ".", {"sd": "tracker.feather"}, _LOG),
    "scenes": Foreign("table", "a.mcap", _MAPPED, {"a.mcap": messages.lines, "mapping.toml": trees.toml}),
    "bag": Foreign("table", "bag", _MAPPED,
                   {"bag/bag.mcap": _bytes, "bag/metadata.yaml": _bytes, "mapping.toml": trees.toml}),
    "mdf": Foreign("table", "a.mf4", _MAPPED, {"a.mf4": rows.csv, "mapping.toml": trees.toml}),
    "table": Foreign("table", "a.csv", _MAPPED, {"a.csv": rows.csv, "mapping.toml": trees.toml}),
}  # fmt: skip
for _name, _needs in (("mdf", "asammdf"), ("log", "pyarrow")):
    if importlib.util.find_spec(_needs) is None:
        del KINDS[_name]
