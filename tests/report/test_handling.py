"""The map page and the player are handled alike, in Chromium: wheel, pinch, keys, buttons, and a measured distance."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from browsed import drawn, opened, too_faint
from played import CORNER, drive_of

from resim.recordings import read_recording
from resim.report import write_map_page, write_player_page
from resim.road.opendrive import load

PAGES = ("map.html", "play.html")
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("handled")
    write_map_page(load(ROOT / "networks" / "proving_ground.xodr"), folder / "map.html")
    write_player_page([drive_of(read_recording(CORNER))], folder / "play.html")
    return folder


def across(page: Any) -> float:
    """How many metres 200 px are, as the ruler says."""
    box = page.locator("#map").bounding_box()
    page.keyboard.press("m")
    assert page.get_attribute("#measure", "aria-pressed") == "true"
    x, y = box["x"] + 60, box["y"] + 200
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 200, y, steps=4)
    page.mouse.up()
    drawn(page)
    found = float(page.get_attribute("#stage", "data-measured"))
    page.keyboard.press("Escape")
    assert page.get_attribute("#measure", "aria-pressed") == "false"
    return found


def middle(page: Any) -> tuple[float, float]:
    page.evaluate(
        "() => scrollTo(0, document.getElementById('map').getBoundingClientRect().top + scrollY - 20)"
    )
    box = page.locator("#map").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


@pytest.mark.parametrize("name", PAGES)
def test_keys_and_buttons_zoom_in_and_out(browser: Any, pages: Path, name: str) -> None:
    with opened(browser, pages / name) as page:
        middle(page)
        first = across(page)
        for closer, farther, times in (("+", "-", 1.5), ("=", "-", 1.5)):
            page.keyboard.press(closer)
            assert across(page) == pytest.approx(first / times, rel=0.01)
            page.keyboard.press(farther)
            assert across(page) == pytest.approx(first, rel=0.01)
        page.click("#closer")
        near = across(page)
        assert near < 0.7 * first
        page.click("#farther")
        assert across(page) == pytest.approx(first, rel=0.01)
        page.keyboard.press("+")
        page.keyboard.press("0")
        assert across(page) > 0.99 * first


@pytest.mark.parametrize("name", PAGES)
def test_the_wheel_zooms_about_the_pointer(browser: Any, pages: Path, name: str) -> None:
    with opened(browser, pages / name) as page:
        x, y = middle(page)
        first = across(page)
        page.mouse.move(x, y)
        page.mouse.wheel(0, -300)
        page.wait_for_timeout(100)
        drawn(page)
        assert across(page) == pytest.approx(first * 2.718 ** (-0.0016 * 300), rel=0.02)
        page.mouse.move(x, y)
        page.mouse.wheel(0, 300)
        page.wait_for_timeout(100)
        drawn(page)
        assert across(page) == pytest.approx(first, rel=0.02)


@pytest.mark.parametrize("name", PAGES)
def test_two_fingers_zoom_and_one_moves(browser: Any, pages: Path, name: str) -> None:
    with opened(browser, pages / name) as page:
        x, y = middle(page)
        first, touches = across(page), page.context.new_cdp_session(page)

        def touch(kind: str, *spots: tuple[float, float]) -> None:
            points = [{"x": px, "y": py, "id": k} for k, (px, py) in enumerate(spots)]
            touches.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        touch("touchStart", (x - 40, y), (x + 40, y))
        for far in (50, 60, 70, 80):
            touch("touchMove", (x - far, y), (x + far, y))
        touch("touchEnd")
        page.wait_for_timeout(100)
        assert across(page) == pytest.approx(first / 2, rel=0.1)


def test_two_taps_measure_on_the_map_and_the_details_stay_away(browser: Any, pages: Path) -> None:
    with opened(browser, pages / "map.html", width=400, dark=True) as page:
        page.click("#measure")
        x, y = middle(page)
        page.mouse.click(x - 100, y)
        page.mouse.click(x + 100, y)
        page.wait_for_timeout(60)
        two = float(page.get_attribute("#stage", "data-measured"))
        assert page.locator("#details").is_hidden()
        page.click("#measure")
        assert two == pytest.approx(across(page), rel=0.01)
        assert not too_faint(page)
        assert page.evaluate("() => document.documentElement.scrollWidth") <= 400


def test_the_search_takes_letters_and_signs_of_keys(browser: Any, pages: Path) -> None:
    with opened(browser, pages / "map.html") as page:
        page.click("#wanted")
        page.keyboard.type("m+0")
        assert page.input_value("#wanted") == "m+0"
        assert page.get_attribute("#measure", "aria-pressed") == "false"
