"""Every threshold of mining by its name, in a TOML file; what a file leaves out is as `scenarios/mining/labels.toml`.

The sources stand beside the numbers in that file; here is what each means.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from resim.core.errors import InputError
from resim.core.spec import ModuleAndName, Strict, TextPattern, strict_of
from resim.scenario import maneuvers

EXAMPLE = "See scenarios/mining/labels.toml"
Distance = Literal["centre", "bumper"]
Place = Literal["map", "town", "open road"]


class LaneChangeThresholds(Strict):
    """Whether (close [m] to the lane's centre: Kaefer), and from when to when (lateral_speed [m/s]: Wagner)."""

    close: float = Field(default=maneuvers.CLOSE_TO_CENTRE, gt=0.0)
    lateral_speed: float = Field(default=maneuvers.NEUTRAL_ACROSS, ge=0.0)


class CutSettings(Strict):
    """Cut-ins and cut-outs: time to collision [s] strictly below ttc, by distances from centre or bumper."""

    ttc: float = Field(default=maneuvers.CUT_TTC, gt=0.0)
    distance: Distance = "centre"


class TailgatingSettings(Strict):
    """Distances that are too short (Kaefer 2022, Table 4.3).

    place: town or open road, or as the map has it (road type, else a limit up to slow_limit [m/s]). restore [s]: time
    to restore the distance after somebody entered ahead; restore_fast [s] above fast [m/s]. minor_below [m/s]: speed
    below which it is never more than minor; severe_above [m/s]. half, third: shares of the required distance below
    which it is moderate, severe. shortest [s]: labels that last less are none.
    """

    distance: Distance = "centre"
    place: Place = "map"
    slow_limit: float = Field(default=50.0 / 3.6, ge=0.0)
    restore: float = Field(default=3.0, ge=0.0)
    restore_fast: float = Field(default=1.0, ge=0.0)
    fast: float = Field(default=160.0 / 3.6, ge=0.0)
    minor_below: float = Field(default=80.0 / 3.6, ge=0.0)
    severe_above: float = Field(default=100.0 / 3.6, ge=0.0)
    moderate_share: float = Field(default=0.5, gt=0.0, le=1.0)
    severe_share: float = Field(default=0.3, gt=0.0, le=1.0)
    shortest: float = Field(default=0.0, ge=0.0)


class SpeedingSettings(Strict):
    """Strictly faster than the limit plus tolerance [m/s]; limit [m/s]: where the map has none. join [s]: see
    `join` of standing.
    """

    tolerance: float = Field(default=0.0, ge=0.0)
    limit: float | None = Field(default=None, gt=0.0)
    join: float = Field(default=1.0, ge=0.0)


class StandingSettings(Strict):
    """Speeds up to `speed` [m/s] either way. join [s]: what is less apart is one; shortest [s]: the least duration."""

    speed: float = Field(default=0.1, ge=0.0)
    join: float = Field(default=1.0, ge=0.0)
    shortest: float = Field(default=0.0, ge=0.0)


class AccelerationSettings(Strict):
    """braking, acceleration [m/s²]: the speed changes by more than they do in `within` [s], within that time."""

    braking: float = Field(default=maneuvers.STRONG_BRAKING, lt=0.0)
    acceleration: float = Field(default=maneuvers.STRONG_ACCELERATION, gt=0.0)
    within: float = Field(default=1.0, gt=0.0)


class TurnSettings(Strict):
    """Ways through junctions: straight up to `straight` [rad] of turning, a U-turn from `u_turn` [rad] on.

    radius [m]: a junction without any turn as tight as this is a fork or a merge, and no crossing.
    """

    straight: float = Field(default=0.52, gt=0.0, lt=1.6)
    u_turn: float = Field(default=2.4, gt=1.6, le=3.15)
    radius: float = Field(default=60.0, gt=0.0)


class SwervingSettings(Strict):
    """`swings` of `swing` [m] or more across the lane, to and fro, within `within` [s] but for 0.3 at either end."""

    swing: float = Field(default=1.0, gt=0.0)
    swings: int = Field(default=3, ge=2)
    within: float = Field(default=10.0, gt=0.0)


class WrongWaySettings(Strict):
    """Faster than `speed` [m/s] against the lane for `shortest` [s] or longer; what begins and ends with lane changes
    and takes up to `overtaking` [s] is overtaking over the oncoming lane.
    """

    speed: float = Field(default=1.0, ge=0.0)
    shortest: float = Field(default=1.0, ge=0.0)
    overtaking: float = Field(default=20.0, ge=0.0)


class PassingSettings(Strict):
    """Going by somebody on the next lane. slowest [m/s]: of who passes; near [m]: as far as both are near, it lasts."""

    slowest: float = Field(default=1.0, ge=0.0)
    near: float = Field(default=20.0, gt=0.0)


class FollowingSettings(Strict):
    """Keeping to a lane for `shortest` [s] or longer, faster than `speed` [m/s]."""

    speed: float = Field(default=0.1, ge=0.0)
    shortest: float = Field(default=2.0, ge=0.0)


class CriticalSettings(Strict):
    """Time to collision and headway [s] strictly below these, by bumpers; join, shortest [s]: as of standing."""

    ttc: float = Field(default=1.5, gt=0.0)
    thw: float = Field(default=0.5, gt=0.0)
    join: float = Field(default=0.5, ge=0.0)
    shortest: float = Field(default=0.0, ge=0.0)


class OnFootSettings(Strict):
    """Pedestrians. running [m/s]: from this speed on, who crosses runs. staying [s]: who is then still within
    staying_radius [m] stays there all that time. crowd: so many within crowd_radius [m] of a vehicle are a crowd.
    """

    running: float = Field(default=2.5, gt=0.0)
    staying: float = Field(default=5.0, gt=0.0)
    staying_radius: float = Field(default=3.0, gt=0.0)
    crowd: int = Field(default=5, ge=2)
    crowd_radius: float = Field(default=10.0, gt=0.0)


class StartingSettings(Strict):
    """Who stood and reaches `speed` [m/s] within `within` [s] starts."""

    speed: float = Field(default=2.0, gt=0.0)
    within: float = Field(default=5.0, gt=0.0)


class SkiddingSettings(Strict):
    """Moving `angle` [rad] or more off one's heading, faster than `speed` [m/s], for `shortest` [s] or longer."""

    angle: float = Field(default=0.26, gt=0.0)
    speed: float = Field(default=8.0, gt=0.0)
    shortest: float = Field(default=0.3, ge=0.0)


class RoadEdgeSettings(Strict):
    """Who is beyond the driven lanes for `shortest` [s] or longer, or till it is seen no more, has left the road."""

    shortest: float = Field(default=0.5, ge=0.0)


class RightOfWaySettings(Strict):
    """Lights and stop signs of the map. near [m]: a signal stands up to so far before its junction, and who is held up
    there stands so near. stop_speed [m/s]: who is no slower within stop_before [m] of the junction did not stop,
    and who backs up so near to it backs up at it.
    """

    near: float = Field(default=50.0, gt=0.0)
    stop_speed: float = Field(default=0.5, ge=0.0)
    stop_before: float = Field(default=20.0, gt=0.0)


class CrashSettings(Strict):
    """Collisions by how they came about. lately [s]: who was in a junction so lately comes from there.

    along [rad]: up to so much between headings, both go the same way. across [rad]: from so much on, who turns right
    is still across the other's way.
    """

    lately: float = Field(default=3.0, ge=0.0)
    along: float = Field(default=0.52, gt=0.0)
    across: float = Field(default=0.79, gt=0.0)


class RegionSettings(Strict):
    """A place of one's own on a map (Kaefer 2022, Fig. 4.48): `corners` [m] in the map's frame.

    map: file names (a pattern) of the maps it lies on.
    """

    name: str = Field(min_length=1)
    corners: list[tuple[float, float]] = Field(min_length=3)
    map: str = "*"


class RegionWaySettings(Strict):
    """Who passes one region, and later another, gets a label.

    span: from leaving `first` to entering `then` ("between"), or from entering `first` to the last sample in `then`
    ("whole", as Kaefer's ramps).
    """

    label: str = Field(min_length=1)
    first: str
    then: str
    span: Literal["between", "whole"] = "between"


class OwnLabelSettings(Strict):
    """A label of one's own: `function` is "module:name", the module's file beside this one.

    It takes `Features` and the maneuvers found so far, and gives maneuvers (see `resim.mining.maneuver`).
    """

    name: Annotated[str, TextPattern(r"^[a-z][a-z0-9_]*$", "a name of small letters, digits and underscores")]
    function: ModuleAndName


class ExtractionSettings(Strict):
    """Which scenarios are cut out.

    trigger: labels that begin one. beside, ahead, behind [m]: the slots of the eight-vehicle model. own: whether the
    EGO's maneuvers trigger too. before, after [s]: added to every trigger. shortest [s]: a window that lasts less is
    none.
    """

    trigger: tuple[str, ...] = ("lane_change_left", "lane_change_right")
    beside: float = Field(default=5.0, ge=0.0)
    ahead: float = Field(default=100.0, gt=0.0)
    behind: float = Field(default=50.0, gt=0.0)
    own: bool = False
    before: float = Field(default=0.0, ge=0.0)
    after: float = Field(default=0.0, ge=0.0)
    shortest: float = Field(default=0.0, ge=0.0)


class AroundSettings(Strict):
    """Windows of `--around`: before, after [s] a moment, and how many of a recording at most, the worst first."""

    before: float = Field(default=5.0, ge=0.0)
    after: float = Field(default=3.0, ge=0.0)
    most: int = Field(default=10, ge=1)


class MiningSettings(Strict):
    """What the file says. kinds: of objects that are labelled. files: data of one's own functions."""

    kinds: tuple[str, ...] = ("car", "van", "truck", "bus", "trailer", "motorcycle", "unknown")
    files: tuple[str, ...] = ()
    lane_change: LaneChangeThresholds = LaneChangeThresholds()
    cut: CutSettings = CutSettings()
    tailgating: TailgatingSettings = TailgatingSettings()
    speeding: SpeedingSettings = SpeedingSettings()
    standing: StandingSettings = StandingSettings()
    acceleration: AccelerationSettings = AccelerationSettings()
    turn: TurnSettings = TurnSettings()
    swerving: SwervingSettings = SwervingSettings()
    wrong_way: WrongWaySettings = WrongWaySettings()
    passing: PassingSettings = PassingSettings()
    follow_lane: FollowingSettings = FollowingSettings()
    critical: CriticalSettings = CriticalSettings()
    on_foot: OnFootSettings = OnFootSettings()
    starting: StartingSettings = StartingSettings()
    skidding: SkiddingSettings = SkiddingSettings()
    road_edge: RoadEdgeSettings = RoadEdgeSettings()
    right_of_way: RightOfWaySettings = RightOfWaySettings()
    crash: CrashSettings = CrashSettings()
    region: tuple[RegionSettings, ...] = ()
    way: tuple[RegionWaySettings, ...] = ()
    label: tuple[OwnLabelSettings, ...] = ()
    extraction: ExtractionSettings = ExtractionSettings()
    around: AroundSettings = AroundSettings()

    @model_validator(mode="after")
    def _known_regions(self) -> MiningSettings:
        known = {region.name for region in self.region}
        for way in self.way:
            for name in (way.first, way.then):
                if name not in known:
                    raise ValueError(f"way {way.label!r}: there is no region {name!r}")
        return self


DEFAULT_SETTINGS = MiningSettings()


def settings_of(raw: bytes, path: Path) -> MiningSettings:
    """Give what the bytes of a file of thresholds say. Raises InputError naming every fault."""
    return strict_of(raw, path, MiningSettings, EXAMPLE)


def check_triggers(settings: MiningSettings, known: tuple[str, ...], where: str) -> None:
    """Refuse triggers that no label has. Raises InputError."""
    unknown = [name for name in settings.extraction.trigger if name not in known]
    if unknown:
        raise InputError(where, f"there is no label {unknown[0]!r}", f"Labels: {', '.join(known)}.")
