"""Names as somebody may have them who means harm, and what no page may make of them."""

from __future__ import annotations

import gzip
import json
import re
from base64 import b64decode, b64encode
from collections.abc import Collection
from hashlib import sha256
from typing import Any

from lxml import html

HOSTILE = (
    "</td><script>alert(1)</script><img src=x onerror=alert(2)>&\"' onclick=alert(3) <!-- "
    '<a href="javascript:alert(4)">%{x}\x1b[31m'
)
FILE = HOSTILE.replace("/", "").replace("\x1b", "")
"""As a file can be called."""
PLOTLY = re.compile(r"</?(?:b|i|br|extra)>|<span style=\"color:#?[\w(),. ]+\">|</span>")
"""The tags that our figures have in their texts."""
TEXTS = {"name", "text", "hovertext", "hovertemplate", "ticktext"}


def harmless(page: str, *, shown: bool = True) -> html.HtmlElement:
    """Fail where a page has scripts but its own, images, handlers, links to scripts, or tags in figures; its document.

    shown: whether the hostile text must be there, as text.
    """
    found = html.fromstring(page.replace("\x1b", ""))
    (policy,) = found.xpath("//meta[@http-equiv='Content-Security-Policy']/@content")
    own = set(re.findall(r"'sha256-([^']+)'", policy))
    runs = scripts_of(found)
    assert len(runs) == len(own)
    assert {b64encode(sha256(text.encode()).digest()).decode() for text in runs} == own
    assert not [e.tag for e in found.iter("img", "iframe", "object", "embed", "base")]
    for element in found.iter(html.etree.Element):
        assert not [name for name in element.attrib if name.startswith("on") or name in ("src", "srcdoc")]
        link = element.get("href", "#")
        assert re.match(r"#|[\w%./-]*$", link), link
    for script in found.iter("script"):
        assert script.get("type") != "application/json" or "<" not in script.text
    for figure in figures_of(found):
        plain_figure(figure)
    body = html.fromstring(page.replace("\x1b", "")).body
    for script in list(body.iter("script")):
        script.drop_tree()
    attributes = [value for e in body.iter(html.etree.Element) for value in e.attrib.values()]
    assert not shown or any("<script>alert(1)" in t for t in [body.text_content(), *attributes])
    return found


def scripts_of(page: html.HtmlElement) -> list[str]:
    """Give the scripts of a page that a browser runs, the one that is packed unpacked and first."""
    every = list(page.iter("script"))
    assert {s.get("type") for s in every} <= {None, "application/json", "application/gzip"}
    packed = [_unpacked(s.text) for s in every if s.get("id") == "plotly"]
    return [*packed, *(s.text or "" for s in every if s.get("type") is None)]


def figures_of(page: html.HtmlElement) -> list[dict[str, Any]]:
    """Give the figures of a page, as plotly.js reads them."""
    return [json.loads(_unpacked(s.text)) for s in page.xpath("//*[@class='plot']/script")]


def _unpacked(text: str) -> str:
    return gzip.decompress(b64decode(text)).decode()


def plain_figure(part: Any, read: bool = False) -> None:
    """Fail where a text of a figure has tags but ours, or fields of a template that a name brought in."""
    if isinstance(part, dict):
        for key, value in part.items():
            plain_figure(value, key in TEXTS)
    elif isinstance(part, list):
        for value in part:
            plain_figure(value, read)
    elif isinstance(part, str) and read:
        assert "<" not in PLOTLY.sub("", part), part
        assert "javascript:" not in part or "&lt;a" in part


def poisoned(found: Any, kept: Collection[str], keys: Collection[str] = ()) -> Any:
    """Give JSON with its texts made hostile, but those at the keys `kept`; of mappings at `keys`, their keys, too."""
    if isinstance(found, dict):
        out = {}
        for key, value in found.items():
            if key in kept:
                out[key] = value
            elif key in keys and isinstance(value, dict):
                out[key] = {k + HOSTILE: poisoned(v, kept, keys) for k, v in value.items()}
            else:
                out[key] = poisoned(value, kept, keys)
        return out
    if isinstance(found, list):
        return [poisoned(value, kept, keys) for value in found]
    return found + HOSTILE if isinstance(found, str) else found
