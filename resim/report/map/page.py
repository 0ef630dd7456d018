"""The page of a map: header, picture, legend and the lanes that are not exact, as one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from resim.report.document import document, text
from resim.report.map.colors import FIRST, MISSING, MISSING_OTHER, TICKS, gradient, share, type_color
from resim.report.map.data import Picture, to_script
from resim.report.map.tables import errors_section, flaws_section
from resim.report.markup import Markup, html, join
from resim.report.plots import number
from resim.road.flaws import Flaw
from resim.road.opendrive import VEHICLE_LANES, RoadNetwork
from resim.road.sumo import EXACT, VARIED, Conversion

DRAWING = ("look.js", "data.js", "view.js", "lanes.js", "frame.js", "ruler.js", "pointer.js")
"""What draws a map and moves the view: the player's page has it, too."""
SCRIPTS = (*DRAWING, "labels.js", "picture.js", "address.js", "inspect.js", "input.js")


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


def page(picture: Picture, flaws: Sequence[Flaw] | None = None) -> Markup:
    """Give the page's HTML."""
    script = '"use strict";\n' + "\n".join(text("resim.report.map", name) for name in SCRIPTS)
    sections = _section("errors", "Accuracy of the SUMO net", errors_section(picture.conversion))
    if flaws is not None:
        sections += _section("flaws", "Flaws of the map", flaws_section(flaws))
    body = html(
        '<main class="map">\n{header}\n{controls}\n{legend}\n{stage}\n'
        '{sections}</main>\n<script type="application/json" id="map-data">{data}</script>',
        header=_header(picture),
        controls=_controls(picture),
        legend=_legend(picture),
        stage=STAGE,
        sections=sections,
        data=to_script(picture),
    )
    css = text("resim.report.map", "map.css")
    return document(picture.network.path.name, body, css=css, scripts=[script], plots=False)


def _section(name: str, title: str, body: Markup) -> Markup:
    return html('<section id="{}"><h2>{}</h2>\n{}</section>\n', name, title, body)


STAGE = Markup(
    '<div class="stage" id="stage"><canvas id="map" tabindex="0" role="img" aria-label="The map from above. '
    'Arrow keys move, + and - zoom, 0 shows all, M measures."></canvas><div class="place" id="place"></div>'
    '<div class="details" id="details" hidden></div></div>\n'
    '<p class="note">Wheel or pinch zooms, dragging moves; point at a lane for its details, click to keep them. '
    "Keys: arrows on the map, + and −, 0 for all, M measures (a drag, or two taps), Esc ends it. "
    "The address of the page holds the view.</p>"
)


def _header(picture: Picture) -> Markup:
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
        facts.insert(0, ("name", network.header.name))
    listed = join(html("<div><dt>{}</dt><dd>{}</dd></div>", name, value) for name, value in facts)
    geo = (network.geo_reference or "").strip() or "none"
    return html(
        '<header><p class="kind">OpenDRIVE map</p><h1>{}</h1>'
        '<dl class="facts">{}</dl><p class="note geo">geoReference: <code>{}</code></p></header>',
        network.path.name,
        listed,
        geo,
    )


def _controls(picture: Picture) -> Markup:
    mode = (
        Markup(
            '<span class="choice" role="group" aria-label="Colour of the lanes">'
            '<button type="button" data-mode="types" aria-pressed="true">Lane types</button>'
            '<button type="button" data-mode="error" aria-pressed="false">Error of the SUMO net</button></span>'
        )
        if picture.conversion
        else ""
    )
    return html(
        '<div class="controls">{}'
        '<span class="choice"><button type="button" id="all">Whole map</button>'
        '<button type="button" id="closer" aria-label="Zoom in">+</button>'
        '<button type="button" id="farther" aria-label="Zoom out">−</button></span>'
        '<button type="button" id="measure" aria-pressed="false" title="Measure a distance (M)">Measure</button>'
        '<button type="button" id="stretch" aria-pressed="false" hidden></button>'
        '<form id="search"><input id="wanted" type="search" list="ids" autocomplete="off" spellcheck="false" '
        'placeholder="road or junction id" aria-label="Road or junction id"><datalist id="ids"></datalist>'
        '<button>Go</button> <output id="said" class="note"></output></form></div>',
        mode,
    )


def _legend(picture: Picture) -> Markup:
    order = sorted(picture.types, key=lambda name: (FIRST.index(name) if name in FIRST else len(FIRST), name))
    types = join(
        _sample(type_color(name), html("{} <span>{}</span>", name, picture.types[name])) for name in order
    )
    junction = (
        Markup('<span class="sample"><i class="junction"></i>junction</span>')
        if picture.network.junctions
        else ""
    )
    keys = (
        html(
            '<span class="sample"><i class="ref"></i>reference line</span>{}'
            '<span class="sample"><b class="pill">7</b>road</span>'
            '<span class="sample"><b class="pill">7 §1</b>its lane section</span>',
            junction,
        )
        + (Markup('<span class="sample"><b class="pill j">J 3</b>junction</span>') if junction else "")
        + Markup('<span class="sample"><b>−1</b>lane</span>')
    )
    errors = _error_legend(picture.conversion) if picture.conversion else ""
    return html('<div class="key" id="key-types">{}{}</div>{}', types, keys, errors)


def _error_legend(conversion: Conversion) -> Markup:
    ticks = join(html('<span style="left:{:.2f}%">{}</span>', 100 * share(at), name) for at, name in TICKS)
    limits = join(html('<i style="left:{:.2f}%"></i>', 100 * share(at)) for at in (EXACT, VARIED))
    lost = {lane.type in VEHICLE_LANES for lane in conversion.lanes if lane.worst is None}
    missing = sum(lane.worst is None for lane in conversion.lanes)
    over = len(conversion.bad) - missing
    marks = join(
        _sample(color, text, hatch=True)
        for driven, color, text in (
            (True, MISSING, "not in the net"),
            (False, MISSING_OTHER, "not in the net, no lane for vehicles"),
        )
        if driven in lost
    )
    if conversion.jumps:
        marks += Markup('<span class="sample"><i class="gap"></i>gap in the map</span>')
    return html(
        '<div class="key" id="key-error" hidden>'
        '<div class="bar"><div style="background:{gradient}">{limits}</div><div class="ticks">{ticks}</div></div>'
        '<span class="note">largest distance of the centre lines; ▾ limit: 5 mm, or 1 cm where the width changes</span>'
        '{marks}<span class="note">{lanes} lanes within their limit, {over} beyond, {missing} not in the net</span>'
        "</div>",
        gradient=gradient(),
        limits=limits,
        ticks=ticks,
        marks=marks,
        lanes=len(conversion.lanes) - missing - over,
        over=over,
        missing=missing,
    )


def _sample(color: str, text: str, edge: str = "#9aa3ad", *, hatch: bool = False) -> Markup:
    fill = f"repeating-linear-gradient(45deg,{color} 0 3px,#fff 3px 5px)" if hatch else color
    return html(
        '<span class="sample"><i style="background:{};border-color:{}"></i>{}</span>', fill, edge, text
    )
