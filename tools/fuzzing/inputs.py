"""Makes one damaged input: the same kind, seed and number give the same bytes."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random

from fuzzing import rows, trees
from fuzzing.bytewise import damaged
from resim.recordings import read_recording
from resim.road.opendrive import load
from resim.scenario.jscen import write_jscen
from resim.scenario.scenario import describe

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
GROUND = ROOT / "networks" / "proving_ground.xodr"
LARGEST_BASE = 40_000
SCENARIOS = ("cut_in_brake", "rear_end", "overtake")
WINDOW = 2.0
WHOLE_RUNS = 0.01
OWN = b'''"""A function of one's own."""
import helper


class DriveOn:
    """Drives on."""

    def __init__(self, *, gain: float = 1.0, name: str = "x") -> None:
        self.gain = helper.twice(gain)

    def reset(self, setup):
        pass

    def step(self, perceived):
        return None

    def close(self):
        pass
'''
HELPER = b"def twice(x):\n    return 2.0 * x\n"
OWN_TOML = (
    b'name = "own"\nversion = "0.1"\nfactory = "own:DriveOn"\ncycle_time = 0.2\ntime_limit = 1.0\n\n[parameters]\n'
    b'gain = 1.5\nname = "y"\n'
)
Structure = Callable[[Random, bytes], bytes]


def make(kind: str, seed: int, number: int, folder: Path) -> Path:
    """Write the input into the folder, and give the path that a user would name."""
    rng = Random(f"{kind} {seed} {number}")
    return {"map": _map, "recording": _recording, "jscen": _jscen, "build": _build}[kind](rng, folder)


def _torn(rng: Random, data: bytes, structure: Structure, other: bytes) -> bytes:
    """Damage the structure, the bytes, or first the one and then the other."""
    way = rng.random()
    if way < 0.65:
        data = structure(rng, data)
    return damaged(rng, data, other) if way > 0.6 else data


def _put(rng: Random, path: Path, data: bytes) -> Path:
    """Write the file; now and then something that is no file stands there."""
    if rng.random() > 0.01:
        path.write_bytes(data)
        return path
    way = rng.randrange(5)
    if way == 0:
        path.mkdir()
    elif way == 1:
        path.symlink_to(path.name)
    elif way == 2:
        os.mkfifo(path)
    elif way == 3:
        path.symlink_to("/dev/zero")
    else:
        path.write_bytes(data)
        path.chmod(0)
    return path


@cache
def _maps() -> tuple[bytes, ...]:
    found = [GROUND, *sorted((ROOT / "tests" / "road" / "maps").glob("*.xodr"))]
    shared = sorted(DATA.rglob("*.xodr")) if DATA.is_dir() else []
    return tuple(
        path.read_bytes() for path in [*found, *(p for p in shared if p.stat().st_size <= LARGEST_BASE)]
    )


def _map(rng: Random, folder: Path) -> Path:
    base, other = rng.choice(_maps()), rng.choice(_maps())
    name = rng.choice(
        ("map.xodr",) * 20 + ("a map.xodr", "M\u00e4p'<&>.xodr", "map", "-o.xodr", f"{'m' * 200}.xodr")
    )
    return _put(rng, folder / name, _torn(rng, base, trees.xml, other))


@cache
def _drives() -> tuple[dict[str, bytes], ...]:
    """Short cuts of the shipped recordings, as the files of a folder."""
    cuts = []
    for name in SCENARIOS:
        folder = ROOT / "scenarios" / name
        settings = (
            (folder / "recording.toml")
            .read_bytes()
            .replace(b"../../networks/proving_ground.xodr", b"road.xodr")
        )
        tables = {table: (folder / f"{table}.csv").read_text().splitlines() for table in ("gt", "sd")}
        for start in (0.0, 0.5 * WINDOW):
            cut = {f"{table}.csv": _window(lines, start).encode() for table, lines in tables.items()}
            cuts.append({"recording.toml": settings, "road.xodr": GROUND.read_bytes(), **cut})
    return tuple(cuts)


def _window(lines: list[str], start: float) -> str:
    inside = [row for row in lines[1:] if start <= float(row.partition(",")[0]) <= start + WINDOW]
    return "\n".join([lines[0], *inside])


def _recording(rng: Random, folder: Path) -> Path:
    files = dict(rng.choice(_drives()))
    drive = folder / "drive"
    drive.mkdir()
    if rng.random() < 0.2:
        del files["sd.csv"]
    if rng.random() < 0.1:
        files["plan.csv"] = b"t,t_plan,x,y,v\n0.0,0.1,1.0,2.0,3.0\n0.0,0.2,1.0,2.0,3.0\n"
    hit = rng.choice(["gt.csv"] * 8 + ["sd.csv"] * 5 + ["recording.toml"] * 4 + ["road.xodr", "plan.csv"])
    hit = hit if hit in files else "gt.csv"
    structure: dict[str, Structure] = {"recording.toml": trees.toml, "road.xodr": trees.xml}
    if hit in ("gt.csv", "sd.csv") and rng.random() < 0.15:
        data = rows.parquet(rng, files.pop(hit))
        hit = hit.replace("csv", "parquet")
        files[hit] = damaged(rng, data, files["road.xodr"]) if rng.random() < 0.3 else data
    else:
        other = rng.choice(list(files.values()))
        files[hit] = _torn(rng, files[hit], structure.get(hit, rows.csv), other)
    for name, data in files.items():
        if name == hit:
            _put(rng, drive / name, data)
        else:
            (drive / name).write_bytes(data)
    return drive


def whole_run(kind: str, seed: int, number: int) -> bool:
    """Say whether this input goes through the whole of `resim run`."""
    return kind == "recording" and Random(f"run {seed} {number}").random() < WHOLE_RUNS


@cache
def _scenarios() -> tuple[bytes, ...]:
    network, found = load(GROUND), []
    path = Path(os.environ["TMPDIR"]) / "base.json"
    for name in SCENARIOS:
        recording = read_recording(ROOT / "scenarios" / name)
        scenario = describe(recording.gt, network, ego=recording.ego, map_name=GROUND.name)
        write_jscen(scenario, path)
        found.append(path.read_bytes())
        path.unlink()
    published = json.loads((ROOT / "tests" / "scenario" / "appendix_a1.jscen.json").read_text())
    return (*found, json.dumps(published).encode())


def _jscen(rng: Random, folder: Path) -> Path:
    base, other = rng.choice(_scenarios()), rng.choice(_maps())
    return _put(rng, folder / "case.jscen.json", _torn(rng, base, trees.jsonised, other))


@cache
def _builds() -> tuple[bytes, ...]:
    return tuple(path.read_bytes() for path in sorted((ROOT / "adfunc" / "builds").glob("*.toml")))


def _build(rng: Random, folder: Path) -> Path:
    own = rng.random() < 0.5
    base = OWN_TOML if own else rng.choice(_builds())
    module = damaged(rng, OWN, HELPER) if own and rng.random() < 0.3 else OWN
    if own:
        (folder / "own.py").write_bytes(module)
        (folder / "helper.py").write_bytes(HELPER)
    data = base if module is not OWN else _torn(rng, base, trees.toml, OWN)
    return _put(rng, folder / "build.toml", data)
