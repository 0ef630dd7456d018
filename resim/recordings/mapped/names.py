"""What columns are usually called, and the units in their names."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping

SYNONYMS: Mapping[str, tuple[str, ...]] = {
    "t": ("t", "time", "timestamp", "ts", "zeit", "datetime", "utc", "frame", "frameid", "framenumber", "simtime",
          "unixtime", "gpstime", "epoch", "when", "stamp", "tstamp", "sensortime", "zeitstempel", "uhrzeit",
          "messzeit", "bild", "bildnummer", "framenr"),
    "id": ("id", "trackid", "objectid", "objid", "track", "vehicleid", "actorid", "obstacleid", "name", "oid",
           "object", "vehicle", "agentid", "who", "obj", "objnr", "objectnumber", "trackno", "objekt", "objektid",
           "objektnr", "objektnummer", "kennung", "fahrzeug", "fahrzeugid", "fahrzeugnr", "nummer", "trackingid"),
    "lat": ("lat", "latitude", "breitengrad", "gpslat", "poslat", "geobreite", "breite"),
    "lon": ("lon", "lng", "long", "longitude", "laengengrad", "gpslon", "poslon", "geolaenge", "laenge"),
    "x": ("x", "posx", "positionx", "xcenter", "centerx", "easting", "east", "ost", "utmx", "utme", "px", "localx",
          "xpos", "dx", "utmeasting", "rechtswert", "ostwert", "xposition", "xkoordinate"),
    "y": ("y", "posy", "positiony", "ycenter", "centery", "northing", "north", "nord", "utmy", "utmn", "py", "localy",
          "ypos", "dy", "utmnorthing", "hochwert", "nordwert", "yposition", "ykoordinate"),
    "heading": ("heading", "yaw", "hdg", "psi", "orientation", "course", "azimuth", "bearing", "theta", "cog",
                "yawangle", "headingangle", "rotation", "kurs", "kurswinkel", "gierwinkel", "richtung",
                "fahrtrichtung", "ausrichtung", "steuerkurs", "azimut"),
    "v": ("v", "speed", "velocity", "vel", "spd", "sog", "geschwindigkeit", "groundspeed", "vabs", "tempo",
          "fahrgeschwindigkeit", "betragsgeschwindigkeit"),
    "vx": ("vx", "xvelocity", "velx", "velocityx", "ve", "veast", "vlon", "speedx", "vrelx", "relvx", "relvelx",
           "relativevelocityx", "geschwindigkeitx", "vxrel"),
    "vy": ("vy", "yvelocity", "vely", "velocityy", "vn", "vnorth", "vlat", "speedy", "vrely", "relvy", "relvely",
           "relativevelocityy", "geschwindigkeity", "vyrel"),
    "length": ("length", "len", "l", "laenge", "sizex", "objectlength", "boxlength", "dimx", "objektlaenge",
               "fahrzeuglaenge"),
    "width": ("width", "wid", "w", "breite", "sizey", "objectwidth", "boxwidth", "dimy", "objektbreite",
              "fahrzeugbreite"),
    "kind": ("class", "type", "kind", "category", "classification", "objecttype", "classtype", "objectclass", "label",
             "vehicletype", "klasse", "typ", "art", "objekttyp", "objektklasse", "objektart", "fahrzeugtyp",
             "fahrzeugklasse", "fahrzeugart", "kategorie"),
    "existence": ("existence", "probability", "confidence", "score", "existenceprobability", "pexist", "konfidenz",
                  "wahrscheinlichkeit", "existenzwahrscheinlichkeit"),
    "yaw_rate": ("yawrate", "omega", "angularvelocity", "gierrate", "drehrate"),
    "a": ("a", "acceleration", "accel", "acc", "along", "alongitudinal", "beschleunigung", "laengsbeschleunigung"),
    "z": ("z", "altitude", "elevation", "alt", "posz", "positionz", "zpos", "hoehe", "hoehenwert"),
    "gt_id": ("gtid", "truthid", "groundtruthid"),
}  # fmt: skip
"""By the field of a mapping, its usual names, without case, units and signs."""
UNITS: Mapping[str, str] = {
    "kmh": "km/h", "kph": "km/h", "mps": "m/s", "ms": "ms", "mph": "mph", "kn": "kn", "kts": "kn", "deg": "deg",
    "degree": "deg", "degrees": "deg", "grad": "deg", "rad": "rad", "mrad": "mrad", "cm": "cm", "mm": "mm", "m": "m",
    "s": "s", "sec": "s", "us": "us", "ns": "ns", "ft": "ft", "percent": "%",
}  # fmt: skip
"""Units as they stand in names."""
KINDS: Mapping[str, str] = {
    "pkw": "car", "passengercar": "car", "auto": "car", "vehicle": "car", "sedan": "car", "suv": "car", "lkw": "truck",
    "lorry": "truck", "heavyvehicle": "truck", "truckbus": "truck", "transporter": "van", "motorbike": "motorcycle",
    "motorrad": "motorcycle", "bike": "bicycle", "cyclist": "bicycle", "fahrrad": "bicycle", "ped": "pedestrian",
    "lieferwagen": "van", "sattelzug": "truck", "lastwagen": "truck", "kraftrad": "motorcycle", "radfahrer": "bicycle",
    "person": "pedestrian", "vru": "pedestrian", "fussgaenger": "pedestrian",
}  # fmt: skip
"""Words for kinds, without case and signs."""
EGOS = (
    "ego",
    "egovehicle",
    "egofahrzeug",
    "egocar",
    "eigenfahrzeug",
    "host",
    "hostvehicle",
    "self",
    "vut",
    "sut",
)
"""What an EGO is called."""
UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue"})
"""How umlauts are spelt without."""
EITHER = {"laenge", "breite"}
"""German for the sides of the Earth's grid, and for those of a box."""


def plain(name: str) -> str:
    """Give a name without case and signs."""
    return re.sub(r"[^a-z0-9]", "", _spelt(name).casefold())


def _spelt(name: str) -> str:
    return unicodedata.normalize("NFC", name).translate(UMLAUTS)


def split_unit(name: str) -> tuple[str, str]:
    """Give a column's plain name without its unit, and the unit, "" where it has none."""
    told = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]", name)
    if told:
        unit = told[1].replace("²", "2")
        return plain(name[: told.start()]), UNITS.get(plain(unit), "") if unit != "m/s" else "m/s"
    spread = re.sub(r"([a-z])([A-Z])", r"\1_\2", _spelt(name))
    parts = [p for p in re.split(r"[^A-Za-z0-9]+", spread) if p]
    for count in (2, 1):
        end = plain("".join(parts[-count:]))
        if len(parts) > count and (end in UNITS or (count == 2 and end == "ms")):
            return plain("".join(parts[:-count])), "m/s" if (count, end) == (2, "ms") else UNITS[end]
    return plain(name), ""


def fields(columns: list[str]) -> dict[str, tuple[str, str]]:
    """Give for each field of a mapping the column that is called so, and the unit in its name."""
    split = {column: split_unit(column) for column in columns}
    found: dict[str, tuple[str, str]] = {}
    called: dict[str, list[str]] = {}
    for column, (name, _) in split.items():
        called.setdefault(name, []).append(column)
    boxes = called.keys() & EITHER if all(called.keys() & {*SYNONYMS[axis]} for axis in ("x", "y")) else set()
    for field, names in SYNONYMS.items():
        for name in names:
            if name in boxes and field in ("lat", "lon"):
                continue
            own = [c for c in called.get(name, ()) if c not in {f for f, _ in found.values()}]
            if own:
                found[field] = (own[0], split[own[0]][1])
                break
    other = ("x", "y") if {"lat", "lon"} <= set(found) else ("lat", "lon")
    return {field: told for field, told in found.items() if field not in other}
