"""The pages in Chromium: on a phone and a wide screen, by day and by night, on paper, and without what they need."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsed import opened, too_faint
from conftest import ROOT
from PIL import Image
from swept import THREE, write_adaptive, write_swept

from resim.jobs.assess import assess
from resim.jobs.play import play
from resim.jobs.resimulate import resimulate
from resim.perception.model import read_model
from resim.perception.validation import judge
from resim.recordings import read_recording
from resim.report import write_map_page
from resim.report.document import document
from resim.report.figure import Figure, trace
from resim.report.markup import html, join
from resim.report.perception import write_perception_page
from resim.report.plots import line, style, to_html
from resim.report.tables import table
from resim.road.opendrive import RoadNetwork
from resim.road.sumo import SumoNet
from resim.sweeps.analysis import analyse
from resim.sweeps.page import write_sweep_page
from resim.sweeps.result import read_swept
from resim.verification.execution import verify
from resim.verification.page import write_verification_page
from resim.verification.request import VerifyOptions, make_request
from resim.verification.suite import read_suite

CORNER = ROOT / "scenarios" / "cut_in_brake"
PILOT = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
MODEL = ROOT / "adfunc" / "perception" / "proving_ground.json"
HIGHWAY = ROOT / "scenarios" / "criteria" / "highway.toml"
SUITE = """name = "look"
criteria = "{root}/scenarios/criteria/highway.toml"
agreement = 0.5
recording = [{{folder = "{root}/scenarios/cut_in_brake"}}, {{folder = "{root}/scenarios/overtake"}}]
"""
NAMES = ("run", "assessment", "sweep", "adaptive", "verification", "perception", "map", "player")
LARGEST = 2_000_000
"""Bytes of a page with figures of the shipped drives."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory, network: RoadNetwork, net: SumoNet) -> dict[str, Path]:
    """A page of every kind, of what ships."""
    folder = tmp_path_factory.mktemp("look")
    found = {name: folder / f"{name}.html" for name in NAMES}
    resimulate(CORNER, PILOT, criteria=HIGHWAY).write(folder / "run")
    found["run"] = folder / "run" / "report.html"
    assess(ROOT / "scenarios" / "rear_end", criteria=HIGHWAY).write(folder / "assessed")
    found["assessment"] = folder / "assessed" / "assessment.html"
    write_swept(folder / "swept", THREE)
    write_sweep_page(analyse(read_swept(folder / "swept"), "swept"), found["sweep"])
    wide = tuple(p.model_copy(update={"width": w}) for p, w in zip(THREE, (0.1, 1.0, 1.0), strict=True))
    write_adaptive(folder / "grown", wide[:2])
    write_sweep_page(analyse(read_swept(folder / "grown"), "grown"), found["adaptive"])
    (folder / "suite.toml").write_text(SUITE.format(root=ROOT), encoding="utf-8")
    request = make_request(
        read_suite(folder / "suite.toml"), PILOT, None, VerifyOptions(perception=MODEL, seeds=5), folder / "v"
    )
    write_verification_page(*verify(request, folder / "v", folder / "v", workers=1), found["verification"])
    drives = [read_recording(ROOT / "scenarios" / name) for name in ("cut_in_brake", "overtake")]
    model = read_model(MODEL)
    write_perception_page(model, judge(model, drives, seeds=1), found["perception"])
    write_map_page(network, found["map"], conversion=net.conversion, flaws=[])
    play([folder / "run"], found["player"])
    return found


@pytest.mark.parametrize("name", NAMES)
def test_pages_are_small(pages: dict[str, Path], name: str) -> None:
    assert pages[name].stat().st_size < LARGEST


@pytest.mark.parametrize(
    ("name", "dark"),
    [
        pytest.param(name, dark, marks=[pytest.mark.slow] if k % 2 == dark else [])
        for k, name in enumerate(NAMES)
        for dark in (False, True)
    ],
)
def test_texts_are_legible_and_nothing_is_wider_than_a_phone(
    browser: Any, pages: dict[str, Path], name: str, dark: bool
) -> None:
    with opened(browser, pages[name], width=400, dark=dark) as page:
        assert too_faint(page) == []
        assert page.evaluate("() => document.documentElement.scrollWidth") <= 400
        ground = page.evaluate("() => getComputedStyle(document.body).backgroundColor")
        assert (max(_numbers(ground)) < 60) if dark else (min(_numbers(ground)) > 240)


def test_what_is_too_faint_is_found(browser: Any, tmp_path: Path) -> None:
    figure = style(Figure([trace("scatter", y=[0.0, 1.0])]), 200.0)
    figure.add_annotation(
        text="drawn faintly", x=0.0, y=1.0, showarrow=False, font={"color": "rgba(29,39,51,.3)"}
    )
    body = html(
        '<main><p style="color:#999">written faintly</p><p style="background:#777">on grey</p>{}</main>',
        to_html(figure, "f"),
    )
    (tmp_path / "page.html").write_text(document("faint", body), encoding="utf-8")
    with opened(browser, tmp_path / "page.html") as page:
        found = too_faint(page)
    assert [next(t for t in ("written", "on grey", "drawn") if t in one) for one in found] == [
        "written",
        "on grey",
        "drawn",
    ]


def _numbers(color: str) -> list[float]:
    return [float(part) for part in color[color.index("(") + 1 : -1].split(",")[:3]]


def _grounds(page: Any) -> list[float]:
    """How light the ground of each figure is, 0 to 255."""
    found = page.evaluate("""() => [...document.querySelectorAll(".plot .main-svg")]
      .map(svg => getComputedStyle(svg).backgroundColor).filter(color => !color.endsWith(", 0)"))""")
    return [sum(_numbers(color)) / 3.0 for color in found]


@pytest.mark.slow
def test_figures_follow_the_scheme_and_paper_is_light(browser: Any, pages: dict[str, Path]) -> None:
    with opened(browser, pages["run"], dark=True) as page:
        assert page.locator(".plot svg.main-svg").count() > 10
        assert max(_grounds(page)) < 60
        page.emulate_media(color_scheme="light")
        page.wait_for_timeout(1500)
        assert min(_grounds(page)) == 255
        page.emulate_media(color_scheme="dark")
        page.wait_for_timeout(1500)
        assert max(_grounds(page)) < 60
        page.evaluate("() => dispatchEvent(new Event('beforeprint'))")
        assert min(_grounds(page)) == 255
        page.emulate_media(media="print")
        assert page.evaluate("() => getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"


@pytest.mark.slow
def test_the_player_in_a_page_and_the_map_follow_the_scheme_and_paper_is_light(
    browser: Any, pages: dict[str, Path]
) -> None:
    for name in ("assessment", "map", "player"):
        with opened(browser, pages[name], dark=True) as page:
            assert _canvas(page) < 100, name
            page.emulate_media(color_scheme="light")
            page.wait_for_timeout(300)
            assert _canvas(page) > 180, name
            page.emulate_media(color_scheme="dark")
            page.wait_for_timeout(300)
            page.evaluate("() => dispatchEvent(new Event('beforeprint'))")
            assert _canvas(page) > 180, name
            page.evaluate("() => dispatchEvent(new Event('afterprint'))")
            assert _canvas(page) < 100, name


def _canvas(page: Any) -> float:
    """How light the ground of the picture from above is, 0 to 255: along its top."""
    picture = Image.open(BytesIO(page.locator("#map").screenshot())).convert("L")
    return float(np.median(np.asarray(picture)[2:6]))


@pytest.mark.slow
def test_a_figure_that_was_folded_has_its_width_once_it_is_open(browser: Any, tmp_path: Path) -> None:
    write_swept(tmp_path / "swept", sections=(("cut_in", "pilot-1.0"), ("cut_in", "pilot-1.1")))
    write_sweep_page(analyse(read_swept(tmp_path / "swept"), "swept"), tmp_path / "page.html")
    with opened(browser, tmp_path / "page.html", dark=True) as page:
        page.evaluate("() => { document.getElementById('s-0').open = false; }")
        page.emulate_media(color_scheme="light")
        page.wait_for_timeout(1500)
        for part in ("s-0", "s-1"):
            page.evaluate(f"() => {{ document.getElementById('{part}').open = true; }}")
            page.wait_for_timeout(1000)
            figure = page.locator(f"#{part} figure").first.bounding_box()
            drawn = page.locator(f"#{part} figure .main-svg").first.bounding_box()
            assert drawn["width"] == pytest.approx(figure["width"], abs=2.0)


SCALE = [[0.0, "#a1260d"], [1.0, "#0072b2"]]
KINDS = (
    trace("scatter", x=[0.0, 1.0], y=[1.0, 2.0], mode="lines+markers", line={"color": "#1d2733"}),
    line(np.array([0.0, 1.0, np.nan, 3.0]), np.arange(4.0), color="#0072B2", name="line", hover="%{x}"),
    trace("box", x=["S"], q1=[1.0], median=[2.0], q3=[3.0], lowerfence=[0.0], upperfence=[4.0], mean=[2.0], sd=[1.0]),
    trace("heatmap", z=np.arange(6.0).reshape(2, 3), colorscale=SCALE),
    trace("contour", z=np.arange(6.0).reshape(2, 3), contours={"start": 2.0, "end": 2.0, "size": 1.0}),
    trace("scatter", x=[0.0], y=[0.0], mode="markers", marker={"color": np.array([0.5]), "colorscale": SCALE}),
)  # fmt: skip


@pytest.fixture
def drawn(tmp_path: Path) -> Path:
    """A page with a figure of each kind of trace."""
    figures = join(to_html(style(Figure([one]), 200.0), f"kind-{k}") for k, one in enumerate(KINDS))
    path = tmp_path / "kinds.html"
    path.write_text(document("kinds", html("<main>{}</main>", figures)), encoding="utf-8")
    return path


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_each_kind_of_trace_is_drawn(browser: Any, drawn: Path, dark: bool) -> None:
    with opened(browser, drawn, dark=dark) as page:
        marks = "path.js-line, path.box, .heatmaplayer image, .contourlayer path, path.point"
        for k in range(len(KINDS)):
            assert page.locator(f"#kind-{k}").locator(marks).count() > 0, KINDS[k]["type"]


def test_a_browser_that_cannot_unpack_says_so_in_place_of_each_figure(browser: Any, drawn: Path) -> None:
    with opened(browser, drawn, before="delete window.DecompressionStream;") as page:
        page.wait_for_selector(".plot p")
        told = page.locator(".plot").all_inner_texts()
        assert len(told) == len(KINDS)
        assert all("could not unpack" in text for text in told)


def test_a_table_that_does_not_fit_says_so_until_its_end(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "table.html"
    wide = table([f"column {k}" for k in range(10)], [[f"value {k}" for k in range(10)]], "numbers")
    narrow = table(["a", "b"], [["1", "2"]])
    body = html("<main><h2>Errors</h2>{}<h2>Few</h2>{}</main>", wide, narrow)
    path.write_text(document("tables", body, plots=False), encoding="utf-8")
    with opened(browser, path, width=400) as page:
        hints = page.get_by_text("more columns to the right →")
        assert [hints.nth(k).is_visible() for k in range(2)] == [True, False]
        box = page.get_by_role("region", name="Table, scrolls sideways: Errors")
        box.focus()
        before = page.evaluate("() => document.querySelector('.wide').scrollLeft")
        page.keyboard.press("ArrowRight")
        page.wait_for_timeout(300)
        assert page.evaluate("() => document.querySelector('.wide').scrollLeft") > before
        page.evaluate("() => { document.querySelector('.wide').scrollLeft = 1e6; }")
        page.wait_for_timeout(300)
        assert not hints.nth(0).is_visible()
        page.evaluate("() => { document.querySelector('.wide').scrollLeft = 0; }")
        page.wait_for_timeout(300)
        assert hints.nth(0).is_visible()
        page.set_viewport_size({"width": 3000, "height": 900})
        page.wait_for_timeout(300)
        assert not hints.nth(0).is_visible()
        assert page.locator(".wide[tabindex]").count() == 0
