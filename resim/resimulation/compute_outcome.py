"""What drives came to (`DriveOutcome`), of re-simulations and their assessments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from resim.core.clock import TICK
from resim.core.tracks import Tracks
from resim.metrics.assessment import Assessment
from resim.metrics.criteria import reason_words
from resim.resimulation import fidelity
from resim.resimulation.assessed import AssessmentOptions, ResimulationAssessment
from resim.resimulation.assessments import drive_block
from resim.resimulation.blocks import Block, assess_blocks
from resim.resimulation.decision import ego_events
from resim.resimulation.drive_outcome import COMFORT, BadEnd, DriveOutcome, Kpi, Rms
from resim.resimulation.fidelity import EGO_ROW, TO_ROWS, StepErrors
from resim.resimulation.reaction import ego_tracks
from resim.resimulation.result import Resimulation, with_own
from resim.road.opendrive import RoadNetwork
from resim.scenario import maneuvers
from resim.scenario.scenario import Scenario
from resim.simulation.case import SimulatedDrive

PARTED = {"d": 0.5, "v": 0.5}
"""Distance [m] and difference of speed [m/s] from which on two EGOs drive differently."""


def outcomes(result: Resimulation, assessed: ResimulationAssessment) -> dict[str, DriveOutcome]:
    """Give what GT, SD, rGT and rSD came to, as far as they are there."""
    driven, ego, out = result.driven(), result.ego, {}
    drives = result.simulated()
    if "SD" in result.described:
        driven["SD"] = ego_tracks(result.described["SD"], result.network)
    for name, assessment in assessed.blocks.items():
        if (tracks := driven.get(name)) is not None:
            out[name] = outcome(assessment, tracks, result.network, ego, drives.get(name))
    if "GT" in out:
        out["GT"] = replace(out["GT"], reaction_spread=result.reaction_spread)
    return out | {name: _nothing(drive) for name, drive in drives.items() if name not in out}


def seed_outcome(result: Resimulation, seed: int, how: AssessmentOptions) -> DriveOutcome:
    """Give what a drive on GT (`run_on_gt`) came to: the EGO as it drove, the traffic as GT's scenario has it."""
    return seed_outcomes([(result, seed)], how)[0]


def seed_outcomes(runs: Sequence[tuple[Resimulation, int]], how: AssessmentOptions) -> list[DriveOutcome]:
    """Give what drives on GT of one map came to, as `seed_outcome` each; they take less time together."""
    each = [(result, *result.of(seed)) for result, seed in runs]
    blocks = [_of_gt_traffic(result, drive, refit) for result, drive, refit, _ in each if refit is not None]
    found = iter(assess_blocks(blocks, runs[0][0].network, how) if blocks else ())
    out = []
    for result, drive, refit, pipe in each:
        if refit is None:
            out.append(_nothing(drive))
            continue
        tracks = ego_tracks(refit, result.network)
        came_to = outcome(next(found), tracks, result.network, result.ego, drive)
        out.append(replace(came_to, errors=None if pipe is None else pipe.rms(EGO_ROW)))
    return out


def _of_gt_traffic(result: Resimulation, drive: SimulatedDrive, refit: Scenario) -> Block:
    """The EGO, and who was handed over, as they drove; other traffic as GT's scenario has it."""
    gt = result.described["GT"]
    return drive_block(drive, replace(refit, objects=with_own(gt, refit)), result.prepared.doubts["GT"], gt)


def _nothing(drive: SimulatedDrive) -> DriveOutcome:
    """A drive that ended before there was anything to judge."""
    comfort = dict.fromkeys(COMFORT)
    return DriveOutcome(
        {}, (), None, None, comfort, bool(drive.collisions), drive.end, drive.failure, asked=_asked(drive, ()),
        bad=_bad(drive),
    )  # fmt: skip


def outcome(
    assessment: Assessment, tracks: Tracks, network: RoadNetwork, ego: str, drive: SimulatedDrive | None
) -> DriveOutcome:
    """Give what one drive came to. tracks: with accelerations."""
    kpis = {
        name: Kpi(v.outcome, _finite(v.value), v.unit, v.t, v.object, v.weight, reason_words(v))
        for name, v in assessment.verdicts.items()
    }
    return DriveOutcome(
        kpis=kpis,
        events=tuple(ego_events(tracks, network, ego, drive)),
        reaction=maneuvers.reaction_time(tracks, ego=ego),
        risk=_worst(assessment, "risk"),
        comfort={name: _largest(assessment, name, way) for name, way in COMFORT.items()},
        collision=bool(assessment.contacts),
        end="" if drive is None else drive.end,
        failure="" if drive is None else drive.failure,
        asked=_asked(drive, [measure.note for measure in assessment.measures.values()]),
        clear=assessment.clear and (drive is None or drive.end == "duration"),
        bad=_measured_collision(assessment) if drive is None else _bad(drive),
    )


def _measured_collision(assessment: Assessment) -> BadEnd | None:
    """The first collision of a measured drive."""
    first = min(assessment.contacts, default=None)
    return None if first is None else BadEnd("collision", first[0], None, first[1])


def _bad(drive: SimulatedDrive) -> BadEnd | None:
    """The first collision, also where it did not end the drive, or where it left the road."""
    truth = drive.truth
    if not drive.collisions:
        return BadEnd("off_road", float(truth.t[-1])) if drive.end == "off_road" and len(truth.t) else None
    first = min(drive.collisions, key=lambda one: one.t)
    at = max(int(np.searchsorted(truth.t, first.t + 1e-9)) - 1, 0)
    velocity = truth.v[:, at] * np.exp(1j * truth.heading[:, at])  # the EGO's is the first
    speed = float(abs(velocity[0] - velocity[truth.index(first.id)])) if first.id in truth.ids else np.nan
    return BadEnd("collision", first.t, _finite(speed), first.id)


def _asked(drive: SimulatedDrive | None, notes: Iterable[str]) -> tuple[str, ...]:
    """What code asked that its hash does not know: the function of a drive, and the measures of an assessment."""
    own: list[str] = []
    if drive is not None:
        build = drive.case.build
        told = (drive.unpinned, "" if build.program is None else build.program.unpinned)
        own = [f"{build.label}: {one}" for one in told if one]
    return tuple(dict.fromkeys(note for note in (*own, *notes) if note))


def rms(errors: Mapping[str, StepErrors]) -> Rms:
    """Give the root mean square errors of every step, of the EGO and of the traffic objects."""
    return {step: {"ego": e.rms(EGO_ROW), "to": e.rms(TO_ROWS)} for step, e in errors.items()}


def first_divergence(one: Tracks, two: Tracks, ego: str) -> float | None:
    """Give when [s] the EGO first drives differently in two simulations of one scenario, None where it does not."""
    t = one.t[one.t <= two.t[-1] + TICK]
    off = fidelity.difference(two.select([ego]).at(t), one.select([ego]).at(t), ego=ego)
    away = (off.d[0] > PARTED["d"]) | (np.abs(off.v[0]) > PARTED["v"])
    return float(t[np.argmax(away)]) if away.any() else None


def _worst(assessment: Assessment, name: str) -> float | None:
    measure = assessment.measures.get(name)
    found = None if measure is None else measure.worst_value()
    return None if found is None else found[0]


def _largest(assessment: Assessment, name: str, way: str) -> float | None:
    """The most uncomfortable value of a measure, as a magnitude."""
    value = assessment.measures[name].value
    known = value[np.isfinite(value)]
    if not known.size:
        return None
    return float(np.max(-known if way == "low" else np.abs(known)))


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else value
