"""What the tests of damaged input share: small valid inputs, and what an error has to be."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from resim.core.errors import ResimError
from resim.resimulation import refuse_flaws
from resim.road.flaws import flaws
from resim.road.opendrive import load
from resim.road.sumo import sumo_net

ROOT = Path(__file__).parents[1]
GROUND = ROOT / "networks" / "proving_ground.xodr"
JSCEN = json.loads((ROOT / "tests" / "scenario" / "appendix_a1.jscen.json").read_text())
DIGITS = "9" * 5000
HEADER = "t,id,x,y,heading,v,length,width,kind"
DRIVE = [[f"{k / 10}", "a", f"{50 + 2 * k}", "-1.75", "0", "20", "4.7", "1.9", "car"] for k in range(20)]


def convert(path: Path) -> None:
    """Give a map to all that reads one."""
    network = load(path)
    found = flaws(network)
    network.to_road([1.0, 1e9], [-1.0, 0.0])
    network.lane_shapes()
    sumo_net(network, cache=path.parent / "nets", time_limit=30.0)
    refuse_flaws(network, found, ())


def written(folder: Path, rows: list[list[str]]) -> Path:
    """Write a recording of these rows into the folder."""
    (folder / "recording.toml").write_text(f'name = "x"\nmap = "{GROUND}"\nego = "a"\n')
    (folder / "gt.csv").write_text("\n".join([HEADER, *(",".join(row) for row in rows)]))
    return folder


def places(data: Any) -> list[tuple[Any, Any]]:
    """Every list or object in JSON data with each of its keys."""
    keys = list(data) if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else []
    return [(data, key) for key in keys] + [place for key in keys for place in places(data[key])]


@contextmanager
def result_or_clear_error(path: Path) -> Iterator[None]:
    """Let a clear error about the file pass; every other exception fails the test, as warnings do."""
    try:
        yield
    except ResimError as error:
        if not is_clear(error, path):
            pytest.fail(f"unclear: {error}")


def is_clear(error: ResimError, path: Path) -> bool:
    """Say whether the error names the file's folder, in one line of bearable length."""
    text = str(error)
    return str(path.parent) in text and text.isprintable() and len(text) < 2000
