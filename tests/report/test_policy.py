"""What an id, a name or a unit brings into a page is text there: its policy lets the page's own scripts run alone."""

from __future__ import annotations

import json
import re
from base64 import b64encode
from hashlib import sha256

import numpy as np
import pytest
from hostile import figures_of, scripts_of
from lxml import html as parser

from resim.report.document import document
from resim.report.figure import Figure, trace
from resim.report.markup import Markup, html, join, script_data
from resim.report.plots import line, style, to_html

HOSTILE = "</script><script>alert(1)</script>\"'><img src=x onerror=alert(2)>"


def page() -> str:
    figure = style(Figure([trace("scatter", x=[0.0, 1.0], y=[1.0, 2.0], name=HOSTILE)]), 200.0)
    return document(HOSTILE, html("<p>{}</p>", to_html(figure, "drawn")), scripts=["window.mine = 1;"])


def test_the_policy_names_every_script_of_the_page_and_nothing_else() -> None:
    parsed = parser.fromstring(page())
    (policy,) = parsed.xpath("//meta[@http-equiv='Content-Security-Policy']/@content")
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy.partition("style-src")[0]
    run = scripts_of(parsed)
    assert run[0].count("* plotly.js (cartesian - minified) v4.1.1") == 1
    hashes = {b64encode(sha256(text.encode()).digest()).decode() for text in run}
    assert hashes == set(re.findall(r"'sha256-([^']+)'", policy))
    assert run[-1] == "window.mine = 1;"


def test_the_policy_comes_before_anything_that_runs() -> None:
    assert page().count("<script>") == 2  # what draws, and the page's own
    head = page().partition("<script")[0]
    assert "Content-Security-Policy" in head
    assert document("", Markup(), plots=False).count("script-src 'none'") == 1


def test_texts_in_figures_and_titles_make_no_elements() -> None:
    parsed = parser.fromstring(page())
    assert not list(parsed.iter("img"))
    assert parsed.find(".//title").text == HOSTILE
    assert not [s for s in parsed.iter("script") if "alert" in (s.text or "")]
    assert "alert(1)" in figures_of(parsed)[0]["data"][0]["name"]


def test_a_body_that_is_text_is_refused() -> None:
    with pytest.raises(TypeError, match="must be Markup, not str"):
        document("", "<main></main>")  # type: ignore[arg-type]


def test_what_is_not_markup_is_escaped_wherever_it_enters() -> None:
    assert html("<b>{}</b>{:.1f}{x}", "<i>", 1.25, x=Markup("<br>")) == "<b>&lt;i&gt;</b>1.2<br>"
    assert join(["<i>", Markup("<br>")], " & ") == "&lt;i&gt; &amp; <br>"
    text = json.dumps("</script><!--")
    assert "<" not in script_data(text)
    assert json.loads(script_data(text)) == "</script><!--"


def test_only_markup_is_markup_in_a_figure() -> None:
    """Plotly follows tags in these texts, and decodes entities."""
    figure = Figure(
        [line(np.arange(2.0), np.arange(2.0), color="#000000", name='<a href="x">%{y}', hover="%{x}")]
    )
    figure.update_xaxes(title_text="<b>t")
    figure.add_annotation(text=html("<b>{}</b>", "<i>"))
    (drawn,) = figures_of(parser.fromstring(to_html(style(figure, 200.0), "drawn")))
    (trace,), layout = drawn["data"], drawn["layout"]
    assert trace["name"] == "&lt;a href=&#34;x&#34;&gt;%{y}"
    assert trace["hovertemplate"] == "<b>&lt;a href=&#34;x&#34;&gt;&#37;{y}</b><br>%{x}<extra></extra>"
    assert layout["xaxis"]["title"]["text"] == "&lt;b&gt;t"
    assert layout["annotations"][0]["text"] == "<b>&lt;i&gt;</b>"
