"""Entities of a scenario: vehicles, pedestrians and things, with their boxes."""

from __future__ import annotations

from dataclasses import dataclass

from resim.recordings.storyboard.catalogs import ScenarioCatalogs
from resim.recordings.storyboard.document import ScenarioElement

FURNITURE = (
    "bridge", "building", "gantry", "parkingSpace", "patch", "railing", "roadMark", "soundBarrier", "streetLamp",
    "trafficIsland", "tree", "vegetation", "wind",
)  # fmt: skip
"""Categories of MiscObject that are parts of the site, not traffic."""
_VEHICLES = {
    "car": "car", "van": "van", "truck": "truck", "trailer": "trailer", "semitrailer": "trailer", "bus": "bus",
    "motorbike": "motorcycle", "bicycle": "bicycle",
}  # fmt: skip
_KEPT = ("Vehicle", "Pedestrian", "MiscObject", "CatalogReference")


@dataclass(frozen=True)
class ScenarioEntity:
    """An entity with its box.

    Attributes:
        name: In the file.
        kind: Of `resim.core.tracks.KINDS`.
        length: m.
        width: m.
        ahead: m from the reference point (of vehicles the middle of the rear axle) to the box's centre.
        left: m, likewise, to the left.
        is_furniture: Whether it is a part of the site.
    """

    name: str
    kind: str
    length: float
    width: float
    ahead: float
    left: float
    is_furniture: bool


def scenario_entities(scenario: ScenarioElement, catalogs: ScenarioCatalogs) -> dict[str, ScenarioEntity]:
    """Give the entities of a scenario by their names.

    Raises:
        InputError: One has no size, a name is a duplicate, or its trailer would follow it as a player has it.
    """
    found: dict[str, ScenarioEntity] = {}
    for one in scenario.needed("Entities").children("ScenarioObject"):
        name = one.text("name")
        if name in found:
            raise one.refused(f"is the second entity {name!r}", "Give each entity its own name.")
        told = next(one.children(*_KEPT), None)
        if told is None:
            raise one.refused("has no Vehicle, Pedestrian or MiscObject in it, so its size is unknown")
        found[name] = _entity(name, catalogs.resolved(told))
    if not found:
        raise scenario.needed("Entities").refused("has no ScenarioObject", "A recording needs a driven EGO.")
    return found


def _entity(name: str, told: ScenarioElement) -> ScenarioEntity:
    trailer = told.child("Trailer")
    if trailer is not None and any(one.get("entityRef") != "" for one in trailer.children()):
        raise trailer.refused("follows as the player has it", "Take the trailer away.")
    properties = told.child("Properties")
    for one in () if properties is None else properties.children("Property"):
        if one.get("name") == "refpoint_x_offset" and one.number("value") != 0.0:
            raise one.refused(
                "moves the reference point, in esmini alone", "Write the drive of its rear axle."
            )
    box = told.needed("BoundingBox")
    centre, size = box.needed("Center"), box.needed("Dimensions")
    length, width = size.number("length"), size.number("width")
    if min(length, width) <= 0.0:
        raise size.refused(f"is {length:g} x {width:g} m, expected more than 0")
    if told.tag == "Vehicle":
        kind = _VEHICLES.get(told.get("vehicleCategory") or "", "unknown")
    else:
        walks = told.tag == "Pedestrian" and told.get("pedestrianCategory", "pedestrian") == "pedestrian"
        kind = "pedestrian" if walks else "unknown"
    furniture = told.tag == "MiscObject" and told.get("miscObjectCategory") in FURNITURE
    return ScenarioEntity(name, kind, length, width, centre.number("x"), centre.number("y"), furniture)
