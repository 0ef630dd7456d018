"""What an id, a name or a unit brings into a page is text there: its policy lets the page's own scripts run alone."""

from __future__ import annotations

import re
from base64 import b64encode
from hashlib import sha256

from lxml import html
from plotly import graph_objects as go

from resim.report.document import document
from resim.report.plots import to_html

HOSTILE = "</script><script>alert(1)</script>\"'><img src=x onerror=alert(2)>"


def page() -> str:
    figure = go.Figure(go.Scatter(x=[0.0, 1.0], y=[1.0, 2.0], name=HOSTILE))
    return document(HOSTILE, f"<p>{to_html(figure, 'drawn')}</p>", scripts=["window.mine = 1;"])


def test_the_policy_names_every_script_of_the_page_and_nothing_else() -> None:
    parsed = html.fromstring(page())
    (policy,) = parsed.xpath("//meta[@http-equiv='Content-Security-Policy']/@content")
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy.partition("style-src")[0]
    run = [s.text or "" for s in parsed.iter("script") if s.get("type") != "application/json"]
    hashes = {b64encode(sha256(text.encode()).digest()).decode() for text in run}
    assert hashes == set(re.findall(r"'sha256-([^']+)'", policy))
    assert run[-1] == "window.mine = 1;"


def test_the_policy_comes_before_anything_that_runs() -> None:
    head = page().partition("<script")[0]
    assert "Content-Security-Policy" in head
    assert document("", "", plots=False).count("script-src 'none'") == 1


def test_texts_in_figures_and_titles_make_no_elements() -> None:
    parsed = html.fromstring(page())
    assert not list(parsed.iter("img"))
    assert parsed.find(".//title").text == HOSTILE
    assert len([s for s in parsed.iter("script") if "alert" in (s.text or "")]) == 1  # the data of the figure
