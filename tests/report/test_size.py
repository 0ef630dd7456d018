"""A page holds what is seen of a drive, and no more: it stays small."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from resim.core.geometry import Floats
from resim.recordings import read_commonroad
from resim.report import write_report
from resim.report.plots import SEEN, without_unseen
from resim.resimulation import AssessmentOptions, assess_resimulation, resimulate
from resim.simulation.function.interface import load_build

ROOT = Path(__file__).parents[2]
NGSIM = ROOT.parent / "shared" / "data" / "ngsim"
LARGEST = 2_000_000
"""Bytes of a page."""


def wave() -> tuple[Floats, Floats]:
    """Two lines of 2000 points with a break between them, one of them noisy."""
    t = np.linspace(0.0, 20.0, 2000)
    noise = np.random.default_rng(3).normal(0.0, 0.02, len(t))
    return np.r_[t, np.nan, t], np.r_[np.sin(t), np.nan, 30.0 + np.sin(0.5 * t) + noise]


def test_points_that_nobody_sees_are_left_out_and_the_line_stays_where_it_is() -> None:
    x, y = wave()
    fewer = without_unseen(x, y)
    assert len(fewer[0]) < 0.4 * len(x)
    assert np.isnan(fewer[0]).sum() == 1
    scale = 1.0 / np.array([np.nanmax(x) - np.nanmin(x), np.nanmax(y) - np.nanmin(y)])
    broken = int(np.flatnonzero(np.isnan(fewer[0]))[0])
    for part, kept in ((slice(0, 2000), slice(0, broken)), (slice(2001, None), slice(broken + 1, None))):
        line = shapely.linestrings(np.column_stack([fewer[0][kept], fewer[1][kept]]) * scale)
        points = shapely.points(np.column_stack([x[part], y[part]]) * scale)
        assert shapely.distance(points, line).max() <= SEEN * (1.0 + 1e-9)
        assert {fewer[0][kept][0], fewer[0][kept][-1]} == {x[part][0], x[part][-1]}


@pytest.mark.parametrize("count", [0, 1, 2])
def test_what_has_no_points_to_spare_keeps_them(count: int) -> None:
    x, y = np.arange(float(count)), np.zeros(count)
    assert [len(part) for part in without_unseen(x, y)] == [count, count]
    assert len(without_unseen(np.full(3, np.nan), np.full(3, np.nan))[0]) == 1


@pytest.mark.slow
def test_the_report_of_a_real_drive_among_53_others_has_under_2_mb(tmp_path: Path) -> None:
    drive = NGSIM / "USA_US101-22_1_T-1.xml"
    if not drive.is_file():
        pytest.skip("needs the recordings in ../shared/data")
    recording = read_commonroad(drive, map=drive.with_suffix(".xodr"), ego="659")
    result = resimulate(recording, load_build(ROOT / "adfunc" / "builds" / "replay-1.0.toml"))
    assert len(result.recording.gt.ids) == 54
    write_report(result, assess_resimulation(result, AssessmentOptions()), tmp_path / "report.html")
    assert (tmp_path / "report.html").stat().st_size < LARGEST
