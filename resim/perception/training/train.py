"""From drives that were measured twice to the model of their sensors."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from pydantic import ValidationError

from resim.core import faults
from resim.core.errors import InputError, ResimError
from resim.core.tracks import Tracks
from resim.perception.model import (
    FEATURES,
    ErrorModels,
    PerceptionModel,
    TrainedParameter,
    TrainedRange,
    Training,
)
from resim.perception.training.coupling import fit_coupling
from resim.perception.training.detected import DETECTED
from resim.perception.training.detection import field_of_view, fit_detection, sightings_of
from resim.perception.training.drive import TrainingDrive, drive_of
from resim.perception.training.errors import MEASURED, ObjectErrors, error_of, fit_objects
from resim.perception.training.estimates import error_estimates, lag_estimates
from resim.perception.training.false_places import FalsePlaces, false_tracks
from resim.perception.training.fit import fit_of
from resim.perception.training.left_out import left_out
from resim.perception.training.lists import fit_false, fit_switches, fit_update
from resim.perception.training.localisation import fit_localisation, fit_size
from resim.perception.training.maneuvers import fit_maneuvers
from resim.perception.training.matching import Matching, match
from resim.perception.training.samples import TrainingSamples, samples_of
from resim.recordings.recording import Recording

FEWEST = 50
"""Matched samples without which nothing can be said."""


def train(recordings: Sequence[Recording], *, name: str) -> PerceptionModel:
    """Learn a perception model from recordings with GT and SD; the same recordings give the same model.

    Every estimate stands in `training.estimates` with its 95 % interval and the samples behind it. Raises InputError
    where a recording has no SD or its EGO no GT, where nothing perceived lies on anything true, and where what does
    is too little.
    """
    if not recordings:
        raise InputError("training", "there is no recording", "Give recordings with GT and SD.")
    try:
        return _trained(recordings, name)
    except (ValidationError, np.linalg.LinAlgError) as e:
        what = faults.describe(e.errors(), PerceptionModel) if isinstance(e, ValidationError) else str(e)
        problem = f"errors that no model may have: {what}"
        raise InputError(
            _names(recordings), problem, "Look for the drive that has them: `resim check`."
        ) from e


def _trained(recordings: Sequence[Recording], name: str) -> PerceptionModel:
    drives = [drive_of(recording) for recording in recordings]
    for recording, drive in zip(recordings, drives, strict=True):
        if not len(drive.t):
            raise InputError(
                recording.name,
                "gt and sd have no time in common at which the EGO is known",
                "Give both the same clock.",
            )
    matchings = match(drives)
    matched = sum(int((m.row >= 0).sum()) for m in matchings)
    _enough(recordings, matched, sum(int(d.seen.sum()) for d in drives))
    samples = samples_of(drives, matchings)
    objects = fit_objects(samples)
    estimates = lag_estimates(objects, samples.drive)
    errors, found = _errors(drives, matchings, samples, objects)
    estimates |= found
    maneuvers, found, own_errors = fit_maneuvers(samples, objects, errors)
    estimates |= found
    sightings = sightings_of(drives, matchings, objects.latency.position)
    view, seen = field_of_view(sightings, samples.step)
    detection, found = fit_detection(sightings, view)
    estimates |= seen | found
    update, found = fit_update(drives)
    estimates |= found
    switches, found = fit_switches(matchings, samples.step)
    estimates |= found
    false, found = fit_false(drives, matchings, samples.step)
    estimates |= found
    own, found = fit_localisation(drives)
    estimates |= found
    shares = [
        *(kind(sightings, view, detection) for kind in DETECTED),
        FalsePlaces(false_tracks(drives, matchings), false),
    ]
    return PerceptionModel(
        name=name,
        provenance=f"trained on {len(drives)} drives, {matched} matched samples",
        latency=objects.latency,
        averaging=objects.averaging,
        errors=errors,
        maneuvers=maneuvers,
        detection=detection,
        field_of_view=view,
        update=update,
        id_switch=switches,
        false_objects=false,
        ego=own,
        validity=_validity(samples, objects),
        training=Training(
            sources=_sources(recordings),
            drives=len(drives),
            matched=matched,
            estimates=estimates,
            fit=fit_of(samples, objects, own_errors, shares),
            left_out=left_out(recordings, drives, matchings, samples, objects),
        ),
    )


def _errors(
    drives: Sequence[TrainingDrive],
    matchings: Sequence[Matching],
    samples: TrainingSamples,
    objects: ObjectErrors,
) -> tuple[ErrorModels, dict[str, TrainedParameter]]:
    """The errors of what is measured and of the sizes, and how sure they are."""
    estimates: dict[str, TrainedParameter] = {}
    for quantity in MEASURED:
        estimates |= error_estimates(f"errors.{quantity}", objects.fitted[quantity], samples.drive)
    sizes = {}
    for size in ("length", "width"):
        sizes[size], found = fit_size(drives, matchings, size)
        estimates |= found
    coupling, found = fit_coupling(objects, samples.drive)
    measured = {q: error_of(objects.fitted[q]) for q in MEASURED}
    return ErrorModels(**measured, **sizes, coupling=coupling), estimates | found


def _names(recordings: Sequence[Recording]) -> str:
    return ", ".join(r.name for r in recordings[:5]) + (", ..." if len(recordings) > 5 else "")


def _enough(recordings: Sequence[Recording], matched: int, perceived: int) -> None:
    names = _names(recordings)
    if not perceived:
        raise InputError(names, "the sensor data hold no object but the EGO", "Train on drives with traffic.")
    if not matched:
        problem = f"none of {perceived} perceived samples lies on an object of the ground truth"
        remedy = "Check that GT and SD are of one drive, on one clock and in one frame (`resim check`)."
        raise InputError(names, problem, remedy)
    if matched < FEWEST:
        problem = f"{matched} samples of objects match between GT and SD, expected at least {FEWEST}"
        raise InputError(names, problem, "Give more or longer drives.")


def _validity(samples: TrainingSamples, objects: ObjectErrors) -> TrainedRange:
    """Give the states that stand behind the model."""
    known = samples.seen & np.isfinite(objects.features).all(axis=-1)
    used = objects.features[known]
    if not len(used):
        raise ResimError(
            "training: the truth of no matched sample is known at its latency; give longer drives"
        )
    limits = {
        feature: (float(used[:, k].min()), float(used[:, k].max())) for k, feature in enumerate(FEATURES)
    }
    speed = samples.ego[3][known]
    return TrainedRange(**limits, ego_speed=(float(speed.min()), float(speed.max())))


def _sources(recordings: Sequence[Recording]) -> dict[str, str]:
    """Give SHA-256 of the GT and SD of each recording, by name; a name that is a duplicate gets a number."""
    out: dict[str, str] = {}
    for recording in recordings:
        name, number = recording.name, 1
        while name in out:
            number += 1
            name = f"{recording.name}#{number}"
        digest = hashlib.sha256()
        for tracks in (recording.gt, recording.sd):
            if tracks is not None:
                _digest(digest, tracks)
        if (same := digest.hexdigest()) in out.values():
            problem = "is the same drive as another: it would count twice, and validate a model trained on it"
            raise InputError(recording.folder or name, problem, "Give each drive once.")
        out[name] = same
    return out


def _digest(digest: hashlib._Hash, tracks: Tracks) -> None:
    digest.update("\n".join(tracks.ids.tolist()).encode())
    for column in ("t", "x", "y", "heading", "v", "length", "width"):
        digest.update(np.ascontiguousarray(getattr(tracks, column), dtype="<f8").tobytes())
