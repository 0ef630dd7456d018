"""What is varied of a drive, decided before anything is: by it any process makes the same variations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.recordings import Recording
from resim.recordings.content import content_hash
from resim.resimulation import AssessmentOptions, assess_recording
from resim.resimulation.run import prepare
from resim.scenario.scenario import Scenario
from resim.variations.kernels import read_kernels
from resim.variations.origin import NamedManeuver, the_origin, varied_maneuvers
from resim.variations.search import VariationPlan
from resim.variations.settings import VariationSettings, WhatVaries
from resim.verification.entries import VerifiedRecording
from resim.verification.folder import read as read_verification
from resim.verification.inputs import VerificationRequest
from resim.verification.validity_interval import ValidityInterval
from resim.verification.validity_runs import critical


def make_plan(
    recording: Recording, kernels: Path, wanted: WhatVaries, settings: VariationSettings
) -> VariationPlan:
    """Say what is varied of a recording that was read from a folder.

    Raises InputError for an object of which there is nothing to vary.
    """
    assert recording.folder is not None
    known = read_kernels(kernels)
    prepared = prepare(recording, (), wanted.accept)
    scenario = prepared.described["GT"]
    every = varied_maneuvers(recording, known, scenario)
    objects = wanted.objects or (_critical(recording),)
    chosen = tuple(
        one for one in every if one.object in objects and (not wanted.labels or one.label in wanted.labels)
    )
    if without := [name for name in objects if all(one.object != name for one in chosen)]:
        _refuse(recording.folder, scenario, without, every, wanted.labels)
    the_origin(scenario, prepared.network, known, chosen)
    return VariationPlan(
        recording.folder, content_hash(recording.folder), wanted.accept, scenario, known, file_hash(kernels), chosen,
        settings,
    )  # fmt: skip


def _critical(recording: Recording) -> str:
    """The object of the largest risk: that which `resim verify --vary` varies."""
    return critical(assess_recording(recording, AssessmentOptions()).blocks["GT"])


def _refuse(
    folder: Path,
    scenario: Scenario,
    objects: Sequence[str],
    every: Sequence[NamedManeuver],
    labels: Sequence[str],
) -> None:
    """Say why there is nothing to vary. Raises InputError."""
    ids = {one.id for one in scenario.objects}
    if strange := [name for name in objects if name not in ids]:
        raise InputError(folder, f"has no traffic object {strange[0]!r}", f"It has {', '.join(sorted(ids))}.")
    told = ", ".join(str(one) for one in every[:8]) or "none"
    what = " or ".join(labels) or "maneuver that there is a kernel of"
    raise InputError(folder, f"object {', '.join(objects)} has no {what}", f"There are kernels for: {told}.")


def verified_ranges(file: Path, digest: str) -> tuple[ValidityInterval, ...]:
    """Give what `resim verify --vary` found for a recording with this hash of its content, by its verification.json.

    None where the recording is not verified there. Raises InputError where the file is none.
    """
    for one in read_verification(file).recordings:
        if isinstance(one, VerifiedRecording) and one.hash == digest and one.verdict == "verified":
            return one.validity
    return ()


def verified_request(file: Path) -> VerificationRequest:
    """Give what a verification follows from, by its verification.json. Raises InputError where the file is none."""
    return read_verification(file).inputs


def verified_for(file: Path) -> str:
    """Name the build and the perception model that a verification is of. Raises InputError where the file is none."""
    asked = verified_request(file)
    seen = (
        "without a perception model"
        if asked.perception is None
        else f"with {Path(asked.perception.path).name}"
    )
    return f"{asked.build.label} {seen}"
