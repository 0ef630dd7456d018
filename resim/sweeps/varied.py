"""Variations as parameters of a sweep: the drive that a run's values ask for, how far it is from its origin, and trust.

`variation.number` n is the n-th variation of `resim vary`, 0 the origin itself; `variation.c3` moves the third of all
components, those of one maneuver after the other, by so many standard deviations of the data, on top of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from resim.core.errors import InputError, ResimError
from resim.core.files import file_hash
from resim.core.plugins.frozen import FrozenFile
from resim.core.schema import VARIED_DISTANCE, VARIED_TRUST, Row
from resim.resimulation.result import PreparedRecording
from resim.simulation.reactive.settings import ReactiveSettings
from resim.variations.candidate import VariedDrive, varied_drive
from resim.variations.plan import make_plan, verified_ranges, verified_request
from resim.variations.rejection import reason
from resim.variations.search import PlannedSearch, VariationPlan, VariationTask, look, ready
from resim.variations.settings import VariationSettings, WhatVaries
from resim.variations.swept import SweepVariation
from resim.variations.trust import UNVERIFIED, Trust, judged_trust
from resim.verification.inputs import VerificationRequest
from resim.verification.validity_interval import ValidityInterval

VARIATION = "variation."
NUMBER, COMPONENT = f"{VARIATION}number", f"{VARIATION}c"
TRIES = 20
"""Points that are looked at for each variation, at most."""


@dataclass(frozen=True)
class VariedRuns:
    """How a recording is varied in runs.

    kernels, verified: the files, as they were when the sweep was read. accept: codes of findings to continue despite.
    """

    told: SweepVariation
    kernels: FrozenFile
    verified: FrozenFile | None
    accept: tuple[str, ...] = ()


@dataclass(frozen=True)
class SweptDriver:
    """What drives a run: hashes of build and perception model, None without one, vehicle model and traffic."""

    build: str
    perception: str | None
    vehicle: str
    traffic: ReactiveSettings | None


@dataclass(frozen=True, eq=False)
class _Variations:
    """Variations of one recording as far as they were made in this process."""

    plan: VariationPlan
    ranges: tuple[ValidityInterval, ...] | None
    verified: VerificationRequest | None
    kept: list[np.ndarray] = field(default_factory=list)
    looked: list[int] = field(default_factory=lambda: [0])

    def offset(self, number: int) -> np.ndarray:
        """Give the offset (D,) of components of the n-th variation. Raises ResimError where too many are rejected."""
        while len(self.kept) < number:
            if self.looked[0] >= TRIES * number + 100:
                raise ResimError(f"of {self.looked[0]} points only {len(self.kept)} give a variation")
            self.looked[0] += 1
            (found,) = look(VariationTask(self.plan, self.looked[0], 1))
            if not found.rejected and found.drive is not None:
                self.kept.append(found.drive.offset)
        origin = ready(self.plan).origin
        return self.kept[number - 1] if number else np.zeros(origin.dimensions)


def vary_recording(
    prepared: PreparedRecording,
    digest: str,
    runs: VariedRuns,
    values: Mapping[str, float],
    setup: SweptDriver,
) -> tuple[PreparedRecording, Row]:
    """Give a recording as a run's values vary it, and its distance and trust, for the run's row.

    digest: hash of the recording's content. setup: what drives it; only what was verified is trusted.

    Raises ResimError for a variation that is impossible.
    """
    found = _variations(prepared, digest, runs)
    there = ready(found.plan)
    offset = found.offset(round(values.get(NUMBER, 0.0))).copy()
    spread = np.concatenate([one.kernel.sd for one in there.origin.maneuvers])
    for name, value in values.items():
        if name.startswith(COMPONENT):
            offset[component_of(name, len(offset))] += value * spread[component_of(name, len(offset))]
    drive = varied_drive(there.origin, offset)
    if why := reason(drive.scenario, drive.off, there.against):
        raise ResimError(f"variation rejected: {why}")
    unlike = _unlike(found.verified, setup, [name for name in values if not name.startswith(VARIATION)])
    trust = Trust("unknown", unlike) if unlike else _trust(found, there, drive)
    varied = replace(prepared, described={**prepared.described, "GT": drive.scenario})
    return varied, {VARIED_DISTANCE: drive.distance, VARIED_TRUST: trust.level}


def _trust(found: _Variations, there: PlannedSearch, drive: VariedDrive) -> Trust:
    if found.ranges is None:
        return UNVERIFIED
    if found.ranges and not drive.offset.any():
        return Trust("inside", "")  # the verified drive itself
    return judged_trust(there.origin.motions, drive.motions, found.ranges)


def _unlike(verified: VerificationRequest | None, setup: SweptDriver, swept: Sequence[str]) -> str:
    """How a run is not what was verified, "" where it is. swept: other parameters of the sweep."""
    if verified is None:
        return ""
    seen = None if verified.perception is None else verified.perception.hash
    pairs = {
        "build": (setup.build, verified.build.hash),
        "perception model": (setup.perception, seen),
        "vehicle model": (setup.vehicle, verified.vehicle),
        "traffic": (setup.traffic, verified.traffic),
        "perception model (with parameters set)": ((), tuple(verified.settings)),
    }
    other = [name for name, (one, two) in pairs.items() if one != two]
    told = [f"another {name} was verified" for name in other] + [f"{name} is swept" for name in swept]
    return told[0] if told else ""


def component_of(name: str, count: int) -> int:
    """Give which component a parameter is of, from 0. Raises ResimError where there is none."""
    told = name.removeprefix(COMPONENT)
    if not told.isdigit() or not 1 <= int(told) <= count:
        raise ResimError(f"parameter {name!r}: there are variation.number and variation.c1 to c{count}")
    return int(told) - 1


@lru_cache(maxsize=8)
def _variations(prepared: PreparedRecording, digest: str, runs: VariedRuns) -> _Variations:
    """The variations of a recording; kept, as each is counted from the one before."""
    for frozen in (runs.kernels, runs.verified):
        if frozen is not None and file_hash(frozen.path) != frozen.hash:
            raise InputError(frozen.path, "was changed since the sweep was read", "Restore it.")
    what = WhatVaries(runs.told.object, runs.told.maneuver, runs.accept)
    plan = make_plan(prepared.recording, runs.kernels.path, what, VariationSettings(box=runs.told.box))
    ranges = None if runs.verified is None else verified_ranges(runs.verified.path, digest)
    verified = None if runs.verified is None else verified_request(runs.verified.path)
    return _Variations(plan, ranges, verified)
