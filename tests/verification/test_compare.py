"""A simulated drive beside the measured one, and what is held for the cause."""

from __future__ import annotations

from dataclasses import replace

import pytest

from resim.resimulation.drive_outcome import COMFORT, BadEnd, DriveOutcome, Kpi
from resim.verification.blame import OpenLoopFinding
from resim.verification.cause import cause
from resim.verification.compare import DriveComparison, SeedVerdict, compare
from resim.verification.sequential import SequentialTest
from resim.verification.tolerance import ErrorLimits, Excess, StepLimits, Tolerances
from resim.verification.validity_runs import _unlike

FREE = Tolerances(
    sensor=StepLimits(to=ErrorLimits(d=1.0)), fit=StepLimits(to=ErrorLimits(d=0.2)),
    simulation=StepLimits(to=ErrorLimits(d=0.1)),
    pipeline=StepLimits(ego=ErrorLimits(d=1.5)),
)  # fmt: skip
SMALL = {step: {"ego": {"d": 0.01}, "to": {"d": 0.01}} for step in ("S", "FIT_GT", "SIM_GT", "PIPE_GT")}


def kpi(outcome: str, value: float = 1.0, t: float = 2.0) -> Kpi:
    return Kpi(outcome, value, "s", t, "1", 1.0, "")  # type: ignore[arg-type]


def drive(events: tuple[tuple[float, str], ...] = ((3.0, "brake"),), **kpis: Kpi) -> DriveOutcome:
    reaction = next((t for t, name in events if name == "brake"), None)
    return DriveOutcome(kpis or {"gap": kpi("PASS")}, events, reaction, 0.01, dict.fromkeys(COMFORT), False)


def test_equal_drives_are_verified() -> None:
    found = compare("rGT", drive(), drive(((3.1, "brake"),)), SMALL, FREE)
    assert found.verdict == "verified"
    assert found.reaction_difference == pytest.approx(0.1)
    assert found.t is None


def test_only_equality_of_kpis_counts_not_their_values() -> None:
    """Groh 2018, III.B: both may fail, and by how much is not compared."""
    measured, simulated = drive(gap=kpi("FAIL", 0.2)), drive(gap=kpi("FAIL", 0.9))
    assert compare("rGT", measured, simulated, SMALL, FREE).verdict == "verified"


@pytest.mark.parametrize(
    ("now", "told"),
    [
        (BadEnd("collision", 2.7, 20.0, "A"), "with A at 2.7 s"),
        (BadEnd("collision", 5.9, 20.0, "B"), "with B at 5.9 s"),
        (BadEnd("collision", 6.7, 20.0, "A"), "with A at 6.7 s"),
        (BadEnd("collision", 6.6, 20.0, "B"), ""),
    ],
)  # fmt: skip
def test_another_collision_is_not_the_measured_one_nor_in_its_range(now: BadEnd, told: str) -> None:
    told = told and f"the EGO collides with B at 6.7 s in the drive, {told} in simulation"
    none = drive(gap=kpi("FAIL"))
    measured = replace(none, collision=True, bad=BadEnd("collision", 6.7, None, "B"))
    simulated = replace(none, collision=True, bad=now, end="collision")
    found = compare("rGT", measured, simulated, SMALL, FREE)
    assert found.verdict == ("not verified" if told else "verified")
    assert found.differences == ((told,) if told else ())
    assert ("end" in found.unequal) == bool(told)
    assert _unlike(simulated, measured).others == ((told,) if told else ())


def test_a_kpi_that_differs_is_told_with_the_second_at_which_it_fails() -> None:
    found = compare("rGT", drive(gap=kpi("FAIL", 0.2, 5.5)), drive(gap=kpi("PASS", 2.0, 1.0)), SMALL, FREE)
    assert found.verdict == "not verified"
    assert found.t == 5.5
    assert found.differences == ("gap: FAIL (0.2 s at 5.5 s) measured, PASS (2 s at 1.0 s) simulated",)


def test_another_decision_is_not_verified_and_told_from_the_first_event_that_parts() -> None:
    simulated = drive(((3.0, "brake"), (4.2, "lane_change_left")))
    found = compare("rGT", drive(), simulated, SMALL, FREE)
    assert found.verdict == "not verified"
    assert found.t == 4.2
    assert "brake measured, brake, lane change left simulated" in found.differences[0]


def test_late_braking_is_beyond_tolerance() -> None:
    found = compare("rGT", drive(), drive(((3.3, "brake"),)), SMALL, FREE)
    assert (found.verdict, found.t) == ("not verified", 3.0)
    assert (
        compare("rGT", drive(), drive(((3.3, "brake"),)), SMALL, Tolerances(reaction=None)).verdict
        == "verified"
    )


@pytest.mark.parametrize("side", ["measured", "simulated"])
def test_what_cannot_be_judged_is_never_verified(side: str) -> None:
    lost, whole = drive(gap=kpi("INVALID")), drive()
    found = compare("rGT", *((lost, whole) if side == "measured" else (whole, lost)), SMALL, FREE)
    assert found.verdict == "invalid"


def test_a_difference_weighs_more_than_what_cannot_be_judged() -> None:
    measured = drive(gap=kpi("INVALID"), risk=kpi("PASS"))
    found = compare("rGT", measured, drive(gap=kpi("PASS"), risk=kpi("FAIL")), SMALL, FREE)
    assert found.verdict == "not verified"


def test_a_failed_function_is_an_error() -> None:
    assert compare("rGT", drive(), replace(drive(), failure="raised"), SMALL, FREE).verdict == "error"


@pytest.mark.parametrize("end", ["collision", "off_road"])
def test_a_simulation_that_is_cut_short_is_not_verified(end: str) -> None:
    """What it did not live to see cannot have passed."""
    found = compare("rGT", drive(), replace(drive(), end=end, collision=end == "collision"), SMALL, FREE)
    assert found.verdict == "not verified"
    assert "end" in found.unequal
    assert ("collides only in simulation" in found.differences[0]) == (end == "collision")


def test_both_may_collide() -> None:
    hit = replace(drive(), collision=True)
    assert compare("rGT", hit, replace(hit, end="collision"), SMALL, FREE).verdict == "verified"
    assert compare("rGT", hit, replace(drive(), end="duration"), SMALL, FREE).verdict == "not verified"


def test_errors_of_single_runs_are_held_against_the_pipelines_tolerance() -> None:
    found = compare("rGT+M", drive(), replace(drive(), errors={"d": 1.6}), SMALL, FREE)
    assert found.differences == ("pipeline error: EGO position 1.6 m (tolerance 1.5 m)",)


MADE = {
    "verified": drive(), "not verified": drive(()), "invalid": drive(gap=kpi("INVALID")),
    "error": replace(drive(), failure="raised"),
}  # fmt: skip
TEST = SequentialTest(0.9, 200)


def judged(*verdicts: str, test: SequentialTest = TEST) -> SeedVerdict:
    runs = (compare("rGT+M", drive(), MADE[verdict], SMALL, FREE) for verdict in verdicts)
    return SeedVerdict("rGT+M", tuple(runs), test)


def test_seeds_are_verified_only_where_they_tell_it() -> None:
    """18 of 20 were enough before: so many agree in 21 % of cases where the true share is 0.8."""
    few = [*["verified"] * 18, *["not verified"] * 2]
    assert judged(*few).verdict == "undecided"
    assert judged(*["verified"] * 49).verdict == "undecided"
    assert judged(*["verified"] * 50).verdict == "verified"
    assert judged(*["not verified"] * 4).verdict == "not verified"
    assert judged(*["verified"] * 49, "error").verdict == "error"


def test_runs_that_cannot_be_judged_make_nothing_verified_and_nothing_not_verified() -> None:
    assert judged(*["invalid"] * 50).verdict == "invalid"
    assert judged(*["invalid"] * 49).verdict == "undecided"
    assert judged("invalid", *["verified"] * 49).verdict == "undecided"
    assert judged("invalid", *["verified"] * 70).verdict == "verified"
    assert judged("invalid", *["not verified"] * 8).verdict == "not verified"
    hangs = judged(*["invalid"] * 50).share
    assert (hangs.count, hangs.low, hangs.high) == (0, 0.0, 1.0)


def test_an_undecided_verdict_says_how_many_seeds_would_tell() -> None:
    many = judged(*[*["verified"] * 12, "not verified"] * 15, *["verified"] * 5)
    assert (many.verdict, len(many.comparisons)) == ("undecided", 200)
    found = cause(many, errors(), FREE, None)
    assert found is not None
    assert found.step == "seeds"
    assert "185 of 200 seeds agree, [0.887, 0.955] at 90%" in found.text
    assert f"some {many.needed} seeds would" in found.text
    assert many.worst.verdict == "not verified"
    assert judged("verified").needed > 0
    assert judged(*["verified"] * 50).needed is None


def errors(**steps: float) -> dict[str, dict[str, dict[str, float | None]]]:
    return {step: {"ego": {}, "to": {"d": steps.get(step, 0.01)}} for step in SMALL}


def found_cause(
    far: dict[str, float], recorded: DriveComparison | None, driven: OpenLoopFinding | None = None
):
    told = errors(**far)
    one = SeedVerdict("rGT", (compare("rGT", drive(), drive(()), told, FREE),))
    return cause(one, told, FREE, recorded, driven=driven)


AS_MEASURED = compare("rGT+M", drive(), drive(), SMALL, FREE)
AS_SIMULATED = compare("rGT+M", drive(), drive(()), SMALL, FREE)


def test_the_sensor_is_the_cause_where_showing_what_was_recorded_mends_it() -> None:
    found = found_cause({"S": 1.6, "FIT_GT": 0.5}, AS_MEASURED)
    assert found is not None
    assert found.step == "sensor"
    assert "decision is as measured" in found.text
    assert "TO position 1.6 m (tolerance 1 m)" in found.text


def test_a_trial_in_which_the_function_fails_explains_nothing() -> None:
    failed = compare("rGT+M", drive(), replace(drive(), kpis={}, failure="raised"), SMALL, FREE)
    found = found_cause({"S": 1.6}, failed)
    assert found.step == "function"
    assert "the function failed: raised" in found.text


def test_a_small_sensor_error_may_explain_it_too() -> None:
    found = found_cause({}, AS_MEASURED)
    assert found is not None
    assert found.step == "sensor"


def test_a_large_sensor_error_that_explains_nothing_is_not_the_cause() -> None:
    assert found_cause({"S": 1.6, "FIT_GT": 0.5, "SIM_GT": 0.5}, AS_SIMULATED).step == "fit"
    assert found_cause({"S": 1.6, "SIM_GT": 0.5}, AS_SIMULATED).step == "simulation"
    assert found_cause({"S": 1.6}, AS_SIMULATED).step == "function"


def test_the_sensor_is_the_cause_of_an_ego_that_only_drives_elsewhere() -> None:
    told = errors() | {"PIPE_GT": {"ego": {"d": 2.0}, "to": {"d": 0.01}}}
    one = SeedVerdict("rGT", (compare("rGT", drive(), drive(), told, FREE),))
    assert one.verdict == "not verified"
    found = cause(one, told, FREE, AS_MEASURED)
    assert found is not None
    assert (found.step, "pipeline error is as measured" in found.text) == ("sensor", True)


def test_what_mends_little_is_not_the_cause() -> None:
    """Of the decision and two KPIs only one KPI is as measured when shown what was recorded."""
    measured = drive(gap=kpi("PASS"), risk=kpi("PASS"))
    simulated = replace(drive(gap=kpi("FAIL"), risk=kpi("FAIL")), events=())
    recorded = compare(
        "rGT+M", measured, replace(simulated, kpis=simulated.kpis | {"gap": kpi("PASS")}), SMALL, FREE
    )
    one = SeedVerdict("rGT", (compare("rGT", measured, simulated, errors(S=1.6), FREE),))
    found = cause(one, errors(S=1.6), FREE, recorded)
    assert found is not None
    assert (found.step, "decision, risk are not as measured either" in found.text) == ("function", True)


def test_without_sensor_data_the_chain_begins_at_the_fit() -> None:
    assert found_cause({"FIT_GT": 0.5}, None).step == "fit"
    found = found_cause({}, None)
    assert found.step == "function"
    assert "no sensor data" in found.text


def test_what_cannot_be_judged_is_named() -> None:
    one = SeedVerdict("rGT", (compare("rGT", drive(gap=kpi("INVALID")), drive(), SMALL, FREE),))
    found = cause(one, errors(), FREE, None)
    assert found is not None
    assert (found.step, found.text) == ("criteria", "cannot be judged: gap")


def open_loop(function: str, *, off: bool = True, senses: bool = True) -> OpenLoopFinding:
    """The vehicle model 2 m/s off within a second, or not at all."""
    beyond = (Excess(step="vehicle", who="ego", quantity="v", value=2.0, limit=0.5),) if off else ()
    error = {"d": 0.1, "v": 2.0 if off else 0.1, "heading": 0.0}
    return OpenLoopFinding(error, beyond, 2.5 if off else None, function, 1.0, senses)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("function", "off", "senses", "step", "said"),
    [
        ("plans as recorded", True, True, "vehicle", "EGO speed 2 m/s (tolerance 0.5 m/s)"),
        ("is the build that drove", True, True, "vehicle", "is the build that drove"),
        ("unknown", True, True, "function or vehicle", "whether this build drove is unknown"),
        ("unknown", True, False, "function or vehicle", "what it perceived was not recorded"),
        ("plans otherwise", True, True, "function", "plans differently from the recording, for 1.0 s"),
        ("plans otherwise", False, True, "function", "plans differently from the recording"),
        ("plans as recorded", False, True, "function", "move the vehicle model as the real vehicle moved"),
    ],
)
def test_the_vehicle_is_the_cause_where_the_function_is_known_to_have_answered_as_here(
    function: str, off: bool, senses: bool, step: str, said: str
) -> None:
    found = found_cause({}, AS_SIMULATED, open_loop(function, off=off, senses=senses))
    assert (found.step, said in found.text) == (step, True)
    assert (found.t == 2.5) == ("vehicle" in step)


def test_steps_before_the_vehicle_are_the_first_cause() -> None:
    assert found_cause({"FIT_GT": 0.5}, AS_SIMULATED, open_loop("plans as recorded")).step == "fit"
    assert found_cause({"S": 1.6}, AS_MEASURED, open_loop("plans as recorded")).step == "sensor"


def test_what_the_sensor_leaves_over_is_the_vehicles() -> None:
    measured, simulated = (
        drive(gap=kpi("PASS"), risk=kpi("PASS")),
        drive((), gap=kpi("FAIL"), risk=kpi("FAIL")),
    )
    mended = compare("rGT+M", measured, drive(gap=kpi("PASS"), risk=kpi("FAIL")), SMALL, FREE)
    one = SeedVerdict("rGT", (compare("rGT", measured, simulated, errors(S=1.6), FREE),))
    for function, step in (("plans as recorded", "sensor and vehicle"), ("unknown", "sensor")):
        found = cause(one, errors(S=1.6), FREE, mended, driven=open_loop(function))
        assert (found.step, "but not risk" in found.text, "EGO speed 2 m/s" in found.text) == (
            step,
            True,
            True,
        )


def test_a_good_verdict_has_no_cause() -> None:
    assert cause(SeedVerdict("rGT", (AS_MEASURED,)), errors(), FREE, None) is None
