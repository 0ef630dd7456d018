"""The page of a map: header, picture, legend and the lanes that are not exact, as one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

from resim.report.document import document, text
from resim.report.map.colors import FIRST, MISSING, MISSING_OTHER, TICKS, gradient, share, type_color
from resim.report.map.data import Picture, to_script
from resim.report.map.tables import errors_section, flaws_section
from resim.report.plots import number
from resim.road.flaws import Flaw
from resim.road.opendrive import VEHICLE_LANES, RoadNetwork
from resim.road.sumo import EXACT, VARIED, Conversion

SCRIPTS = ("data.js", "view.js", "lanes.js", "labels.js", "frame.js", "inspect.js", "input.js")


def write_map_page(
    network: RoadNetwork,
    path: Path,
    *,
    conversion: Conversion | None = None,
    flaws: Sequence[Flaw] | None = None,
) -> None:
    """Write the page of a map, one HTML file; with a conversion or flaws, the errors of its net and its own.

    The same map, conversion and flaws give the same bytes.
    """
    path.write_text(page(Picture(network, conversion), flaws), encoding="utf-8", newline="\n")


def page(picture: Picture, flaws: Sequence[Flaw] | None = None) -> str:
    """Give the page's HTML."""
    script = '"use strict";\n' + "\n".join(text("resim.report.map", name) for name in SCRIPTS)
    sections = _section("errors", "How exact the SUMO net is", errors_section(picture.conversion))
    if flaws is not None:
        sections += _section("flaws", "Flaws of the map", flaws_section(flaws))
    body = (
        f'<main class="map">\n{_header(picture)}\n{_controls(picture)}\n{_legend(picture)}\n{STAGE}\n'
        f'{sections}</main>\n<script type="application/json" id="map-data">{to_script(picture)}</script>'
    )
    css = text("resim.report.map", "map.css")
    return document(picture.network.path.name, body, css=css, scripts=[script], plots=False)


def _section(name: str, title: str, body: str) -> str:
    return f'<section id="{name}"><h2>{title}</h2>\n{body}</section>\n'


STAGE = (
    '<div class="stage" id="stage"><canvas id="map" tabindex="0" role="img" aria-label="The map from above. '
    'Arrow keys move, + and - zoom, 0 shows all."></canvas><div class="place" id="place"></div>'
    '<div class="details" id="details" hidden></div></div>\n'
    '<p class="note">Wheel or pinch zooms, dragging moves; point at a lane for its details, click to keep them. '
    "Keys: arrows, + and −, 0 for all. The address of the page holds the view.</p>"
)


def _header(picture: Picture) -> str:
    network, (west, south, east, north) = picture.network, picture.extent
    lanes, kilometres = sum(picture.types.values()), sum(r.length for r in network.roads.values()) / 1000.0
    facts = [
        ("OpenDRIVE", "{}.{}".format(*network.header.revision)),
        ("roads", f"{len(network.roads)}, {kilometres:.2f} km"),
        ("lanes", f"{lanes}"),
        ("junctions", f"{len(network.junctions)}"),
        ("extent", f"{east - west:.0f} m × {north - south:.0f} m"),
        ("x", f"{number(west, 1)} … {number(east, 1)} m"),
        ("y", f"{number(south, 1)} … {number(north, 1)} m"),
    ]
    if network.header.name:
        facts.insert(0, ("name", escape(network.header.name)))
    listed = "".join(f"<div><dt>{name}</dt><dd>{value}</dd></div>" for name, value in facts)
    geo = escape((network.geo_reference or "").strip()) or "none"
    return (
        f'<header><p class="kind">OpenDRIVE map</p><h1>{escape(network.path.name)}</h1>'
        f'<dl class="facts">{listed}</dl><p class="note geo">geoReference: <code>{geo}</code></p></header>'
    )


def _controls(picture: Picture) -> str:
    mode = (
        '<span class="choice" role="group" aria-label="Colour of the lanes">'
        '<button type="button" data-mode="types" aria-pressed="true">Lane types</button>'
        '<button type="button" data-mode="error" aria-pressed="false">Error of the SUMO net</button></span>'
        if picture.conversion
        else ""
    )
    return (
        f'<div class="controls">{mode}'
        '<span class="choice"><button type="button" id="all">Whole map</button>'
        '<button type="button" id="closer" aria-label="Zoom in">+</button>'
        '<button type="button" id="farther" aria-label="Zoom out">−</button></span>'
        '<button type="button" id="stretch" aria-pressed="false" hidden></button>'
        '<form id="search"><input id="wanted" type="search" list="ids" autocomplete="off" spellcheck="false" '
        'placeholder="road or junction id" aria-label="Road or junction id"><datalist id="ids"></datalist>'
        '<button>Go</button> <output id="said" class="note"></output></form></div>'
    )


def _legend(picture: Picture) -> str:
    order = sorted(picture.types, key=lambda name: (FIRST.index(name) if name in FIRST else len(FIRST), name))
    types = "".join(
        _sample(type_color(name), f"{escape(name)} <span>{picture.types[name]}</span>") for name in order
    )
    junction = _sample("#ece4f5", "junction", "#8e6bb8") if picture.network.junctions else ""
    keys = (
        f'<span class="sample"><i class="ref"></i>reference line</span>{junction}'
        '<span class="sample"><b class="pill">7</b>road</span>'
        '<span class="sample"><b class="pill">7 §1</b>its lane section</span>'
        + ('<span class="sample"><b class="pill j">J 3</b>junction</span>' if junction else "")
        + '<span class="sample"><b>−1</b>lane</span>'
    )
    errors = _error_legend(picture.conversion) if picture.conversion else ""
    return f'<div class="key" id="key-types">{types}{keys}</div>{errors}'


def _error_legend(conversion: Conversion) -> str:
    ticks = "".join(f'<span style="left:{100 * share(at):.2f}%">{name}</span>' for at, name in TICKS)
    limits = "".join(f'<i style="left:{100 * share(at):.2f}%"></i>' for at in (EXACT, VARIED))
    lost = {lane.type in VEHICLE_LANES for lane in conversion.lanes if lane.worst is None}
    missing = sum(lane.worst is None for lane in conversion.lanes)
    over = len(conversion.bad) - missing
    marks = "".join(
        _sample(color, text, hatch=True)
        for driven, color, text in (
            (True, MISSING, "not in the net"),
            (False, MISSING_OTHER, "not in the net, no lane for vehicles"),
        )
        if driven in lost
    )
    marks += '<span class="sample"><i class="gap"></i>gap in the map</span>' if conversion.jumps else ""
    return (
        '<div class="key" id="key-error" hidden>'
        f'<div class="bar"><div style="background:{gradient()}">{limits}</div><div class="ticks">{ticks}</div></div>'
        '<span class="note">largest distance of the centre lines; ▾ limit: 5 mm, or 1 cm where the width changes</span>'
        f"{marks}"
        f'<span class="note">{len(conversion.lanes) - missing - over} lanes within their limit, {over} beyond, '
        f"{missing} not in the net</span></div>"
    )


def _sample(color: str, text: str, edge: str = "#9aa3ad", *, hatch: bool = False) -> str:
    fill = f"repeating-linear-gradient(45deg,{color} 0 3px,#fff 3px 5px)" if hatch else color
    return f'<span class="sample"><i style="background:{fill};border-color:{edge}"></i>{text}</span>'
