from __future__ import annotations

from pathlib import Path

import pytest

from resim.road.opendrive import RoadNetwork, load
from resim.simulation.sumo.session import close_session

HERE = Path(__file__)
NETWORKS = HERE.parents[2] / "networks"
DATA = HERE.parents[2].parent / "shared" / "data"


@pytest.fixture(scope="session")
def proving_ground() -> RoadNetwork:
    return load(NETWORKS / "proving_ground.xodr")


@pytest.fixture(scope="session")
def shared_map():
    """Loads a map of the shared data by its path there; skips where the data is absent."""
    maps: dict[str, RoadNetwork] = {}

    def get(name: str) -> RoadNetwork:
        if not (DATA / name).is_file():
            pytest.skip(f"no shared data {name}")
        if name not in maps:
            maps[name] = load(DATA / name)
        return maps[name]

    return get


@pytest.fixture
def started_sumo():
    """Starts SUMO on a net, to drive in it without resim; gives libsumo, which holds one simulation in a process."""
    import libsumo

    started = []

    def start(net: Path):
        libsumo.close() if started else close_session()  # resim's own would not know that it is gone
        command = ["sumo", "-n", str(net), "--step-length", "0.1", "--time-to-teleport", "-1"]
        libsumo.start([*command, "--no-step-log", "--no-warnings", "--xml-validation", "never"])
        started.append(net)
        return libsumo

    yield start
    if started:
        libsumo.close()


@pytest.fixture
def one_road(tmp_path):
    """Writes a map of one road: planView, lanes and a length given as XML; gives its path."""

    def write(geometry: str, *, lanes: str = "", extra: str = "", attributes: str = "") -> Path:
        lanes = lanes or (
            '<laneSection s="0"><center><lane id="0" type="none"/></center><right>'
            '<lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
            "</right></laneSection>"
        )
        path = tmp_path / "one.xodr"
        path.write_text(
            f'<OpenDRIVE><header revMajor="1" revMinor="6"/><road id="7" length="1" junction="-1" {attributes}>'
            f"{extra}<planView>{geometry}</planView><lanes>{lanes}</lanes></road></OpenDRIVE>"
        )
        return path

    return write


@pytest.fixture
def written(tmp_path):
    """Writes a map of these parts and reads it."""

    def write(*parts):
        path = tmp_path / "map.xodr"
        path.write_text(f'<OpenDRIVE><header revMajor="1" revMinor="7"/>{"".join(parts)}</OpenDRIVE>')
        return load(path)

    return write
