from __future__ import annotations

import stat
import subprocess
import sys
import threading

import numpy as np
import pytest
import shapely
from lxml import etree

from resim.core.errors import ConversionError
from resim.road.opendrive import load
from resim.road.sumo import cache as cache_module
from resim.road.sumo import default_cache, netconvert, sumo_net


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("nets")


@pytest.fixture
def fake_netconvert(tmp_path, monkeypatch):
    """Puts a shell script in the place of netconvert."""

    def put(script: str) -> None:
        binary = tmp_path / "home" / "bin" / "netconvert"
        binary.parent.mkdir(parents=True)
        binary.write_text(f"#!/bin/sh\n{script}\n")
        binary.chmod(binary.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setattr(netconvert, "_sumo_home", lambda: tmp_path / "home")

    return put


def lane_error(net, converted):
    """Largest distance [m] of each SUMO lane's points from the exact lane centre, by key."""
    shapes = {e.get("id"): e.get("shape") for _, e in etree.iterparse(str(converted.path), tag="lane")}
    worst = {}
    for (road, section, lane), ids in converted.lanes.items():
        if net.roads[road].junction or net.roads[road].sections[section].lanes[lane].type != "driving":
            continue
        here = net.roads[road].sections[section]
        end = min(here.end, net.roads[road].length) - 1e-6
        s = np.linspace(here.start, end, int((end - here.start) / 0.1) + 2)
        centre = shapely.linestrings(np.stack(net.to_xy(road, lane, s, 0.0), axis=1))
        points = [tuple(map(float, p.split(",")[:2])) for i in ids for p in shapes[i].split()]
        worst[road, section, lane] = shapely.distance(shapely.points(points), centre).max()
    return worst


def test_the_proving_ground_converts_to_its_exact_centre_lines(proving_ground, cache):
    converted = sumo_net(proving_ground, cache=cache)
    assert converted.path.parent.parent == cache
    worst = lane_error(proving_ground, converted)
    assert max(worst.values()) < 0.001
    assert set(converted.lanes) == {
        (road.id, k, lane) for road in proving_ground.roads.values()
        for k, section in enumerate(road.sections) for lane in section.lanes if lane
    }  # fmt: skip


def test_lanes_of_a_split_section_come_in_order_of_s(proving_ground, cache):
    ids = sumo_net(proving_ground, cache=cache).lanes["1", 0, -1]
    assert len(ids) == 9
    assert list(ids) == [f"1.{k}_2" for k in range(9)]
    against = sumo_net(proving_ground, cache=cache).lanes["1", 0, 1]
    assert list(against) == [f"-1.{k}_1" for k in reversed(range(9))]


@pytest.mark.parametrize(
    "name", ["mcity/mcity.xodr", "ngsim/USA_US101-5_1_T-1.xodr", "ngsim/USA_US101-22_1_T-1.xodr",
             "ngsim/USA_US101-10_1_T-1.xodr", "ngsim/USA_US101-12_1_T-1.xodr", "xodr/esmini/e6mini.xodr",
             "xodr/esmini/curve_r100.xodr"]
)  # fmt: skip
def test_real_maps_convert_and_every_driving_lane_has_its_sumo_lane(shared_map, cache, name):
    net = shared_map(name)
    converted = sumo_net(net, cache=cache)
    wanted = {
        (road.id, k, lane.id) for road in net.roads.values() if road.junction is None
        for k, section in enumerate(road.sections) for lane in section.lanes.values() if lane.type == "driving"
    }  # fmt: skip
    assert wanted - {(r, k, 0) for r, k, _ in wanted} <= set(converted.lanes)
    if "esmini" in name:
        assert max(lane_error(net, converted).values()) < 0.0015


def test_the_second_time_comes_from_the_cache(proving_ground, tmp_path, monkeypatch):
    first = sumo_net(proving_ground, cache=tmp_path / "nets")
    monkeypatch.setattr(cache_module, "run_netconvert", lambda *_, **__: pytest.fail("converted again"))
    again = sumo_net(proving_ground, cache=tmp_path / "nets")
    assert (again.path, again.hash, again.lanes) == (first.path, first.hash, first.lanes)
    assert [p.name for p in (tmp_path / "nets").iterdir()] == [first.hash]


def test_the_default_cache_follows_xdg(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert default_cache() == tmp_path / "resim" / "nets"


def test_a_changed_map_is_another_net(proving_ground, tmp_path):
    changed = tmp_path / "changed.xodr"
    changed.write_bytes(proving_ground.path.read_bytes().replace(b"proving ground", b"proving grounds"))
    nets = [sumo_net(n, cache=tmp_path / "nets") for n in (proving_ground, load(changed))]
    assert nets[0].hash != nets[1].hash
    assert nets[0].path != nets[1].path


@pytest.mark.slow
def test_many_at_once_agree(proving_ground, tmp_path):
    found = []
    threads = [
        threading.Thread(target=lambda: found.append(sumo_net(proving_ground, cache=tmp_path)))
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({net.path for net in found}) == 1
    assert len(found) == 4
    assert len(list(tmp_path.iterdir())) == 1


def test_two_processes_at_once_give_the_same_bytes_and_leave_nothing_else(proving_ground, tmp_path):
    program = (
        "import sys; from pathlib import Path; from resim.road.opendrive import load; "
        "from resim.road.sumo import sumo_net; network = load(sys.argv[1]); print('ready', flush=True); "
        "sys.stdin.readline(); print(sumo_net(network, cache=Path(sys.argv[2])).path, flush=True)"
    )
    command = [sys.executable, "-c", program, str(proving_ground.path), str(tmp_path / "nets")]
    both = [
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]  # fmt: skip
    assert [process.stdout.readline() for process in both] == ["ready\n"] * 2
    for process in both:
        process.stdin.write("go\n")
        process.stdin.flush()
    told = [process.communicate() for process in both]
    assert [process.returncode for process in both] == [0, 0], told
    assert told[0] == told[1]
    (net,) = (tmp_path / "nets").iterdir()
    alone = sumo_net(proving_ground, cache=tmp_path / "alone").path.parent
    assert {p.name: p.read_bytes() for p in net.iterdir()} == {
        p.name: p.read_bytes() for p in alone.iterdir()
    }


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ("exec sleep 60", "stopped after 0.3 s"),
        ("echo 'netconvert: error while loading shared libraries: libX11.so.6: cannot open' >&2; exit 127",
         "libX11.so.6.*Install libX11"),
        ("kill -SEGV $$", "crashed on this map"),
        ("exit 139", "SIGSEGV"),
        ("echo half > \"$4\"; echo 'Error: no roads.' >&2; echo 'Quitting (on error).' >&2; exit 1",
         "refuses this map: no roads. "),
        ("exit 0", "exit code 0"),
    ],
)  # fmt: skip
def test_every_way_to_fail_is_told_and_leaves_nothing(
    proving_ground, tmp_path, fake_netconvert, script, says
):
    fake_netconvert(script)
    with pytest.raises(ConversionError, match=says):
        sumo_net(proving_ground, cache=tmp_path / "nets", time_limit=0.3 if "sleep" in script else 30.0)
    assert list((tmp_path / "nets").iterdir()) == []


def test_the_maker_writes_the_network_that_ships(proving_ground, monkeypatch):
    pytest.importorskip("scenariogeneration")
    import runpy

    tools = proving_ground.path.parents[1] / "tools" / "make_networks.py"
    monkeypatch.syspath_prepend(str(tools.parent))
    made = runpy.run_path(str(tools))["proving_ground"]()
    assert made == proving_ground.path.read_bytes()


def test_what_netconvert_refuses_is_told_in_the_terms_of_the_map(proving_ground, tmp_path, fake_netconvert):
    fake_netconvert("echo \"Error: Edge '1.2' and lane '-1.0_0' are bad at node '1.at3'.\" >&2; exit 1")
    with pytest.raises(ConversionError) as error:
        sumo_net(proving_ground, cache=tmp_path)
    for part in (
        "Edge road 1, s = 200.000 to 300.000 m and lane road 1 section 0 lane ",
        "node the end of road 1, s = ",
    ):
        assert part in str(error.value)
