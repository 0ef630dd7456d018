"""Pages as Chromium shows them, and what may be wrong with them: complaints, loads, contrast, width."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")

CONTRASTS = """() => {
  const linear = v => (v /= 255, v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  const light = c => 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]);
  const numbers = text => text.match(/[\\d.]+/g).map(Number);
  const parts = text => [...numbers(text), 1].slice(0, 4);
  const over = (a, b) => [0, 1, 2].map(k => a[3] * a[k] + (1 - a[3]) * b[k]);
  const paper = parts(getComputedStyle(document.body).backgroundColor);
  function ground(element) {
    const layers = [];
    for (let e = element; e; e = e.parentElement) layers.push(parts(getComputedStyle(e).backgroundColor));
    return layers.reverse().reduce((below, layer) => over(layer, below), paper);
  }
  const found = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walk.nextNode(); node; node = walk.nextNode()) {
    const element = node.parentElement, shown = getComputedStyle(element);
    const seen = element.checkVisibility({ opacityProperty: true, visibilityProperty: true });
    if (!seen || !node.textContent.trim()) continue;
    if (element.closest("script, style, noscript, select, option")) continue;
    const svg = element.closest("svg"), color = parts(svg ? shown.fill : shown.color);
    if (svg && element.closest(".hoverlayer")) continue;
    if (svg) color[3] *= Number(shown.fillOpacity);
    const below = ground(svg ? svg.parentElement : element), on = over(color, below);
    const [low, high] = [light(on), light(below)].sort((a, b) => a - b), ratio = (high + 0.05) / (low + 0.05);
    const words = node.textContent.trim().slice(0, 40);
    if (ratio < 4.5) found.push(`${ratio.toFixed(2)} ${shown.color} ${element.tagName} ${words}`);
  }
  return [...new Set(found)];
}"""
"""Texts of a page whose contrast with what is behind them is under 4.5 (WCAG 2.2, 1.4.3)."""


@contextmanager
def chromium() -> Iterator[Any]:
    """Give a browser; skips the test where there is none."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("there is no chromium on the path")
    with sync_api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


def drawn(page: Any) -> None:
    """Wait until a page has drawn what it was told, however busy the machine is."""
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


@contextmanager
def opened(
    browser: Any, path: Path, *, width: int = 1240, height: int = 900, dark: bool = False, before: str = ""
) -> Iterator[Any]:
    """Open a page with its figures drawn; fails at the end where it complained, or wanted anything from elsewhere.

    before: a script that runs before those of the page.
    """
    faults: list[str] = []
    context = browser.new_context(
        viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light"
    )
    page = context.new_page()
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda message: faults.append(message.text))
    page.on("request", lambda r: r.url.startswith(("file:", "data:", "blob:")) or faults.append(r.url))
    if before:
        page.add_init_script(before)
    page.goto(path.as_uri())
    if page.locator(".plot").count() and not before:
        page.wait_for_selector("html[data-figures=drawn]", timeout=60_000)
    yield page
    context.close()
    assert not faults


def too_faint(page: Any) -> list[str]:
    """Give the texts of a page that are hard to read on what is behind them; all that is folded is opened."""
    page.evaluate("() => document.querySelectorAll('details').forEach(d => { d.open = true; })")
    found: list[str] = page.evaluate(CONTRASTS)
    return found
