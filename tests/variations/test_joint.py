"""Several objects of a measured drive vary together, on a drive of NGSIM and from the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from conftest import DATA, ROOT, Call

from resim.core.tracks import Tracks
from resim.jobs.vary import read_variations
from resim.recordings import read_commonroad, read_recording, write_recording
from resim.road.opendrive import load
from resim.scenario.jscen import read_jscen

ROAD = DATA / "ngsim" / "USA_US101-22_1_T-1.xodr"
KERNELS = ROOT / "scenarios" / "kernels" / "motorway.json"
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not ROAD.is_file(), reason="no shared data")]


def met(tracks: Tracks, one: str) -> set[str]:
    """Whose boxes ever overlap that of one, by shapely."""
    corner = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    size = 0.5 * np.stack([tracks.length, tracks.width], axis=-1)[:, None, None, :] * corner
    cos, sin = np.cos(tracks.heading)[..., None], np.sin(tracks.heading)[..., None]
    x, y = tracks.x[..., None] + cos * size[..., 0] - sin * size[..., 1], (
        tracks.y[..., None] + sin * size[..., 0] + cos * size[..., 1])  # fmt: skip
    boxes = np.full(tracks.valid.shape, shapely.Polygon(), dtype=object)
    boxes[tracks.valid] = shapely.polygons(np.stack([x, y], axis=-1)[tracks.valid])
    hit = shapely.intersects(boxes, boxes[tracks.index(one)]).any(axis=1)
    return {*tracks.ids[hit].tolist()} - {one}


def test_two_vehicles_of_us101_vary_jointly_and_never_meet(call: Call, tmp_path: Path) -> None:
    drive, out = tmp_path / "us101", tmp_path / "out"
    write_recording(read_commonroad(ROAD.with_suffix(".xml"), map=ROAD, ego="659"), drive)
    code, told, error = call("vary", drive, "--kernels", KERNELS, "--object", "649", "--object", "650",
                             "--maneuver", "follow_lane", "--count", 2, "--workers", 1, "--out", out)  # fmt: skip
    assert code == 0, error
    assert "varied: 649:follow_lane@0.00, 650:follow_lane@0.00" in told
    recording, found = read_recording(drive), read_variations(out)
    network, gt = load(recording.map), recording.gt
    parts = np.split(found.table[[f"c{k + 1}" for k in range(8)]].to_numpy(), 2, axis=1)
    assert all(np.ptp(part, axis=0).all() for part in parts)
    for file in found.table["file"]:
        tracks = read_jscen(out / file).tracks(network, gt.t)
        moved = np.nanmax(np.hypot(tracks.x - gt.x, tracks.y - gt.y), axis=1)
        n = [tracks.index(name) for name in ("649", "650")]
        assert (moved[n] > 0.3).all()
        assert all(met(tracks, name) <= met(gt, name) for name in ("649", "650"))
