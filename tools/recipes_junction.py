"""Recipes at the junctions of the town: turns, crossing paths, parking, and who does not stop."""

from __future__ import annotations

from collections.abc import Iterator

from recipe_parts import Object, RecipeText, across, change, free, profile

LANE, LAW, AVOID, CRASH = "Lane change", "Violating traffic laws", "Avoiding maneuvers", "Accident scenarios"
PROTECTED, UNPROTECTED = "Protected turn / road crossing", "Unprotected turn / road crossing"
WALKED = "turn while pedestrian / cyclist crossing road"
LEFT = {"ways": [0.0, 25.0, 70.0, 110.0], "values": [11.0, 10.0, 6.5, 9.0]}
"""Over the way of who turns at the lights and starts 60 m ahead of them."""


def town(
    name: str, rows: tuple[str, ...], text: str, *objects: Object, duration: float = 12.0, **told: object
) -> RecipeText:
    kinds = tuple(f"urban / {row}" for row in rows)
    return RecipeText(f"urban_{name}", kinds, text, "urban", objects, duration, **told)


def junction_recipes() -> Iterator[RecipeText]:
    yield from _at_the_lights()
    yield from _at_the_signs()
    yield from _parking_and_turning()
    yield from _cyclists()
    yield from _backing()
    yield from _crossing_paths()


def left(speed: object = None) -> Object:
    return free("ego", "1", -1, 240.0, LEFT if speed is None else speed, via=["102"])


def right(speed: object = None) -> Object:
    return free("ego", "1", -2, 240.0, LEFT if speed is None else speed, via=["103"])


def _at_the_lights() -> Iterator[RecipeText]:
    oncoming, south = free("oncoming", "2", 1, 12.0, 0.0), free("south", "3", -1, 410.0, 0.0)
    north = free("north", "4", 1, 12.0, 0.0)
    yield town(
        "protected_left",
        (f"{PROTECTED} / Protected left turn",),
        "The EGO turns left at the lights; oncoming traffic waits",
        left(),
        oncoming,
    )
    yield town(
        "protected_right",
        (f"{PROTECTED} / Protected right turn",),
        "The EGO turns right at the lights; crossing traffic waits",
        right(),
        north,
    )
    yield town(
        "protected_crossing",
        (f"{PROTECTED} / Protected road crossing",),
        "The EGO crosses straight on at the lights; crossing traffic waits",
        free("ego", "1", -1, 200.0, 12.0, via=["101"]),
        south,
        north,
        duration=10.0,
    )
    yields = {"ways": [0.0, 20.0, 74.0], "values": [11.0, 10.0, 0.0]}
    walker = across("walker", "4", 6.0, (-2, -1, 1, 2), 1.2, kind="pedestrian", appears=4.0)
    yield town(
        "protected_left_pedestrian",
        (f"Protected {WALKED} / Protected left turn with pedestrian / cyclist crossing road",),
        "The EGO turns left at the lights and waits for a pedestrian on the crosswalk behind them",
        left(yields),
        oncoming,
        walker,
    )
    walker = across("walker", "3", 416.9, (-2, -1, 1, 2), 1.2, kind="pedestrian", appears=4.0)
    yield town(
        "protected_right_pedestrian",
        (f"Protected {WALKED} / Protected right turn with pedestrian / cyclist crossing road",),
        "The EGO turns right at the lights and waits for a pedestrian on the crosswalk behind them",
        right(yields),
        walker,
    )


def _at_the_signs() -> Iterator[RecipeText]:
    waits = profile((0.0, 9.0), (6.0, 0.0), (9.0, 0.0), (12.0, 7.0))
    first = free("oncoming", "2", -1, 150.0, 12.5, via=["201"])
    yield town(
        "unprotected_left",
        (f"{UNPROTECTED} / Unprotected left turn",),
        "The EGO waits for oncoming traffic and turns left",
        free("ego", "5", 1, 35.0, waits, via=["204"]),
        first,
        duration=15.0,
    )
    yield town(
        "unprotected_right",
        (f"{UNPROTECTED} / Unprotected right turn",),
        "The EGO comes from the side road, waits for traffic on the main road and turns right",
        free("ego", "6", -1, 165.0, waits, via=["206"]),
        free("main", "2", -2, 150.0, 12.5, via=["201"]),
        duration=15.0,
    )
    yield town(
        "unprotected_crossing",
        (f"{UNPROTECTED} / Unprotected road crossing",),
        "The EGO goes straight on past a side road without lights, from which another one waits to come",
        free("ego", "2", -1, 180.0, 12.0, via=["201"]),
        free("side", "6", -1, 194.0, 0.0),
    )
    slow = {"ways": [0.0, 30.0, 58.0], "values": [10.0, 7.0, 0.0]}
    yield town(
        "unprotected_left_pedestrian",
        (f"Unprotected {WALKED} / Unprotected left turn with pedestrian / cyclist crossing road",),
        "The EGO turns left and waits for a pedestrian who crosses the side road",
        free("ego", "5", 1, 34.0, slow, via=["204"]),
        across("walker", "6", 188.0, (2, 1, -1, -2), 1.2, kind="pedestrian", appears=3.0),
    )
    yield town(
        "unprotected_right_cyclist",
        (f"Unprotected {WALKED} / Unprotected right turn with pedestrian / cyclist crossing road",),
        "The EGO turns right and waits for a cyclist who crosses the side road",
        free("ego", "2", -2, 226.0, slow, via=["202"]),
        across("cyclist", "6", 188.0, (2, 1, -1, -2), 1.5, kind="bicycle", appears=3.5),
    )
    yield town(
        "crossing_road",
        (
            "Pedestrian / cyclist / animal / etc. crossing road / Pedestrian / cyclist / animal / etc. crossing road",
        ),
        "A pedestrian crosses on a crosswalk without lights; the EGO stops before it",
        free("ego", "5", -2, 40.0, {"ways": [0.0, 15.0, 70.0], "values": [12.0, 12.0, 0.0]}),
        across("walker", "5", 120.0, (-3, -2, -1, 1, 2, 3), 1.3, kind="pedestrian"),
        duration=14.0,
    )
    run = free("runner", "6", -1, 110.0, 9.0, via=["206"])
    yield town(
        "running_stop_sign",
        (f"{LAW} / Running stop sign",),
        "A vehicle turns at the stop sign without a stop",
        free("ego", "2", -2, 90.0, 10.0, via=["201"]),
        run,
        duration=15.0,
    )
    yield town(
        "violating_signs",
        (f"{LAW} / Violating traffic signs",),
        "A vehicle does not give way at the sign: the EGO on the priority road brakes",
        free(
            "ego",
            "2",
            -2,
            150.0,
            {"ways": [0.0, 60.0, 125.0, 200.0], "values": [12.0, 12.0, 5.0, 6.0]},
            via=["201"],
        ),
        free(
            "violator",
            "6",
            -1,
            140.0,
            {"ways": [0.0, 60.0, 90.0, 150.0], "values": [9.0, 7.0, 7.0, 11.0]},
            via=["206"],
        ),
        duration=14.0,
    )


def _parking_and_turning() -> Iterator[RecipeText]:
    leaving = free(
        "parked",
        "1",
        -3,
        130.0,
        profile((0.0, 0.0), (2.0, 0.0), (7.0, 9.0)),
        change=[change("left", 2.0, 5.0)],
    )
    yield town(
        "leaving_parking",
        (f"{LANE} / 1 vehicle going straight and another entering or leaving parking position",),
        "A vehicle leaves its parking position; the EGO passes in the left lane",
        free("ego", "1", -1, 60.0, 12.0),
        leaving,
        free("other", "1", -3, 110.0, 0.0),
        duration=10.0,
    )
    turning = free(
        "turning",
        "2",
        -2,
        140.0,
        {"ways": [0.0, 60.0, 120.0, 160.0], "values": [11.0, 10.0, 6.0, 8.0]},
        via=["202"],
    )
    yield town(
        "straight_and_turning",
        (f"{LANE} / 1 vehicle going straight and another turning",),
        "The vehicle ahead slows down and turns right; the EGO goes straight on behind it",
        free(
            "ego",
            "2",
            -2,
            100.0,
            {"ways": [0.0, 60.0, 130.0, 220.0], "values": [11.0, 10.0, 6.0, 11.0]},
            via=["201"],
        ),
        turning,
        duration=16.0,
    )
    yield town(
        "passing_and_turning",
        (f"{LANE} / 1 vehicle passing and another turning",),
        "The EGO passes a vehicle that slows down and turns right",
        free("ego", "2", -2, 90.0, 12.0, via=["201"], change=[change("left", 1.0, 4.0)]),
        turning,
        duration=14.0,
    )


def _cyclists() -> Iterator[RecipeText]:
    row = f"{AVOID} / Avoiding cyclist: vehicle turning"
    yields = {"ways": [0.0, 20.0, 74.0], "values": [11.0, 10.0, 0.0]}
    yield town(
        "cyclist_left_crossing",
        (f"{row} left on crossing paths",),
        "The EGO turns left and waits for a cyclist who crosses the road that it turns into",
        left(yields),
        across("cyclist", "4", 6.0, (-2, -1, 1, 2), 2.0, kind="bicycle", appears=5.0),
    )
    waits = {"ways": [0.0, 20.0, 66.0], "values": [11.0, 10.0, 0.0]}
    yield town(
        "cyclist_left_parallel",
        (f"{row} left on parallel paths",),
        "The EGO waits to turn left for a cyclist who comes the other way",
        left(waits),
        free("cyclist", "2", 2, 45.0, 6.0, via=["104"], kind="bicycle", offset=-1.0),
    )
    yield town(
        "cyclist_right_crossing",
        (f"{row} right on crossing paths",),
        "The EGO turns right and waits for a cyclist who crosses the road that it turns into",
        right(yields),
        across("cyclist", "3", 416.9, (-2, -1, 1, 2), 2.0, kind="bicycle", appears=5.0),
    )
    yield town(
        "cyclist_right_parallel",
        (f"{row} right on parallel paths",),
        "The EGO turns right behind a cyclist beside it who goes straight on",
        right({"ways": [0.0, 20.0, 50.0, 66.0, 100.0], "values": [9.0, 8.0, 5.0, 4.0, 8.0]}),
        free("cyclist", "1", -2, 252.0, 7.0, via=["101"], kind="bicycle", offset=-1.4),
        duration=14.0,
    )


def _backing() -> Iterator[RecipeText]:
    yield town(
        "backing_into_vehicle",
        (f"{CRASH} / Backing up into another vehicle",),
        "A vehicle backs into the EGO, which stands behind it",
        free("ego", "1", -2, 150.0, 0.0),
        free(
            "backing",
            "1",
            -2,
            164.0,
            profile((0.0, 0.0), (1.0, 0.0), (3.0, 2.0), (9.0, 2.0)),
            against=True,
            reverse=True,
        ),
        duration=7.0,
        overlaps=(("ego", "backing"),),
    )
    yield town(
        "backing_at_intersection",
        (f"{CRASH} / Backing: at intersections",),
        "A vehicle backs away from the lights; the EGO stops behind it",
        free("ego", "1", -2, 210.0, {"ways": [0.0, 10.0, 50.0], "values": [10.0, 10.0, 0.0]}),
        free(
            "backing",
            "1",
            -2,
            290.0,
            profile((0.0, 0.0), (3.0, 0.0), (5.0, 2.0), (9.0, 2.0), (11.0, 0.0)),
            against=True,
            reverse=True,
        ),
    )


def _crossing_paths() -> Iterator[RecipeText]:
    def row(text: str) -> tuple[str]:
        return (f"{CRASH} / Crossing paths: {text}",)

    brakes = {"ways": [0.0, 40.0, 90.0], "values": [12.0, 12.0, 0.0]}
    main = free("ego", "2", -1, 166.0, brakes, via=["201"])
    turns = {"ways": [0.0, 50.0, 120.0], "values": [7.0, 7.0, 9.0]}
    yield town(
        "left_across_lateral",
        row("left turn across path from lateral direction"),
        "A vehicle from the side road turns left across the EGO's way; the EGO stops",
        main,
        free("turning", "6", -1, 160.0, turns, via=["205"]),
    )
    yield town(
        "left_across_opposite",
        row("left turn across path from opposite direction"),
        "An oncoming vehicle turns left across the EGO's way; the EGO stops",
        main,
        free("turning", "5", 1, 35.0, turns, via=["204"]),
    )
    west = free(
        "ego",
        "5",
        1,
        110.0,
        {"ways": [0.0, 50.0, 120.0, 200.0], "values": [12.0, 12.0, 5.0, 7.0]},
        via=["203"],
    )
    yield town(
        "left_into_path",
        row("left turn into path"),
        "A vehicle from the side road turns left into the EGO's way, ahead of it",
        west,
        free(
            "turning", "6", -1, 170.0, {"ways": [0.0, 60.0, 120.0], "values": [6.0, 7.0, 11.0]}, via=["205"]
        ),
        duration=15.0,
    )
    east = free(
        "ego",
        "2",
        -2,
        166.0,
        {"ways": [0.0, 40.0, 100.0, 200.0], "values": [12.0, 12.0, 4.0, 8.0]},
        via=["201"],
    )
    yield town(
        "right_across_lateral",
        row("right turn across path from lateral direction"),
        "A vehicle from the side road turns right across the EGO's lane into the lane beyond it",
        east,
        free(
            "turning",
            "6",
            -1,
            170.0,
            {"ways": [0.0, 60.0, 120.0], "values": [6.5, 7.5, 11.0]},
            via=["206"],
            change=[{"to": "left", "at": 62.0, "seconds": 4.0}],
        ),
        duration=15.0,
    )
    yield town(
        "right_into_path",
        row("right turn into path"),
        "A vehicle from the side road turns right into the EGO's lane, ahead of it",
        east,
        free(
            "turning", "6", -1, 170.0, {"ways": [0.0, 60.0, 120.0], "values": [6.5, 7.5, 11.0]}, via=["206"]
        ),
        duration=15.0,
    )
    yield town(
        "straight_crossing",
        row("straight crossing paths"),
        "A vehicle crosses at the lights ahead of the EGO, which brakes",
        free("ego", "1", -1, 200.0, {"ways": [0.0, 30.0, 92.0], "values": [12.0, 12.0, 0.0]}, via=["101"]),
        free("crossing", "3", -1, 350.0, 11.0, via=["107"]),
    )
    yield town(
        "other_crossing",
        row("other/unknown"),
        "Two who come towards each other turn left, and their ways cross; the EGO waits inside",
        left({"ways": [0.0, 20.0, 60.0], "values": [11.0, 9.0, 0.0]}),
        free("oncoming", "2", 1, 62.0, {"ways": [0.0, 40.0, 90.0], "values": [11.0, 7.0, 9.0]}, via=["105"]),
    )
