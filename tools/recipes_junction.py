"""Recipes at the junctions of the town: turns, crossing paths, parking, and who does not stop."""

from __future__ import annotations

from collections.abc import Iterator

from recipe_parts import Object, RecipeText, across, change, free, profile

LANE, LAW, AVOID, CRASH = "Lane change", "Violating traffic laws", "Avoiding maneuvers", "Accident scenarios"
PROTECTED, UNPROTECTED = "Protected turn / road crossing", "Unprotected turn / road crossing"
WALKED = "turn while pedestrian / cyclist crossing road"
YIELDS_LEFT = {"ways": [0.0, 20.0, 74.0, 110.0], "values": [11.0, 10.0, 1.5, 7.0]}
YIELDS_RIGHT = {"ways": [0.0, 20.0, 66.0, 100.0], "values": [11.0, 10.0, 1.5, 7.0]}
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
        duration=13.0,
    )
    walker = across("walker", "4", 6.0, (-2, -1, 1, 2), 1.2, kind="pedestrian", appears=4.0)
    yield town(
        "protected_left_pedestrian",
        (f"Protected {WALKED} / Protected left turn with pedestrian / cyclist crossing road",),
        "The EGO turns left at the lights and lets a pedestrian pass behind them; oncoming traffic waits",
        left(YIELDS_LEFT),
        oncoming,
        walker,
        duration=20.0,
    )
    walker = across("walker", "3", 416.9, (-2, -1, 1, 2), 1.2, kind="pedestrian", appears=4.0)
    yield town(
        "protected_right_pedestrian",
        (f"Protected {WALKED} / Protected right turn with pedestrian / cyclist crossing road",),
        "The EGO turns right at the lights and lets a pedestrian pass behind them; crossing traffic waits",
        right(YIELDS_RIGHT),
        north,
        walker,
        duration=20.0,
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
        duration=19.0,
    )
    yield town(
        "unprotected_right",
        (f"{UNPROTECTED} / Unprotected right turn",),
        "The EGO comes from the side road, waits for traffic on the main road and turns right",
        free("ego", "6", -1, 165.0, waits, via=["206"]),
        free("main", "2", -2, 150.0, 12.5, via=["201"]),
        duration=19.0,
    )
    yield town(
        "unprotected_crossing",
        (f"{UNPROTECTED} / Unprotected road crossing",),
        "The EGO goes straight on past a side road without lights, from which another one waits to come",
        free("ego", "2", -1, 180.0, 12.0, via=["201"]),
        free("side", "6", -1, 194.0, 0.0),
    )
    slow = {"ways": [0.0, 30.0, 58.0, 90.0], "values": [10.0, 7.0, 1.5, 7.0]}
    yield town(
        "unprotected_left_pedestrian",
        (f"Unprotected {WALKED} / Unprotected left turn with pedestrian / cyclist crossing road",),
        "The EGO turns left and lets a pedestrian pass who crosses the side road",
        free("ego", "5", 1, 34.0, slow, via=["204"]),
        across("walker", "6", 188.0, (2, 1, -1, -2), 1.2, kind="pedestrian", appears=3.0),
        duration=20.0,
    )
    yield town(
        "unprotected_right_cyclist",
        (f"Unprotected {WALKED} / Unprotected right turn with pedestrian / cyclist crossing road",),
        "The EGO turns right and lets a cyclist pass who crosses the side road",
        free("ego", "2", -2, 226.0, slow, via=["202"]),
        across("cyclist", "6", 188.0, (2, 1, -1, -2), 1.5, kind="bicycle", appears=3.5),
        duration=20.0,
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
        duration=20.0,
    )
    turns = {"ways": [0.0, 30.0, 60.0, 100.0], "values": [10.0, 8.0, 6.0, 8.0]}
    yield town(
        "passing_and_turning",
        (f"{LANE} / 1 vehicle passing and another turning",),
        "The EGO passes a slow vehicle, ahead of which another one turns right",
        free("ego", "2", -2, 90.0, 12.0, via=["201"], change=[change("left", 1.0, 4.0)]),
        free("slow", "2", -2, 150.0, 6.0, via=["201"]),
        turning | {"route": turning["route"] | {"s": 200.0}, "speed": turns},
        duration=14.0,
    )


def _cyclists() -> Iterator[RecipeText]:
    row = f"{AVOID} / Avoiding cyclist: vehicle turning"
    yield town(
        "cyclist_left_crossing",
        (f"{row} left on crossing paths",),
        "The EGO turns left and lets a cyclist pass who crosses the road that it turns into",
        left(YIELDS_LEFT),
        across("cyclist", "4", 6.0, (-2, -1, 1, 2), 2.0, kind="bicycle", appears=5.0),
        duration=20.0,
    )
    waits = {"ways": [0.0, 20.0, 66.0, 105.0], "values": [11.0, 10.0, 1.5, 7.0]}
    yield town(
        "cyclist_left_parallel",
        (f"{row} left on parallel paths",),
        "The EGO turns left behind a cyclist who comes the other way",
        left(waits),
        free("cyclist", "2", 2, 45.0, 6.0, via=["104"], kind="bicycle", offset=-1.0),
        duration=20.0,
    )
    yield town(
        "cyclist_right_crossing",
        (f"{row} right on crossing paths",),
        "The EGO turns right and lets a cyclist pass who crosses the road that it turns into",
        right(YIELDS_RIGHT),
        across("cyclist", "3", 416.9, (-2, -1, 1, 2), 2.0, kind="bicycle", appears=5.0),
        duration=20.0,
    )
    yield town(
        "cyclist_right_parallel",
        (f"{row} right on parallel paths",),
        "The EGO turns right behind a cyclist beside it who goes straight on",
        right({"ways": [0.0, 20.0, 50.0, 66.0, 100.0], "values": [9.0, 8.0, 5.0, 4.0, 8.0]}),
        free("cyclist", "1", -2, 252.0, 7.0, via=["101"], kind="bicycle", offset=-1.4),
        duration=18.0,
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
        "A vehicle backs away from the lights, into the EGO, which stops behind it",
        free("ego", "1", -2, 215.0, {"ways": [0.0, 10.0, 62.5], "values": [10.0, 10.0, 0.0]}),
        free(
            "backing",
            "1",
            -2,
            296.0,
            profile((0.0, 0.0), (2.0, 0.0), (4.0, 2.0), (9.0, 2.0), (12.0, 0.0)),
            against=True,
            reverse=True,
        ),
        duration=10.5,
        overlaps=(("ego", "backing"),),
    )


def _crossing_paths() -> Iterator[RecipeText]:
    def crash(name: str, row: str, text: str, *objects: Object, duration: float) -> RecipeText:
        pair = (str(objects[0]["id"]), str(objects[1]["id"]))
        rows = (f"{CRASH} / Crossing paths: {row}",)
        return town(name, rows, text, *objects, duration=duration, overlaps=(pair,))

    def main(lane: int, s: float) -> Object:
        return free("ego", "2", lane, s, 12.0, via=["201"])

    yield crash(
        "left_across_lateral",
        "left turn across path from lateral direction",
        "A vehicle from the side road turns left across the EGO's way, and they collide",
        main(-1, 166.0),
        free("turning", "6", -1, 160.0, 7.0, via=["205"]),
        duration=9.0,
    )
    yield crash(
        "left_across_opposite",
        "left turn across path from opposite direction",
        "An oncoming vehicle turns left across the EGO's way, and they collide",
        main(-1, 198.0),
        free("turning", "5", 1, 40.0, 7.0, via=["204"]),
        duration=7.6,
    )
    yield crash(
        "left_into_path",
        "left turn into path",
        "A vehicle from the side road turns left into the EGO's way, and they collide",
        free("ego", "5", 1, 75.0, 12.0, via=["203"]),
        free("turning", "6", -1, 170.0, 6.5, via=["205"]),
        duration=8.4,
    )
    steep = [(301.75, -50.0), (301.75, -35.0), (301.75, -20.0), (302.2, -12.0), (304.5, -6.0), (309.0, -2.6),
             (318.0, -1.75), (335.0, -1.75)]  # fmt: skip
    yield crash(
        "right_across_lateral",
        "right turn across path from lateral direction",
        "A vehicle from the side road turns right across the EGO's lane towards the lane beyond it, and they collide",
        main(-2, 183.0),
        {"id": "turning", "route": {"points": steep}, "speed": 5.0},
        duration=8.6,
    )
    yield crash(
        "right_into_path",
        "right turn into path",
        "A vehicle from the side road turns right into the EGO's lane, and they collide",
        main(-2, 207.0),
        free("turning", "6", -1, 170.0, 6.9, via=["206"]),
        duration=6.8,
    )
    yield crash(
        "straight_crossing",
        "straight crossing paths",
        "A vehicle crosses at the lights, and it and the EGO collide",
        free("ego", "1", -1, 220.0, 12.0, via=["101"]),
        free("crossing", "3", -1, 347.0, 11.0, via=["107"]),
        duration=8.7,
    )
    yield crash(
        "other_crossing",
        "other/unknown",
        "The EGO and a vehicle from its right both turn left, and they collide",
        left(),
        free("turning", "3", -1, 386.5, 8.0, via=["108"]),
        duration=8.0,
    )
