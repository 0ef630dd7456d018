"""Pages that lie in a folder together share one file of scripts; a page that is alone holds its own."""

from __future__ import annotations

import gzip
import re
from base64 import b64encode
from pathlib import Path
from typing import Any

import pytest
from browsed import opened
from played import CORNER, PILOT, drive_of

from resim.jobs.resimulate import resimulate
from resim.recordings import read_recording
from resim.report import write_player_page, write_report, write_shared_scripts
from resim.report.document import SHEET


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a report and a player that share their scripts, and the same report alone."""
    made = tmp_path_factory.mktemp("shared")
    result = resimulate(CORNER, PILOT)
    write_report(result.resimulation, result.assessment, made / "report.html", shared=True)
    write_report(result.resimulation, result.assessment, made / "alone.html")
    write_player_page([drive_of(read_recording(CORNER))], made / "play.html", shared=True)
    write_shared_scripts(made / SHEET)
    return made


def policy(page: Path) -> tuple[str, set[str]]:
    """The policy of a page, and the hashes in it."""
    found = re.search(r'Content-Security-Policy" content="([^"]+)"', page.read_text(encoding="utf-8"))
    assert found is not None
    return found[1], set(re.findall(r"'sha256-([^']+)'", found[1]))


def test_the_file_holds_what_the_pages_run_and_they_hold_it_no_more(folder: Path) -> None:
    held = set(re.findall(r'data-script="([^"]+)"', (folder / SHEET).read_text(encoding="utf-8")))
    for name in ("report.html", "play.html"):
        told, hashes = policy(folder / name)
        taken = set(
            re.findall(r'<i hidden data-script="([^"]+)"', (folder / name).read_text(encoding="utf-8"))
        )
        assert taken <= held
        assert len(hashes - taken) == 1  # what unpacks them
        assert "unsafe" not in told.partition("style-src")[0]
    sizes = {path.name: path.stat().st_size for path in folder.iterdir()}
    assert sizes["alone.html"] - sizes["report.html"] > 700_000
    assert sizes["play.html"] < 60_000
    assert SHEET not in (folder / "alone.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("dark", [False, True])
def test_the_report_draws_and_plays_from_disk(browser: Any, folder: Path, dark: bool) -> None:
    with opened(browser, folder / "report.html", dark=dark) as page:
        assert page.locator(".plot svg").count() > 0
        page.click("#play")
        page.wait_for_timeout(500)
        page.click("#play")
        assert float(page.get_attribute("#player", "data-t")) > 0.1


def test_the_player_page_plays_from_disk(browser: Any, folder: Path) -> None:
    with opened(browser, folder / "play.html", width=400) as page:
        page.wait_for_selector("#player[data-t]")
        page.keyboard.press("End")
        page.locator("#player[data-t='9.200']").wait_for(state="attached")


def complaints(browser: Any, page: Path) -> tuple[list[str], str, str]:
    """What a page complains of, its title, and its text."""
    tab, told = browser.new_page(), list[str]()
    tab.on("console", lambda message: told.append(message.text))
    tab.goto(page.as_uri())
    tab.wait_for_timeout(400)
    found = told, tab.title(), tab.inner_text("body")
    tab.close()
    return found


def test_a_page_without_its_file_says_what_it_needs(browser: Any, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "play.html").write_bytes((folder / "play.html").read_bytes())
    told, _, shown = complaints(browser, tmp_path / "play.html")
    assert any("ERR_FILE_NOT_FOUND" in one for one in told)
    assert "need the file scripts.css" in shown


def test_a_changed_file_runs_nothing(browser: Any, folder: Path, tmp_path: Path) -> None:
    """Another script by the name of ours does not have the hash of the page's policy."""
    (tmp_path / "play.html").write_bytes((folder / "play.html").read_bytes())
    sheet = (folder / SHEET).read_text(encoding="utf-8")
    evil = b64encode(gzip.compress(b"document.title = 'broken'")).decode()
    changed = re.sub(r'\{--script:"[^"]+"', f'{{--script:"{evil}"', sheet)
    (tmp_path / SHEET).write_text(changed, encoding="utf-8")
    told, title, _ = complaints(browser, tmp_path / "play.html")
    assert any("Content Security Policy" in one for one in told)
    assert title == "cut_in_brake · player"
