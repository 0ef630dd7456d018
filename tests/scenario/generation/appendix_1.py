"""The rows of the scenario catalogs of Kaefer 2022, Appendix 1, as printed there."""

CHANGES = ("2 vehicles going straight and 1 vehicle encroaching in same lane",
           "2 vehicles going straight and 1 vehicle encroaching into another lane",
           "1 vehicle going straight and another changing lane",
           "1 vehicle going straight and another passing")  # fmt: skip
LEADS = ("strong acceleration", "strong deceleration", "moving at much lower constant speed", "stopped",
         "changing lanes", "cutting-in", "cutting-out")  # fmt: skip
AVOIDS = (
    "Avoiding road user blocking road", "Avoiding obstacles blocking road", "Avoiding construction zone",
    "Dynamic object avoidance", "Animal: vehicle going straight and animal in road",
    "Animal: vehicle negotiating a curve and animal in road", "Evasive action with prior vehicle maneuver",
    "Evasive action without prior vehicle maneuver",
)  # fmt: skip
WALKS = ("vehicle backing", "vehicle going straight and pedestrian crossing road",
         "vehicle going straight and pedestrian darting onto road",
         "vehicle going straight and pedestrian playing / working on Road",
         "vehicle going straight and pedestrian walking along road")  # fmt: skip
CYCLES = ("vehicle going straight on crossing paths", "vehicle going straight on parallel paths",
          "vehicle starting in traffic lane on crossing paths")  # fmt: skip
TURNS = ("turning left on crossing paths", "turning left on parallel paths", "turning right on crossing paths",
         "turning right on parallel paths")  # fmt: skip
ROADS = ("Widening road", "Merging road", "Exit highway", "Merge into highway")
PACES = ("Strong acceleration", "Strong deceleration")
DRIFTING = "Vehicle(s) drifting – same direction"


def _crashes(*who: str) -> list[str]:
    return [f"{one} crash {how} prior vehicle maneuver" for one in who for how in ("with", "without")]


def _edge(before: str) -> list[str]:
    return ["Control loss with prior vehicle action", f"Control loss {before} prior vehicle action",
            "Road edge departure with prior vehicle maneuver",
            "Road edge departure without prior vehicle maneuver"]  # fmt: skip


HIGHWAY = {
    "Lane change": [*CHANGES, "vehicle changing lane in absence of other vehicles"],
    "Strong acceleration / deceleration": PACES,
    "Road geometry": ROADS,
    "Lead vehicle maneuver": [f"Lead vehicle {one}" for one in LEADS],
    "Violating traffic laws": ["Speeding", "Overtaking right side", "Irrational driving (swerving etc.)",
                               "Insufficient distance to leading vehicle (tailgate)", "Ghost driver",
                               "Emergency vehicle on duty passing"],
    "Avoiding maneuvers": AVOIDS,
    "Accident scenarios": ["Accident", *_crashes("Animal"), "Vehicle failure", *_edge("Without"), DRIFTING,
                           *_crashes("Object")],
    "Cyclist": ["Cyclist crossing road", *(f"Cyclist: {one}" for one in CYCLES), *_crashes("Cyclist")],
    "Pedestrian": ["Pedestrian crossing road", "Driving through pedestrian crowd",
                   *(f"Pedestrian: {one}" for one in WALKS), *_crashes("Pedestrian")],
}  # fmt: skip
URBAN = {
    "Lane change": [*CHANGES, "1 vehicle going straight and another entering or leaving parking position",
                    "1 vehicle going straight and another turning", "1 vehicle passing and another turning",
                    "Vehicle changing lane in absence of other vehicles"],
    "Strong acceleration / deceleration": PACES,
    **{f"{kind} turn / road crossing": [f"{kind} {way}" for way in ("left turn", "right turn", "road crossing")]
       for kind in ("Protected", "Unprotected")},
    **{f"{kind} turn while pedestrian / cyclist crossing road":
       [f"{kind} {way} turn with pedestrian / cyclist crossing road" for way in ("left", "right")]
       for kind in ("Protected", "Unprotected")},
    "Pedestrian / cyclist / animal / etc. crossing road": ["Pedestrian / cyclist / animal / etc. crossing road"],
    "Road geometry": ROADS,
    "Lead vehicle maneuver": [f"Lead vehicle {one}" for one in LEADS],
    "Violating traffic laws": ["Speeding", "Running stop sign", "Hit red light", "Violating traffic signs",
                               "Irrational driving (swerving etc.)",
                               "Insufficient distance to leading vehicle (tailgate)", "Ghost driver",
                               "Emergency vehicle on duty passing"],
    "Avoiding maneuvers": [*AVOIDS, *(f"Avoiding pedestrian: {one}" for one in WALKS),
                           "Driving through pedestrian crowd",
                           *(f"Avoiding cyclist: {one}" for one in (*CYCLES, *(f"vehicle {t}" for t in TURNS)))],
    "Accident scenarios": ["Accident", *_crashes("Animal", "Pedestrian", "Cyclist", "Object"),
                           "Backing up into another vehicle", "Vehicle failure", *_edge("without"), DRIFTING,
                           "Backing: at intersections",
                           *(f"Crossing paths: {one}" for one in (
                               "left turn across path from lateral direction",
                               "left turn across path from opposite direction", "left turn into path",
                               "right turn across path from lateral direction", "right turn into path",
                               "straight crossing paths", "other/unknown"))],
}  # fmt: skip
ROWS = [f"{catalog} / {group} / {row}" for catalog, groups in (("highway", HIGHWAY), ("urban", URBAN))
        for group, rows in groups.items() for row in rows]  # fmt: skip
