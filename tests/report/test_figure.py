"""Figures as plotly.js reads them: what plotly makes of the same calls is the oracle."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plotly import graph_objects as go
from plotly.subplots import make_subplots
from swept import BIAS, LATENCY, THREE, write_adaptive, write_swept

from resim.metrics.criteria import read_criteria
from resim.perception.model import read_model
from resim.perception.validation import judge
from resim.recordings import read_recording
from resim.report import error_boxes, model_runs, perception, reaction_figure, road, steps
from resim.report.assessment import figures as assessed_figures
from resim.report.figure import PLAIN, Figure, trace
from resim.report.view import View, view
from resim.resimulation import AssessmentOptions, PerceptionSetup, assess_resimulation, resimulate
from resim.simulation.function.interface import load_build
from resim.sweeps.analysis import analyse
from resim.sweeps.page import boundary as boundary_page
from resim.sweeps.page import figures as sweep_figures
from resim.sweeps.result import read_swept

ROOT = Path(__file__).parents[2]
MODEL = ROOT / "adfunc" / "perception" / "proving_ground.json"
HIGHWAY = ROOT / "scenarios" / "criteria" / "highway.toml"


class Plotly(go.Figure):
    """Plotly's figure with our name of `make_subplots`."""

    @classmethod
    def of_panels(cls, rows: int, cols: int, **how: Any) -> go.Figure:
        known = {name: value for name, value in how.items() if value not in ((), None)}
        known = {name: value for name, value in known.items() if not name.endswith("spacing") or value}
        return make_subplots(
            rows=rows, cols=cols, **{"horizontal_spacing": 0.0, "vertical_spacing": 0.0, **known}
        )


def ours(figure: Any) -> Any:
    """What a page holds of a figure."""
    found = json.loads(json.dumps(figure.to_dict(), allow_nan=False))
    assert found["layout"].pop("template", PLAIN) == PLAIN
    return found


def theirs(figure: go.Figure) -> Any:
    """What plotly says of a figure, without the look that it gives to every figure."""
    found = json.loads(figure.to_json())
    found["layout"].pop("template", None)
    return found


def both(make: Callable[[Any], Any]) -> tuple[Any, Any]:
    """The same calls, ours and plotly's."""
    return ours(make(Figure)), theirs(make(Plotly))


ARRAYS: dict[str, Any] = {
    "empty": np.empty(0), "floats": np.linspace(-1.0, 1.0, 5),
    "short floats": np.linspace(0.0, 1.0, 4, dtype=np.float32),
    "nan": np.array([1.0, np.nan, -np.inf, 3.0]), "nan list": [1.0, float("nan"), 3.0], "list": [1, 2.5, 3],
    "empty list": [], "small ints": np.array([1, -2, 3]), "ints": np.array([1, 70_000, 3]),
    "middle ints": np.array([1, -30_000]), "large ints": np.array([1, 2**40]),
    "unsigned": np.array([1, 200], dtype=np.uint8),
    "strings": ["S", "FIT"], "string array": np.array(["S", "FIT"]), "tuple": (1.0, 2.0),
    "short ints": np.array([3, 4], dtype=np.int16),
}  # fmt: skip


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_are_packed_as_plotly_packs_them(name: str) -> None:
    values = ARRAYS[name]
    ours, theirs = both(lambda f: f([trace("scatter", x=values, y=values, customdata=values)]))
    assert ours["data"] == theirs["data"]


@pytest.mark.parametrize("shape", [(2, 3), (3, 2, 2), (1, 1), (0, 3)])
def test_arrays_of_more_than_one_dimension(shape: tuple[int, ...]) -> None:
    values = np.arange(float(np.prod(shape))).reshape(shape)
    values = np.where(values == 2.0, np.nan, values)
    z = values if values.ndim == 2 else values[..., 0]
    ours, theirs = both(
        lambda f: f([trace("heatmap", z=z, customdata=values, colorscale=[[0.0, "#fff"], [1.0, "red"]])])
    )
    assert ours["data"] == theirs["data"]


@settings(max_examples=40, deadline=None)
@given(
    rows=st.integers(1, 4), cols=st.integers(1, 4), across=st.floats(0.0, 0.2), up=st.floats(0.0, 0.2),
    x=st.booleans(), y=st.booleans(), titled=st.booleans(), data=st.data(),
)  # fmt: skip
def test_panels_lie_where_plotly_lays_them(
    rows: int, cols: int, across: float, up: float, x: bool, y: bool, titled: bool, data: st.DataObject
) -> None:
    def sizes(count: int) -> list[float] | None:
        return data.draw(st.none() | st.lists(st.floats(0.1, 9.0), min_size=count, max_size=count))

    titles = [f"title {k}" for k in range(rows * cols)] if titled else ()
    how = {
        "row_heights": sizes(rows), "column_widths": sizes(cols), "horizontal_spacing": across, "vertical_spacing": up,
        "shared_xaxes": x, "shared_yaxes": y, "subplot_titles": titles,
    }  # fmt: skip

    def make(f: Any) -> Any:
        figure = f.of_panels(rows, cols, **how)
        figure.add_trace(trace("scatter", y=[1.0]), row=rows, col=cols)
        return figure

    ours, theirs = both(make)
    assert ours["data"] == theirs["data"]
    assert _rounded(ours["layout"]) == _rounded(theirs["layout"])


def _rounded(part: Any) -> Any:
    """Without the last bits of a sum, which depends on its order."""
    if isinstance(part, dict):
        return {key: _rounded(value) for key, value in part.items()}
    if isinstance(part, list):
        return [_rounded(value) for value in part]
    return round(part, 12) if isinstance(part, float) else part


def _lines(f: Any) -> Any:
    figure = f.of_panels(2, 2, shared_xaxes=True, vertical_spacing=0.1, horizontal_spacing=0.1)
    figure.add_trace(trace("scatter", x=[0.0, 1.0], y=[1.0, 2.0], name="a"), row=1, col=1)
    figure.add_trace(trace("box", x=["a"], q1=[1.0], median=[2.0], q3=[3.0]), row=2, col=2)
    figure.add_vline(x=0.5, line={"color": "red", "width": 1}, row=1, col=1)
    figure.add_hline(y=1.5, line={"dash": "dot"}, row=2, col=2)
    figure.add_vline(x=0.5, row=1, col=2)  # the panel is empty
    figure.add_shape(
        type="line", xref="x", yref="paper", x0=1.0, x1=1.0, y0=0.0, y1=1.0, line={"color": "blue"}
    )
    return figure


def _texts(f: Any) -> Any:
    figure = f.of_panels(1, 2, subplot_titles=["one", "two"], horizontal_spacing=0.1)
    figure.add_trace(trace("scatter", y=[1.0]), row=1, col=2)
    figure.add_annotation(
        text="<b>free</b>", x=0.0, y=1.0, xref="paper", yref="paper", font={"size": 9}, showarrow=False
    )
    figure.add_annotation(text="in", x=0.0, y=1.0, xref="x domain", yref="y domain", row=1, col=2)
    figure.add_annotation(text="at", x=0.3, y=1.0, yref="y domain", row=1, col=1)
    figure.update_annotations(xanchor="left", font={"size": 12})
    return figure


def _axes(f: Any) -> Any:
    figure = f.of_panels(2, 2, horizontal_spacing=0.1, vertical_spacing=0.1)
    figure.update_xaxes(title_text="x", title={"standoff": 4}, range=[0.0, 1.0])
    figure.update_xaxes(title_text="bottom", row=2)
    figure.update_yaxes(showgrid=False, tickvals=[0.0, 1.0], row=1, col=2)
    figure.update_yaxes(autorangeoptions={"minallowed": 0.0, "include": [0.0, 0.01]}, col=1)
    figure.update_yaxes(autorangeoptions_include=[-1.0, 1.0], row=1, col=1)
    figure.update_yaxes(ticksuffix=None, type="log")
    figure.update_layout(height=300, margin={"l": 1}, legend={"x": 0.5})
    figure.update_layout(margin={"r": 2}, boxmode="group")
    return figure


@pytest.mark.parametrize("make", [_lines, _texts, _axes])
def test_methods_mean_what_plotly_means(make: Callable[[Any], Any]) -> None:
    ours, theirs = both(make)
    assert ours == theirs


@pytest.fixture(scope="module")
def look() -> View:
    """A run with sensor data, a perception model and criteria: every figure of the report is there."""
    seen = PerceptionSetup(read_model(MODEL), (0, 1))
    build = load_build(ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml")
    result = resimulate(read_recording(ROOT / "scenarios" / "cut_in_brake"), build, perceiving=seen)
    return view(result, assess_resimulation(result, AssessmentOptions(criteria=read_criteria(HIGHWAY))))


def _of_the_report(look: View) -> Iterator[tuple[str, Any]]:
    yield "boxes", error_boxes.box_figure(look)
    yield "reaction", reaction_figure.reaction_figure(look)
    yield "seeds", model_runs.drive_figure(look)
    yield "plan", road.plan_figure(look)
    yield "lateral", road.lateral_figure(look)
    yield "distance", road.distance_figure(look)
    yield from ((f"step {band.step}", steps.band_figure(look, band)) for band in steps.BANDS)
    yield "risk", assessed_figures.risk_figure(look.assessed)
    for name, block in look.assessed.blocks.items():
        yield f"scenes {name}", assessed_figures.drive_figure(block, look.assessed.network, "#0072B2")


def test_the_figures_of_a_report_are_as_plotly_makes_them(
    look: View, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = {name: ours(figure) for name, figure in _of_the_report(look)}
    for module in (error_boxes, reaction_figure, model_runs, road, steps, assessed_figures):
        monkeypatch.setattr(module, "Figure", Plotly)
    for name, figure in _of_the_report(look):
        assert _rounded(mine.pop(name)) == _rounded(theirs(figure)), name
    assert not mine


@pytest.mark.slow
def test_the_figures_of_a_perception_model_are_as_plotly_makes_them(monkeypatch: pytest.MonkeyPatch) -> None:
    drives = [read_recording(ROOT / "scenarios" / name) for name in ("cut_in_brake", "overtake")]
    found = dataclasses.replace(judge(read_model(MODEL), drives, seeds=1), dropouts_measured=(0.2, 0.4))
    makers = (perception._distributions, perception._autocorrelations, perception._dropout_figure)
    mine = [ours(make(found)) for make in makers]
    monkeypatch.setattr(perception, "Figure", Plotly)
    for one, make in zip(mine, makers, strict=True):
        assert _rounded(one) == _rounded(theirs(make(found)))


def _of_a_sweep(spread: Any, grown: Any) -> Iterator[Any]:
    (section,) = spread.sections
    for outcome in section.varying():
        yield sweep_figures.response_figure([outcome], spread.parameters[0])
        if outcome.share:
            yield sweep_figures.map_figure(outcome, outcome.map, spread.parameters)
    (section,) = grown.sections
    for pair in ((0, 1), (0, 0)):
        yield boundary_page._figure(section.boundary, grown.parameters, *pair)


def test_the_figures_of_a_sweep_are_as_plotly_makes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_swept(tmp_path / "spread", THREE)
    fine = (LATENCY.model_copy(update={"width": 0.1}), BIAS.model_copy(update={"width": 0.5}))
    write_adaptive(tmp_path / "grown", fine)
    found = [analyse(read_swept(tmp_path / name), name) for name in ("spread", "grown")]
    mine = [ours(figure) for figure in _of_a_sweep(*found)]
    for module in (sweep_figures, boundary_page):
        monkeypatch.setattr(module, "Figure", Plotly)
    every = [theirs(figure) for figure in _of_a_sweep(*found)]
    assert {one["type"] for figure in every for one in figure["data"]} == {"scatter", "heatmap", "contour"}
    assert [_rounded(one) for one in mine] == [_rounded(one) for one in every]
