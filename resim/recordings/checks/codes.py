"""What a check can find: each code with its severity, what it means for a result, and the repair."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from resim.core.finding import SEVERITIES, Finding, Severity, Source


@dataclass(frozen=True)
class FindingCode:
    """One kind of finding. repair is "" where none is safe."""

    severity: Severity
    meaning: str
    repair: str = ""


CODES: Mapping[str, FindingCode] = {
    "MISSING_VALUES": FindingCode(
        "warning",
        "rows without a position, heading or speed cannot be used",
        "interpolate the values like a gap, marked; in longer gaps they stay empty",
    ),
    "MISSING_SAMPLES": FindingCode(
        "note", "the track is interpolated over the hole", "fill the hole along the track, marked"
    ),
    "GAP": FindingCode(
        "warning",
        "no error is computed inside the gap; after more than 1 s the object counts as another one",
        "bridge it along the track where it is no longer than --max-gap (1 s), marked",
    ),
    "DUPLICATE_SAMPLES": FindingCode(
        "warning", "an object has more than one row at one time", "keep the first of the rows"
    ),
    "REPEATED_SAMPLES": FindingCode(
        "warning",
        "the object stands still in the data and catches up in one step: accelerations there are wrong",
        "drop the repeated values and interpolate, marked",
    ),
    "TIME_BACKWARDS": FindingCode(
        "warning", "rows are in the wrong order", "sort each object's rows by time"
    ),
    "CLOCK_JUMP": FindingCode(
        "error",
        "all times after the jump are off: speeds, gaps and errors against the other source are wrong",
        "shift the times after the jump by the amount that the motion shows",
    ),
    "CLOCK_DRIFT": FindingCode(
        "error",
        "one clock runs faster: the offset between GT and SD grows, and sensor errors with it",
        "scale the times of this source by the rate found",
    ),
    "CLOCK_OFFSET": FindingCode(
        "error",
        "every position error contains speed times delay, and reaction times are off by the delay",
        "shift the times by the delay found; the sensor's real latency is removed with it",
    ),
    "ID_REUSED": FindingCode(
        "error",
        "two objects share one id: the trace between them was never driven",
        "give the later object an id of its own",
    ),
    "ID_SWITCH": FindingCode(
        "error", "two objects swap ids: both traces jump", "swap the ids back from there on"
    ),
    "TRACK_BROKEN": FindingCode(
        "warning",
        "the object vanishes and another one appears in its place, at its speed",
        "give both parts one id, where they are certainly one object",
    ),
    "POSITION_JUMP": FindingCode(
        "error", "the object moves farther in one step than possible: the fit bends through the jump"
    ),
    "OUTLIER": FindingCode(
        "warning", "single samples far off the track bend the fit", "drop them and interpolate, marked"
    ),
    "SPEED_DISAGREES": FindingCode(
        "warning",
        "speed and positions contradict each other: the speed spline, TTC and reaction times follow the speed",
        "take the speed from the positions, marked",
    ),
    "HEADING_DISAGREES": FindingCode(
        "warning",
        "heading and positions contradict each other: boxes are turned, and lateral motion is wrong",
        "take the heading from the positions, marked",
    ),
    "ACCELERATION": FindingCode(
        "warning",
        "no vehicle of its kind can do this: the speed fit follows noise, and its peaks cannot be trusted",
        "drop single spikes of the speed and interpolate, marked",
    ),
    "YAW_RATE": FindingCode(
        "warning",
        "no vehicle of its kind can turn like this: the heading fit follows noise",
        "drop single spikes of the heading and interpolate, marked",
    ),
    "OVERLAP": FindingCode(
        "warning", "two boxes overlap for longer than a collision lasts: wrong sizes, wrong positions or a double"
    ),
    "SIZE_CHANGES": FindingCode(
        "warning", "the first size is taken for the whole track", "take the median size of the object"
    ),
    "SIZE_IMPOSSIBLE": FindingCode(
        "error", "no object of its kind has this size: gaps, contacts and overlaps are wrong"
    ),
    "SIZE_SWAPPED": FindingCode(
        "error", "length and width are swapped: gaps, contacts and overlaps are wrong", "swap length and width"
    ),
    "OFF_MAP": FindingCode(
        "warning", "there is no lane: lane-based results and the re-simulated road are not valid for it"
    ),
    "WRONG_WAY": FindingCode("warning", "it drives against its lane: a real wrong-way driver, or a wrong map or frame"),
    "HEIGHT": FindingCode(
        "warning",
        "the map does not confirm this height; it counts as unknown and no level separation applies",
    ),
    "REFERENCE_POINT": FindingCode(
        "error",
        "positions are not those of the box centre: distances are off by as much",
    ),
    "SPEED_UNIT": FindingCode("error", "every result that uses speed is wrong", "convert the speeds to m/s"),
    "HEADING_UNIT": FindingCode("error", "every result that uses heading is wrong", "convert the headings to radians"),
    "HEADING_TURNED": FindingCode(
        "error", "front and rear are swapped: it seems to drive backwards", "turn the headings by pi"
    ),
    "HEADING_CONVENTION": FindingCode(
        "error", "every result that uses heading is wrong", "count the headings anticlockwise from +x, in radians"
    ),
    "TIME_UNIT": FindingCode(
        "error", "every speed, acceleration and duration is wrong by as much", "convert the times to seconds"
    ),
    "EGO_DETECTION": FindingCode(
        "error",
        "the sensor's own detection of the EGO counts as another object, with which the EGO collides throughout",
        "give it the EGO's id in gt_id",
    ),
    "MIRRORED_Y": FindingCode(
        "error", "left and right are swapped, and so are lanes", "turn the sign of y and of the heading"
    ),
    "SENSOR_OFFSET": FindingCode(
        "warning",
        "sensor data places it farther from ground truth than sensors usually err: SD is judged with it there",
    ),
    "SD_WITHOUT_GT": FindingCode("note", "no sensor error can be computed for it; it is in rSD nevertheless"),
}  # fmt: skip
"""Every code: its usual severity, what it means, and the repair."""


@dataclass(frozen=True)
class RankedFinding:
    """A finding, how many times its threshold it is (the order within a severity), and whether it stands by itself.

    own: it is no symptom, whatever else is found. other: a second object concerned, "" for none.
    """

    finding: Finding
    excess: float
    own: bool = False
    other: str = ""


def found(
    code: str,
    source: Source,
    object: str,
    span: tuple[float, float],
    value: float,
    unit: str,
    text: str,
    *,
    limit: float,
    severity: Severity | None = None,
    repair: str | None = None,
    own: bool = False,
    other: str = "",
    details: Mapping[str, float | str] | None = None,
) -> RankedFinding:
    """Give a finding with the terms of its code. span: start and end [s]; limit: what value had to exceed."""
    terms = CODES[code]
    finding = Finding(
        code=code, severity=severity or terms.severity, source=source, object=object, start=float(span[0]),
        end=float(span[1]), value=float(value), unit=unit, text=text, meaning=terms.meaning,
        repair=terms.repair if repair is None else repair, details=details or {},
    )  # fmt: skip
    return RankedFinding(finding, abs(float(value)) / limit, own, other)


def worst_first(everything: Iterable[RankedFinding]) -> tuple[Finding, ...]:
    """Give the findings by severity, then by how far they are beyond their threshold."""

    def rank(one: RankedFinding) -> tuple[int, float, str, str, str, float]:
        f = one.finding
        return SEVERITIES.index(f.severity), -one.excess, f.code, f.source, f.object, f.start

    return tuple(one.finding for one in sorted(everything, key=rank))
