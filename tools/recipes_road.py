"""Recipes of what vehicles do to each other along a road: lane changes, lead vehicles, violations."""

from __future__ import annotations

from collections.abc import Iterator

from recipe_parts import (
    HIGHWAY,
    URBAN,
    URBAN_LEFT,
    Object,
    RecipeText,
    Stage,
    change,
    free,
    on,
    profile,
    shift,
)

LANE, LEAD, LAW, ROAD = "Lane change", "Lead vehicle maneuver", "Violating traffic laws", "Road geometry"
PACE = "Strong acceleration / deceleration"


def road_recipes() -> Iterator[RecipeText]:
    for stage in (HIGHWAY, URBAN):
        yield from _lane_changes(stage)
        yield from _lead(stage)
        yield from _pace(stage)
        yield from _violations(stage)
    yield from _geometry()


def recipe(
    stage: Stage, name: str, rows: tuple[str, ...], text: str, *objects: Object, **told: object
) -> RecipeText:
    kinds = tuple(f"{stage.catalog} / {row}" for row in rows)
    return RecipeText(f"{stage.catalog}_{name}", kinds, text, stage.map, objects, **told)


def ego(stage: Stage, speed: object = None, **told: object) -> Object:
    return on(stage, "ego", stage.ego, 0.0, stage.v if speed is None else speed, **told)


def _lane_changes(stage: Stage) -> Iterator[RecipeText]:
    v = stage.v
    low, ahead, lasts = (0.65 * v, 61.5, 2.0) if stage is HIGHWAY else (0.5 * v, 87.5, 1.2)
    yield recipe(
        stage,
        "encroaching_same_lane",
        (f"{LANE} / 2 vehicles going straight and 1 vehicle encroaching in same lane",),
        "Two go straight in one lane; a slower third changes into the gap between them, and the EGO brakes",
        ego(stage, profile((0.0, v), (4.0, v), (4.0 + lasts, low), (8.0, low))),
        on(stage, "lead", stage.ego, 150.0, v),
        on(stage, "third", stage.left, ahead, low, change=[change("right", 2.0, 4.0)]),
    )
    yield recipe(
        stage,
        "encroaching_other_lane",
        (f"{LANE} / 2 vehicles going straight and 1 vehicle encroaching into another lane",),
        "Two go straight; the one between them changes into the other lane",
        ego(stage),
        on(stage, "lead", stage.ego, 110.0, v),
        on(stage, "third", stage.ego, 50.0, v, change=[change("left", 2.0, 4.0)]),
    )
    yield recipe(
        stage,
        "one_changes_lane",
        (f"{LANE} / 1 vehicle going straight and another changing lane",),
        "One goes straight; another changes lane well ahead of it",
        ego(stage),
        on(stage, "other", stage.left, 55.0, 1.05 * v, change=[change("right", 2.0, 4.5)]),
    )
    yield recipe(
        stage,
        "one_passes",
        (f"{LANE} / 1 vehicle going straight and another passing",),
        "One goes straight; another passes it in the left lane",
        ego(stage, 0.8 * v),
        on(stage, "other", stage.left, -30.0, 1.05 * v),
    )
    row = "vehicle changing lane in absence of other vehicles"
    yield recipe(
        stage,
        "changes_lane_alone",
        (f"{LANE} / {row if stage is HIGHWAY else row.capitalize()}",),
        "A vehicle changes lane, and nobody else is there",
        ego(stage, change=[change("left", 2.0, 4.0)]),
    )


def _lead(stage: Stage) -> Iterator[RecipeText]:
    v = stage.v
    gap = 45.0
    slow, lasts = (56.5, 2.5) if stage is HIGHWAY else (64.0, 1.3)
    yield recipe(
        stage,
        "lead_accelerates",
        (f"{LEAD} / Lead vehicle strong acceleration",),
        "The lead vehicle accelerates strongly",
        ego(stage, 0.6 * v),
        on(
            stage,
            "lead",
            stage.ego,
            gap,
            profile((0.0, 0.6 * v), (2.0, 0.6 * v), (5.0, 0.6 * v + 9.0), (8.0, 0.6 * v + 9.0)),
        ),
    )
    yield recipe(
        stage,
        "lead_brakes",
        (f"{LEAD} / Lead vehicle strong deceleration",),
        "The lead vehicle brakes strongly, and the EGO after it",
        ego(stage, profile((0.0, v), (2.8, v), (5.8, 0.4 * v), (8.0, 0.4 * v))),
        on(stage, "lead", stage.ego, 60.0, profile((0.0, v), (2.0, v), (5.0, 0.35 * v), (8.0, 0.35 * v))),
    )
    yield recipe(
        stage,
        "lead_much_slower",
        (f"{LEAD} / Lead vehicle moving at much lower constant speed",),
        "The lead vehicle moves at a much lower constant speed; the EGO brakes late",
        ego(stage, profile((0.0, v), (2.0, v), (2.0 + lasts, 0.5 * v), (8.0, 0.5 * v))),
        on(stage, "lead", stage.ego, slow, 0.5 * v),
    )
    stop = {"ways": [0.0, round(20.0 * stage.scale, 1), round(150.0 * stage.scale, 1)], "values": [v, v, 0.0]}
    yield recipe(
        stage,
        "lead_stopped",
        (f"{LEAD} / Lead vehicle stopped",),
        "The lead vehicle stands; the EGO brakes to a standstill behind it",
        ego(stage, stop),
        on(stage, "lead", stage.ego, 175.0, 0.0),
        duration=12.0,
    )
    yield recipe(
        stage,
        "lead_changes_lane",
        (f"{LEAD} / Lead vehicle changing lanes",),
        "The lead vehicle changes to the left lane",
        ego(stage),
        on(stage, "lead", stage.ego, gap, v, change=[change("left", 2.0, 4.0)]),
    )
    near, low, braked = (10.0, 0.75 * v, 5.5) if stage is HIGHWAY else (35.0, 0.4 * v, 5.0)
    yield recipe(
        stage,
        "lead_cuts_in",
        (f"{LEAD} / Lead vehicle cutting-in",),
        "A faster vehicle overtakes, brakes as it cuts in close ahead, and so does the EGO",
        ego(stage, profile((0.0, v), (3.5, v), (braked, low - 0.05 * v), (9.0, low - 0.05 * v))),
        on(
            stage,
            "lead",
            stage.left,
            near,
            profile((0.0, 1.1 * v), (2.0, 1.1 * v), (3.5, low), (9.0, low)),
            change=[change("right", 2.0, 3.0)],
        ),
        duration=9.0,
    )
    yield recipe(
        stage,
        "lead_cuts_out",
        (f"{LEAD} / Lead vehicle cutting-out",),
        "The lead vehicle leaves the lane at the last moment and reveals a slow one",
        ego(stage, profile((0.0, v), (2.5, v), (6.0, 0.45 * v), (9.0, 0.45 * v))),
        on(stage, "lead", stage.ego, 35.0, v, change=[change("left", 1.0, 2.5)]),
        on(stage, "slow", stage.ego, 108.0, 0.4 * v),
        duration=9.0,
    )


def _pace(stage: Stage) -> Iterator[RecipeText]:
    v = stage.v
    yield recipe(
        stage,
        "strong_acceleration",
        (f"{PACE} / Strong acceleration",),
        "A vehicle accelerates strongly in the left lane",
        ego(stage, 0.7 * v),
        on(stage, "other", stage.left, 20.0, profile((0.0, 0.5 * v), (2.0, 0.5 * v), (5.0, 0.5 * v + 10.0))),
    )
    yield recipe(
        stage,
        "strong_deceleration",
        (f"{PACE} / Strong deceleration",),
        "A vehicle brakes strongly in the left lane",
        ego(stage),
        on(stage, "other", stage.left, 20.0, profile((0.0, v), (2.0, v), (5.0, max(v - 18.0, 0.0)))),
    )


def _violations(stage: Stage) -> Iterator[RecipeText]:
    v = stage.v
    fast = 1.5 * v
    yield recipe(
        stage,
        "speeding",
        (f"{LAW} / Speeding",),
        "A vehicle passes far above the speed limit",
        ego(stage, 0.9 * v),
        on(stage, "fast", stage.left, -40.0, fast),
        duration=6.0,
    )
    right = HIGHWAY if stage is HIGHWAY else URBAN_LEFT
    if stage is HIGHWAY:
        yield recipe(
            stage,
            "overtaking_right",
            (f"{LAW} / Overtaking right side",),
            "A vehicle overtakes on the right side",
            ego(stage, 0.8 * v),
            on(right, "other", right.right, -35.0, 1.1 * v),
        )
    weave = [
        shift(0.7, 0.5, 1.5),
        *(shift(0.7 * (-1) ** n, 2.0 * n, 2.0) for n in (1, 2, 3)),
        shift(0.0, 8.0, 1.8),
    ]
    yield recipe(
        stage,
        "swerving",
        (f"{LAW} / Irrational driving (swerving etc.)",),
        "A vehicle ahead swerves within its lane",
        ego(stage),
        on(stage, "other", stage.ego, 50.0, v, change=weave),
        duration=10.0,
    )
    yield recipe(
        stage,
        "tailgating",
        (f"{LAW} / Insufficient distance to leading vehicle (tailgate)",),
        "A vehicle follows the EGO far too closely",
        ego(stage),
        on(stage, "tailgater", stage.ego, -10.0 / stage.scale if stage.scale < 1 else -13.0, v),
    )
    ghost = (
        free("ghost", "2", -1, 640.0, 27.0, against=True)
        if stage is HIGHWAY
        else free("ghost", "2", -1, 250.0, 10.0, against=True)
    )
    yield recipe(
        stage,
        "ghost_driver",
        (f"{LAW} / Ghost driver",),
        "A vehicle comes the wrong way in the left lane",
        ego(stage, 0.9 * v),
        ghost,
        accept=("WRONG_WAY",),
        duration=9.0,
    )


def _geometry() -> Iterator[RecipeText]:
    both = ("highway", "urban")
    yield RecipeText(
        "widening_road",
        tuple(f"{c} / {ROAD} / Widening road" for c in both),
        "The road widens by a lane: a faster vehicle keeps the old lane, the EGO takes the new one",
        "motorway",
        (
            free("ego", "9", 3, 780.0, 27.0, change=[{"to": "right", "at": 260.0, "metres": 130.0}]),
            free("fast", "9", 3, 850.0, 28.0),
        ),
        14.0,
    )
    yield RecipeText(
        "merging_road",
        tuple(f"{c} / {ROAD} / Merging road" for c in both),
        "The right lane ends: who is on it merges between two others",
        "motorway",
        (
            free("ego", "9", 3, 2200.0, 27.0),
            free("lead", "9", 3, 2090.0, 27.0),
            free("merging", "9", 4, 2150.0, 27.5, change=[{"to": "left", "at": 105.0, "seconds": 5.0}]),
        ),
        14.0,
    )
    yield RecipeText(
        "exit_highway",
        tuple(f"{c} / {ROAD} / Exit highway" for c in both),
        "The lead vehicle changes to the exit lane and leaves by the ramp",
        "motorway",
        (
            free("ego", "2", -3, 860.0, 25.0, via=["201"]),
            free(
                "leaving",
                "2",
                -3,
                910.0,
                {"ways": [0.0, 200.0, 420.0], "values": [25.0, 24.0, 15.0]},
                via=["202"],
                change=[{"to": "right", "at": 185.0, "seconds": 4.0}],
            ),
        ),
        18.0,
    )
    yield RecipeText(
        "merge_into_highway",
        tuple(f"{c} / {ROAD} / Merge into highway" for c in both),
        "A vehicle accelerates on the entry lane and merges ahead of the EGO",
        "motorway",
        (
            free("ego", "1", -3, 100.0, profile((0.0, 28.0), (8.0, 28.0), (13.0, 26.0)), via=["101"]),
            free(
                "merging",
                "4",
                -1,
                250.0,
                {"ways": [0.0, 80.0, 260.0], "values": [18.0, 20.0, 29.0]},
                via=["102"],
                change=[{"to": "left", "at": 230.0, "seconds": 5.0}],
            ),
        ),
        16.0,
    )
