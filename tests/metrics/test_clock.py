"""Where a drive's clock begins, and where its map lies, change no verdict: also at seconds since 1970."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pandas as pd
import pytest
from conftest import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st

from resim import assess, read_criteria
from resim.metrics.criteria import Criteria

CRITERIA = """
name = "limits"
[[criterion]]
name = "jerk"
measure = "longitudinal jerk"
beyond = 5.0
[[criterion]]
name = "time to collision"
measure = "TTC"
below = 1.0
[[criterion]]
name = "headway"
measure = "THW"
below = 1.0
duration = 0.2
"""


def verdicts(criteria: Criteria, begin: float, rows: list[tuple[float, str, float, float]]) -> pd.DataFrame:
    """Of a drive straight along a lane, of rows t [s], id, x [m] and v [m/s]."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "recording.toml").write_text(
            f'name = "d"\nmap = "{ROOT}/networks/proving_ground.xodr"\nego = "ego"\n', encoding="utf-8"
        )
        lines = [f"{begin + t!r},{who},{x!r},-5.25,0.0,{v!r},4.7,1.9,car" for t, who, x, v in rows]
        text = "\n".join(["t,id,x,y,heading,v,length,width,kind", *lines, ""])
        (folder / "gt.csv").write_text(text, encoding="utf-8")
        found = assess(folder, criteria=criteria).kpis
    told = found[found.row != "measure"].drop(columns="reason").reset_index(drop=True)
    return told.assign(t=(told.t - begin).round(3))


@pytest.fixture(scope="module")
def limits(tmp_path_factory: pytest.TempPathFactory) -> Criteria:
    path = tmp_path_factory.mktemp("criteria") / "limits.toml"
    path.write_text(CRITERIA, encoding="utf-8")
    return read_criteria(path)


@settings(max_examples=12, deadline=None)
@given(
    begin=st.sampled_from([1.0, 3.0, 10.0, 100.0, 1e6, 1e8, 1e9, 1_763_900_000.04]),
    brakes=st.tuples(st.floats(-4.0, -1.0), st.floats(1.0, 5.0)),
    gap=st.floats(60.0, 130.0),
    steps=st.tuples(st.integers(40, 200), st.sampled_from([0.04, 0.1])),
)
def test_braking_before_a_standing_car(
    limits: Criteria, begin: float, brakes: tuple[float, float], gap: float, steps: tuple[int, float]
) -> None:
    """Splines once depended on it, and the last scene was left out."""
    (a, since), (count, step) = brakes, steps
    rows = []
    for k in range(count):
        t = round(k * step, 6)
        braked = min(max(t - since, 0.0), 20.0 / -a)
        x = 20.0 * (t - max(t - since - braked, 0.0)) + 0.5 * a * braked**2
        rows += [(t, "ego", 300.0 + x, 20.0 + a * braked), (t, "1", 300.0 + gap, 0.0)]
    pd.testing.assert_frame_equal(
        verdicts(limits, begin, rows), verdicts(limits, 0.0, rows), atol=2e-3, rtol=1e-3
    )


@pytest.mark.parametrize("begin", [1e6, 1.7e9])
def test_drives_of_any_length_go_to_their_last_sample(begin: float) -> None:
    """Times of 2026 are apart by 2.4e-7 s: drives of some lengths went beyond it."""
    criteria = read_criteria(ROOT / "scenarios" / "criteria" / "traffic.toml")
    for count in (60, 64, 65, 66):
        rows = [
            (0.1 * k, who, x + 2.0 * k, 20.0)
            for k in range(count)
            for who, x in (("ego", 300.0), ("1", 350.0))
        ]
        pd.testing.assert_frame_equal(verdicts(criteria, begin, rows), verdicts(criteria, 0.0, rows))
