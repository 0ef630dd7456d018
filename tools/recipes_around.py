"""Recipes with obstacles, animals, cyclists and pedestrians on a road: avoided, or hit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from recipe_parts import (
    BEND,
    CURVE,
    HIGHWAY,
    URBAN,
    Object,
    RecipeText,
    Stage,
    change,
    free,
    on,
    place,
    profile,
    shift,
)
from recipes_road import ego, recipe

AVOID, CRASH = "Avoiding maneuvers", "Accident scenarios"
ANIMAL = {"kind": "unknown", "length": 1.4, "width": 0.5}
THING = {"kind": "unknown", "length": 1.5, "width": 1.2}
BARRIER = {"kind": "unknown", "length": 1.2, "width": 0.5}
STRONG = 4.2
"""m/s² by which the EGO brakes for those who cross."""
SLIPS = (0.0, 0.5, -0.45, 0.2, 0.0)
"""rad to the left of its motion, one after the other, by which a vehicle that skids is turned."""
FAR, HIT = 165.0, 5.5
"""m of the motorway ahead of the EGO where somebody is, and when [s] the EGO is there at its usual speed."""


def around_recipes() -> Iterator[RecipeText]:
    for stage in (HIGHWAY, URBAN):
        yield from _avoided(stage)
        yield from _animals(stage)
        yield from _accidents(stage)
        yield from _cyclists(stage)
        yield from _pedestrians(stage)


def stops(stage: Stage) -> dict[str, list[float]]:
    """The EGO's speeds over the way: it brakes strongly, and stops short of FAR."""
    end = 150.0 * stage.scale
    return {
        "ways": [0.0, round(end - stage.v**2 / (2.0 * STRONG), 1), round(end, 1)],
        "values": [stage.v, stage.v, 0.0],
    }


def slows(stage: Stage, to: float = 0.4) -> dict[str, list[float]]:
    v = stage.v
    return profile((0.0, v), (1.0, v), (4.5, to * v), (9.0, to * v))


def lanes_across(stage: Stage) -> list[dict[str, object]]:
    """Places from beside the road to its middle or beyond, at FAR."""
    s = round(stage.s + FAR * stage.scale, 2)
    if stage.map == "motorway":
        return [*(place(stage.road, lane, s) for lane in (-4, -3, -2, -1)), place(stage.road, -1, s, 4.0)]
    sides = (-3, -2, -1, 1, 2, 3) if stage.road != "3" else (-2, -1, 1, 2)
    return [place(stage.road, lane, s) for lane in sides]


def crosser(stage: Stage, name: str, speed: object, **told: object) -> Object:
    return {"id": name, **told, "route": {"places": lanes_across(stage)}, "speed": speed}


def reach(stage: Stage, lane: int) -> float:
    """Way [m] of who crosses until the centre of a lane."""
    if stage.map == "motorway":
        return 1.25 + 1.875 + 3.75 * (3 + lane)
    return 1.0 + 1.75 + 3.5 * (2 + lane)


def hit_by(stage: Stage, name: str, lane: int, w: float, **told: object) -> Object:
    """Somebody who is in a lane when the EGO comes there."""
    begins = max(HIT - reach(stage, lane) / w - 0.45, 0.0)
    return crosser(stage, name, profile((0.0, 0.0), (begins + 0.01, 0.0), (begins + 0.91, w)), **told)


def crashes(
    stage: Stage, group: str, what: str, file: str, told: dict[str, object], w: float
) -> Iterator[RecipeText]:
    """Hit with and without a maneuver before."""
    pair = (("ego", "hit"),)
    yield recipe(
        stage,
        f"{file}_crash",
        (f"{group} / {what} crash without prior vehicle maneuver",),
        f"The EGO hits a crossing {what.lower()}",
        ego(stage),
        hit_by(stage, "hit", stage.ego, w, **told),
        overlaps=pair,
        duration=HIT + 0.4,
    )
    yield recipe(
        stage,
        f"{file}_crash_after_maneuver",
        (f"{group} / {what} crash with prior vehicle maneuver",),
        f"The EGO changes lane and hits a crossing {what.lower()}",
        ego(stage, change=[change("left", 0.5, 3.5)]),
        hit_by(stage, "hit", stage.left, w, **told),
        overlaps=pair,
        duration=HIT + 0.4,
    )


def _avoided(stage: Stage) -> Iterator[RecipeText]:
    v, out = stage.v, [change("left", 1.0, 3.5)]
    yield recipe(
        stage,
        "avoids_road_user",
        (f"{AVOID} / Avoiding road user blocking road",),
        "A car stands in the lane; the EGO changes to the left lane",
        ego(stage, change=out),
        on(stage, "blocking", stage.ego, FAR, 0.0),
    )
    yield recipe(
        stage,
        "avoids_obstacle",
        (f"{AVOID} / Avoiding obstacles blocking road",),
        "An obstacle lies in the lane; the EGO changes to the left lane",
        ego(stage, change=out),
        on(stage, "obstacle", stage.ego, FAR, 0.0, **THING),
    )
    works = [
        on(
            stage,
            f"barrier{n}",
            stage.ego,
            FAR + 14.0 * n / stage.scale * 0.6,
            0.0,
            offset=round(-1.2 + 0.4 * n, 2),
            **BARRIER,
        )
        for n in range(6)
    ]
    yield recipe(
        stage,
        "avoids_construction",
        (f"{AVOID} / Avoiding construction zone",),
        "Barriers close the lane step by step; the EGO changes to the left lane",
        ego(stage, change=out),
        *works,
    )
    gap, lasts = (59.0, 2.0) if stage is HIGHWAY else (66.5, 1.0)
    yield recipe(
        stage,
        "avoids_dynamic_object",
        (f"{AVOID} / Dynamic object avoidance",),
        "A slower vehicle pulls out of the left lane close ahead of the EGO, which brakes strongly",
        ego(stage, profile((0.0, v), (3.25, v), (3.25 + lasts, 0.58 * v), (9.0, 0.58 * v))),
        on(stage, "pulling", stage.left, gap, 0.6 * v, change=[change("right", 2.0, 2.5)]),
        duration=9.0,
    )
    yield recipe(
        stage,
        "evasive_action",
        (f"{AVOID} / Evasive action without prior vehicle maneuver",),
        "The lead vehicle brakes hard; the EGO evades to the left lane at once",
        ego(stage, change=[change("left", 2.8, 2.2)]),
        on(stage, "lead", stage.ego, 45.0, profile((0.0, v), (1.5, v), (4.5, 0.3 * v), (8.0, 0.3 * v))),
    )
    near = 46.0 if stage is HIGHWAY else 50.0
    yield recipe(
        stage,
        "evasive_action_after_maneuver",
        (f"{AVOID} / Evasive action with prior vehicle maneuver",),
        "The EGO changes to the left lane and evades back, as the vehicle there brakes",
        ego(stage, change=[change("left", 0.5, 3.0), change("right", 4.5, 2.5)]),
        on(stage, "lead", stage.left, near, profile((0.0, v), (2.5, v), (6.0, 0.45 * v), (9.0, 0.45 * v))),
        duration=8.0,
    )


def _animals(stage: Stage) -> Iterator[RecipeText]:
    curve = CURVE if stage is HIGHWAY else BEND
    yield recipe(
        stage,
        "animal_in_road",
        (f"{AVOID} / Animal: vehicle going straight and animal in road",),
        "An animal crosses a straight road; the EGO stops",
        ego(stage, stops(stage)),
        crosser(stage, "animal", 2.0, **ANIMAL),
        duration=10.0,
    )
    yield recipe(
        curve,
        "animal_in_curve",
        (f"{AVOID} / Animal: vehicle negotiating a curve and animal in road",),
        "An animal crosses in a curve; the EGO stops",
        ego(curve, stops(curve)),
        crosser(curve, "animal", 2.0, **ANIMAL),
        duration=10.0,
    )
    yield from crashes(stage, CRASH, "Animal", "animal", ANIMAL, 2.5)


def _control_losses(stage: Stage) -> Iterator[RecipeText]:
    """Who skids is turned against its motion, to one side and the other, until it catches itself."""
    asked = ("HEADING_DISAGREES", "SPEED_DISAGREES")
    for name, row, text, lane, begin, changes in (
        (
            "control_loss", "Without" if stage is HIGHWAY else "without",
            "A vehicle ahead loses control, skids and catches itself", stage.ego, 2.0, [],
        ),
        (
            "control_loss_after_maneuver", "with", "A vehicle changes lane ahead of the EGO, skids and catches itself",
            stage.left, 3.8, [change("right", 0.5, 3.0)],
        ),
    ):  # fmt: skip
        slows_down = profile((0.0, stage.v), (begin, stage.v), (begin + 2.5, round(0.8 * stage.v, 1)))
        skids = profile(
            *((round(begin + t, 1), slip) for t, slip in zip((0.0, 0.6, 1.4, 2.2, 3.0), SLIPS, strict=True))
        )
        yield recipe(
            stage,
            name,
            (f"{CRASH} / Control loss {row} prior vehicle action",),
            text,
            ego(stage, profile((0.0, stage.v), (begin, stage.v), (begin + 4.0, 0.75 * stage.v))),
            on(
                stage, "other", lane, 75.0, slows_down, change=changes, slip=skids,
                maneuver=[{"label": "skidding", "start": begin + 0.3, "end": begin + 1.9, "t": begin + 0.6}],
            ),
            duration=9.0,
            accept=asked,
        )  # fmt: skip


def _accidents(stage: Stage) -> Iterator[RecipeText]:
    v = stage.v
    touches = (
        190.0 + 37.5 - 67.5 - (4.5 if stage is URBAN else 4.2) / stage.scale
    )  # they stop 0.2 m in each other
    yield recipe(
        stage,
        "accident",
        (f"{CRASH} / Accident",),
        "Ahead of the EGO a vehicle runs into one that brakes; the EGO stops",
        ego(stage, stops(stage)),
        on(stage, "front", stage.ego, 190.0, profile((0.0, 0.5 * v), (1.0, 0.5 * v), (4.0, 0.0))),
        on(stage, "behind", stage.ego, touches, profile((0.0, 0.6 * v), (2.0, 0.6 * v), (5.5, 0.0))),
        overlaps=(("front", "behind"),),
        duration=10.0,
    )
    yield from _control_losses(stage)
    outer = stage.right if stage is HIGHWAY else stage.ego
    yield recipe(
        stage,
        "road_edge_departure",
        (f"{CRASH} / Road edge departure without prior vehicle maneuver",),
        "A vehicle ahead leaves its lane beyond the edge of the road, and slows down there",
        ego(stage, slows(stage)),
        on(
            stage,
            "leaving",
            outer,
            60.0,
            profile((0.0, v), (3.0, v), (9.0, 0.3 * v)),
            change=[change("right", 2.0, 4.0)],
        ),
    )
    first = stage.ego if stage is HIGHWAY else stage.left
    yield recipe(
        stage,
        "road_edge_departure_after_maneuver",
        (f"{CRASH} / Road edge departure with prior vehicle maneuver",),
        "A vehicle ahead changes to the right lane, and on beyond the edge of the road",
        ego(stage, slows(stage)),
        on(
            stage,
            "leaving",
            first,
            75.0,
            profile((0.0, v), (4.0, v), (9.0, 0.4 * v)),
            change=[change("right", 1.0, 3.0), change("right", 4.2, 3.0)],
        ),
    )
    yield recipe(
        stage,
        "drifting_same_direction",
        (f"{CRASH} / Vehicle(s) drifting – same direction",),
        "A vehicle beside the EGO drifts towards it, and their sides touch",
        ego(stage, offset=0.5),
        on(stage, "drifting", stage.left, 2.0, v, change=[shift(-1.6, 1.0, 6.0)]),
        overlaps=(("ego", "drifting"),),
        duration=5.2 if stage is URBAN else 8.0,
    )
    yield recipe(
        stage,
        "object_crash",
        (f"{CRASH} / Object crash without prior vehicle maneuver",),
        "The EGO hits an object in its lane",
        ego(stage),
        on(stage, "hit", stage.ego, FAR, 0.0, **THING),
        overlaps=(("ego", "hit"),),
        duration=HIT + 0.4,
    )
    yield recipe(
        stage,
        "object_crash_after_maneuver",
        (f"{CRASH} / Object crash with prior vehicle maneuver",),
        "The EGO changes lane and hits an object there",
        ego(stage, change=[change("left", 0.5, 3.5)]),
        on(stage, "hit", stage.left, FAR, 0.0, **THING),
        overlaps=(("ego", "hit"),),
        duration=HIT + 0.4,
    )


def _cyclists(stage: Stage) -> Iterator[RecipeText]:
    highway = stage is HIGHWAY
    bicycle = {"kind": "bicycle"}
    rows = [f"{AVOID} / Avoiding cyclist: vehicle going straight on crossing paths"]
    if highway:
        rows = [
            "Cyclist / Cyclist crossing road",
            "Cyclist / Cyclist: vehicle going straight on crossing paths",
        ]
    yield recipe(
        stage,
        "cyclist_crossing",
        tuple(rows),
        "A cyclist crosses the road; the EGO stops",
        ego(stage, stops(stage)),
        crosser(stage, "cyclist", 3.0, **bicycle),
        duration=10.0,
    )
    outer = stage.right if highway else stage.ego
    parallel = "Cyclist / Cyclist" if highway else f"{AVOID} / Avoiding cyclist"
    yield recipe(
        stage,
        "cyclist_parallel",
        (f"{parallel}: vehicle going straight on parallel paths",),
        "The EGO passes a cyclist in the lane to its right"
        if highway
        else "The EGO changes to the left lane and passes a cyclist",
        ego(stage, 0.8 * stage.v, change=[] if highway else [change("left", 0.5, 3.0)]),
        on(stage, "cyclist", outer, 60.0, 5.0, offset=-1.3, **bicycle),
    )
    yield recipe(
        stage,
        "cyclist_starting",
        (f"{parallel}: vehicle starting in traffic lane on crossing paths",),
        "The EGO starts in its lane as a cyclist crosses ahead of it",
        on(stage, "ego", stage.ego, FAR - 12.0 / stage.scale, profile((0.0, 0.0), (3.5, 0.0), (8.0, 6.0))),
        crosser(stage, "cyclist", 2.5 if highway else 3.5, **bicycle),
        duration=10.0,
    )
    yield from crashes(stage, "Cyclist" if highway else CRASH, "Cyclist", "cyclist", bicycle, 3.5)


def _pedestrians(stage: Stage) -> Iterator[RecipeText]:
    highway = stage is HIGHWAY
    who = {"kind": "pedestrian"}
    group, name = ("Pedestrian", "Pedestrian") if highway else (AVOID, "Avoiding pedestrian")
    crossing = ["vehicle going straight and pedestrian crossing road"]
    rows = [f"{group} / {name}: {row}" for row in crossing] + (
        ["Pedestrian / Pedestrian crossing road"] if highway else []
    )
    yield recipe(
        stage,
        "pedestrian_crossing",
        tuple(rows),
        "A pedestrian crosses the road; the EGO stops",
        ego(stage, stops(stage)),
        crosser(stage, "walker", 1.3, **who),
        duration=10.0,
    )
    yield recipe(
        stage,
        "pedestrian_darting",
        (f"{group} / {name}: vehicle going straight and pedestrian darting onto road",),
        "A pedestrian runs onto the road; the EGO stops",
        ego(stage, stops(stage)),
        crosser(stage, "runner", profile((0.0, 0.0), (2.5, 0.0), (3.6, 4.0)), **who),
        duration=10.0,
    )
    at = stage.s + FAR * stage.scale
    yield recipe(
        stage,
        "pedestrian_on_road",
        (f"{group} / {name}: vehicle going straight and pedestrian playing / working on Road",),
        "Two people are on the lane and move about; the EGO stops",
        ego(stage, stops(stage)),
        _about(stage, "one", at),
        _about(stage, "two", at + 4.0),
        duration=10.0,
    )
    outer = stage.right if highway else stage.ego
    yield recipe(
        stage,
        "pedestrian_along",
        (f"{group} / {name}: vehicle going straight and pedestrian walking along road",),
        "A pedestrian walks along the edge of the road; the EGO passes in the next lane",
        ego(stage, 0.8 * stage.v, change=[] if highway else [change("left", 0.5, 3.0)]),
        on(stage, "walker", outer, 60.0 if highway else 100.0, 1.4, offset=-1.5, **who),
    )
    yield recipe(
        stage,
        "pedestrian_crowd",
        (
            "Pedestrian / Driving through pedestrian crowd"
            if highway
            else f"{AVOID} / Driving through pedestrian crowd",
        ),
        "The EGO drives slowly through a crowd that stands on both sides",
        _slow_ego(stage),
        *_crowd(stage),
        duration=12.0,
    )
    yield recipe(
        stage,
        "pedestrian_backing",
        (f"{group} / {name}: vehicle backing",),
        "A vehicle backs towards a pedestrian who walks behind it",
        ego(stage, 0.5 * stage.v, offset=0.0),
        free(
            "backing",
            stage.road,
            outer,
            round(at, 2),
            profile((0.0, 0.0), (1.0, 0.0), (3.0, 1.5), (7.0, 0.0)),
            against=True,
            reverse=True,
        ),
        free("walker", stage.road, outer, round(at - 14.0, 2), 0.8, offset=-1.2, **who),
        duration=4.0 if highway else 5.0,
    )
    yield from crashes(stage, "Pedestrian" if highway else CRASH, "Pedestrian", "pedestrian", who, 2.6)


def _slow_ego(stage: Stage) -> Object:
    return on(stage, "ego", stage.ego, FAR - 20.0 / stage.scale, 2.5)


def _crowd(stage: Stage) -> list[Object]:
    made = []
    for n in range(-3, 5):
        gap, pace, aside = FAR + 2.5 * n / stage.scale, round(0.3 + 0.1 * (n % 3), 1), 1.5 if n % 2 else -1.5
        made.append(on(stage, f"walker{n}", stage.ego, gap, pace, offset=aside, kind="pedestrian"))
    return made


def _about(stage: Stage, name: str, s: float) -> Object:
    """Somebody who goes to and fro in the lane."""
    route: Sequence[tuple[float, float]] = (
        (0.0, -1.0),
        (1.0, -0.3),
        (0.5, 0.6),
        (1.5, 1.0),
        (2.2, 0.2),
        (1.6, -0.7),
    )
    places = [place(stage.road, stage.ego, round(s + ds, 2), d) for ds, d in route]
    return {"id": name, "kind": "pedestrian", "route": {"places": places}, "speed": 0.5}
