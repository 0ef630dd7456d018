"""Figures of a recording whose clock counts from 1970: times from the start on, and where that is."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hostile import figures_of
from lxml import html

from resim.perception.model import read_model
from resim.recordings import read_recording
from resim.report import write_assessment_page, write_report
from resim.report.plots import compact
from resim.resimulation import (
    AssessmentOptions,
    PerceptionSetup,
    ResimulationOptions,
    assess_recording,
    assess_resimulation,
    resimulate,
)
from resim.simulation.function.interface import load_build
from resim.verification.page.axes import Axes

ROOT = Path(__file__).parents[2]
UNIX = 1_700_000_000.0


def times(text: str) -> list[tuple[float, float, int]]:
    """Least, largest and number of distinct x of every line of a page that lies over time."""
    out = []
    for figure in figures_of(html.fromstring(text)):
        data, axes = figure["data"], figure["layout"]
        over_time = {
            name
            for name, axis in axes.items()
            if name.startswith("xaxis") and "t [s]" in str(axis.get("title"))
        }
        for trace in data:
            axis = "xaxis" + trace.get("xaxis", "x")[1:]
            shared = axes.get(axis, {}).get("matches", "")
            if axis in over_time or (shared and "xaxis" + shared[1:] in over_time):
                x = numbers(trace.get("x"))
                if len(x) > 1 and trace["mode"] == "lines":
                    out.append((float(np.nanmin(x)), float(np.nanmax(x)), len(np.unique(x[np.isfinite(x)]))))
    return out


def numbers(x: object) -> np.ndarray:
    if isinstance(x, dict):
        return np.frombuffer(base64.b64decode(x["bdata"]), dtype=np.dtype(x["dtype"])).astype(float)
    return np.array([np.nan if v is None else v for v in x or []], dtype=float)


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("pages")
    before = read_recording(ROOT / "scenarios" / "rear_end")
    plan = (
        None
        if before.plan is None
        else before.plan.assign(t=before.plan["t"] + UNIX, t_plan=before.plan["t_plan"] + UNIX)
    )
    assert before.sd is not None
    recording = replace(before, gt=before.gt.shifted(UNIX), sd=before.sd.shifted(UNIX), plan=plan)
    build = load_build(ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml")
    model = read_model(ROOT / "adfunc" / "perception" / "none.json")
    result = resimulate(recording, build, ResimulationOptions(), perceiving=PerceptionSetup(model, (0, 1)))
    write_report(result, assess_resimulation(result, AssessmentOptions()), folder / "run.html")
    write_assessment_page(assess_recording(recording, AssessmentOptions()), folder / "assessment.html")
    return {name: (folder / f"{name}.html").read_text(encoding="utf-8") for name in ("run", "assessment")}


@pytest.mark.parametrize("name", ["run", "assessment"])
def test_charts_of_unix_times_count_from_the_start(pages: dict[str, str], name: str) -> None:
    found = times(pages[name])
    assert len(found) > {"run": 20, "assessment": 5}[name]
    for low, high, distinct in found:
        assert low > -0.1
        assert high < 5.0
        assert distinct > 1
    assert max(distinct for *_, distinct in found) > 40
    assert "t [s] from 1700000000.00 s on" in str(figures_of(html.fromstring(pages[name])))


def test_small_figures_have_times_from_the_start() -> None:
    text = Axes((UNIX, UNIX + 10.0), (0.0, 1.0), "v").svg("", "")
    assert "from 1700000000.00 s on" in text
    assert [float(t) for t in re.findall(r'<text x="[\d.]+" y="210">([^<]*)</text>', text)] == [
        0.0,
        2.0,
        4.0,
        6.0,
        8.0,
        10.0,
    ]


def test_compact_keeps_what_32_bits_would_lose() -> None:
    near, far = np.linspace(0.0, 10.0, 251), 5_400_000.0 + np.linspace(0.0, 10.0, 251)
    assert compact(near).dtype == np.float32
    assert np.abs(compact(far).astype(float) - far).max() < 1e-6
