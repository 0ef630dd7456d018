"""Every recording of a verification has a page that plays it, the good ones too."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from browsed import chromium, opened
from lxml import html

from resim.core.spec import to_json
from resim.report import SHEET
from resim.verification.execution import verify
from resim.verification.folder import begin, write
from resim.verification.request import VerifyOptions, make_request
from resim.verification.suite import read_suite

ROOT = Path(__file__).parents[2]
BUILDS = ROOT / "adfunc" / "builds"
REPLAY, PILOT, BLIND = (
    BUILDS / f"{name}-1.0.toml" for name in ("replay", "highway_pilot", "constant_velocity")
)
SUITE = """name = "drives"
criteria = "{root}/scenarios/criteria/highway.toml"
bases = ["GT"]
driven_by = ["constant_velocity-1.0", "highway_pilot-1.0"]
recording = [{folders}]
"""


def verified(folder: Path, build: Path, *names: str, against: Path | None = None) -> dict[str, Any]:
    """Verify drives that ship into `folder`/out; gives verification.json by recording."""
    told = ", ".join(f'{{folder = "{ROOT}/scenarios/{name}"}}' for name in names)
    (folder / "suite.toml").write_text(SUITE.format(root=ROOT, folders=told), encoding="utf-8")
    out = folder / "out"
    out.mkdir(exist_ok=True)
    wanted = make_request(read_suite(folder / "suite.toml"), build, against, VerifyOptions(), out)
    begin(out, wanted)
    kept: list[str] = []
    found, traces = verify(
        wanted, out, out, workers=1, tell=lambda name, _, old: kept.append(name) if old else None
    )
    write(out, found, traces)
    return {"kept": kept, **{r["name"]: r for r in json.loads(json.dumps(to_json(found)))["recordings"]}}


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drives")
    found = verified(folder, REPLAY, "rear_end", "overtake")
    assert {found[name]["verdict"] for name in ("rear_end", "overtake")} == {"verified"}
    return folder


def links(out: Path, name: str) -> dict[str, str]:
    """The links of a recording's part of the page, by their words."""
    page = html.parse(str(out / "verification.html"))
    (part,) = page.xpath(f"//details[@id='r-{name}']")
    return {link.text: link.get("href") for link in part.iter("a")}


def test_each_verified_recording_leads_to_its_drive_which_is_small(suite: Path) -> None:
    out = suite / "out"
    for name in ("rear_end", "overtake"):
        assert links(out, name) == {"Play the drive": f"drives/{name}.html"}
        assert 10_000 < (out / "drives" / f"{name}.html").stat().st_size < 200_000
    assert (out / "drives" / SHEET).stat().st_size < 100_000  # no library of plots
    assert not (out / "reports" / SHEET).exists()  # there is no report


def test_the_drive_plays_measured_and_simulated_from_disk(suite: Path) -> None:
    with chromium() as browser, opened(browser, suite / "out" / "verification.html", width=400) as page:
        page.evaluate("() => document.querySelectorAll('details').forEach(d => { d.open = true; })")
        page.click("#r-rear_end a")
        page.wait_for_selector("#player[data-t]")
        names = [text.strip() for text in page.locator("#layers button").all_inner_texts()]
        assert names[:3] == ["GT", "SD", "rGT"]
        page.keyboard.press("End")
        page.wait_for_timeout(150)
        assert float(page.get_attribute("#player", "data-t")) > 1.0


def test_a_drive_that_is_gone_is_made_again_and_the_others_are_kept(suite: Path) -> None:
    page = suite / "out" / "drives" / "rear_end.html"
    before = page.read_bytes()
    page.unlink()
    assert verified(suite, REPLAY, "rear_end", "overtake")["kept"] == ["overtake"]
    assert page.read_bytes() == before


def test_scripts_of_another_resim_beside_a_single_drive_are_replaced(tmp_path: Path) -> None:
    verified(tmp_path, REPLAY, "rear_end", "overtake")
    sheet = tmp_path / "out" / "drives" / SHEET
    scripts = sheet.read_bytes()
    sheet.write_text("/* of another resim */", encoding="utf-8")
    verified(tmp_path, REPLAY, "rear_end")
    assert sheet.read_bytes() == scripts


@pytest.mark.slow
def test_a_single_drive_stands_alone_and_builds_are_played_one_after_the_other(tmp_path: Path) -> None:
    found = verified(tmp_path, BLIND, "rear_end", against=PILOT)
    out = tmp_path / "out"
    assert found["rear_end"]["drive"] == "drives/rear_end.html"
    assert [path.name for path in (out / "drives").iterdir()] == ["rear_end.html"]
    assert SHEET in {path.name for path in (out / "reports").iterdir()}  # of both builds
    with chromium() as browser, opened(browser, out / "drives" / "rear_end.html") as page:
        drives = page.locator("#drive option").all_inner_texts()
        assert drives == ["rear_end · constant_velocity-1.0", "rear_end · highway_pilot-1.0"]
    with chromium() as browser, opened(browser, out / found["rear_end"]["reports"][0]) as page:
        assert page.locator(".plot svg").count() > 0
