"""The prediction of the accident risk, refitted to recordings."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

import resim
from resim.core.errors import InputError, ResimError
from resim.core.files import file_hash
from resim.core.objects import GAP
from resim.core.spelling import did_you_mean
from resim.core.tracks import KINDS, Tracks
from resim.metrics.risk.fitting import AHEAD, LEAST, MotionPoints, Refit, refit
from resim.metrics.risk.prediction import (
    ObjectMotion,
    PredictionEntry,
    PredictionSet,
    PredictionSources,
    WalkerMotion,
    prediction,
)
from resim.recordings import Recording, read_tables, recording_of
from resim.recordings.checked import check_codes, refuse_findings
from resim.recordings.checks import examine
from resim.resimulation.run import LONGEST
from resim.scenario.fit import fit_trace

PARKED = 0.5
"""Largest speed [m/s] of objects that count as parked: nobody in them does anything."""


@dataclass(frozen=True, eq=False)
class Refits:
    """What came of recordings: the set for a file, the fits by kind, and why other kinds were not fitted."""

    set: PredictionSet
    fits: Mapping[str, Refit]
    left: Mapping[str, str]


def refit_prediction(
    folders: Sequence[Path], *, name: str, kinds: Collection[str] = (), accept: Collection[str] = ()
) -> Refits:
    """Refit the published prediction to the ground truth of recordings, every object of it, the EGO too.

    name: of the set. kinds: those to fit, all that are there without; one that is asked for must be fitted. accept:
    codes of errors in the ground truth despite which a recording is taken. Raises InputError.
    """
    if unknown := [kind for kind in kinds if kind not in KINDS]:
        raise InputError(
            "--kind",
            f"there is no kind {unknown[0]!r}{did_you_mean(unknown[0], KINDS)}",
            f"Kinds: {', '.join(KINDS)}.",
        )
    check_codes(accept)
    if twice := [f for n, f in enumerate(folders) if f.resolve() in [g.resolve() for g in folders[:n]]]:
        raise InputError(twice[0], "is a duplicate", "Give each recording once.")
    found: dict[str, list[MotionPoints]] = {}
    used: dict[str, dict[str, str]] = {}
    for folder, label in zip(folders, _labels(folders), strict=True):
        recording, digest = _ground_truth(folder, accept)
        for kind, points in _points(recording):
            found.setdefault(kind, []).append(points)
            used.setdefault(kind, {})[label] = digest
    fits: dict[str, Refit] = {}
    left: dict[str, str] = {}
    published = prediction()
    for kind in [k for k in KINDS if k in (kinds or found)]:
        try:
            fits[kind] = refit(_joined(found.get(kind, [])), published.of(kind))
        except ResimError as e:
            left[kind] = str(e)
    told = "; ".join(f"{kind}: {why}" for kind, why in left.items())
    if kinds and left:
        raise InputError("--kind", told, "Give more recordings, or leave these kinds out.")
    if not fits:
        problem = f"nothing to fit ({told or f'no object moves for {AHEAD:g} s'})"
        raise InputError(", ".join(map(str, folders)), problem, f"A kind needs {LEAST} points or more.")
    entries = {kind: _entry(fit, used[kind]) for kind, fit in fits.items()}
    whole = PredictionSet.model_validate(
        {"name": name, "provenance": _provenance(len(folders)), "kinds": entries}
    )
    return Refits(whole, fits, left)


def _labels(folders: Sequence[Path]) -> list[str]:
    """The folders' names, numbered where several have the same."""
    names = [folder.resolve().name for folder in folders]
    count = [names[:n].count(name) for n, name in enumerate(names)]
    return [f"{name}~{n + 1}" if n else name for name, n in zip(names, count, strict=True)]


def _ground_truth(folder: Path, accept: Collection[str]) -> tuple[Recording, str]:
    """A recording without its sensor data, and the SHA-256 of its ground truth."""
    tables = replace(read_tables(folder), sd=None)
    refuse_findings(folder, examine(tables, None), accept)
    return recording_of(tables, lenient=True), file_hash(tables.gt_file)


def _points(recording: Recording) -> Iterator[tuple[str, MotionPoints]]:
    """The points of every object that moves, by its kind: of the splines that the assessment takes states from."""
    for tracks in _pieces(recording.gt):
        for n in range(len(tracks)):
            own = tracks.valid[n]
            if own.sum() < 2 or np.abs(tracks.v[n, own]).max() < PARKED:
                continue
            trace = fit_trace(
                tracks.t[own], tracks.x[n, own], tracks.y[n, own], tracks.heading[n, own], tracks.v[n, own]
            ).trace
            span = trace.end - trace.start
            scenes = int(span / AHEAD + 1e-6)
            if scenes:
                t = trace.start + 0.5 * (span - AHEAD * scenes) + AHEAD * np.arange(scenes + 1)
                s = trace.states(t)
                yield str(tracks.kind[n]), MotionPoints.of_object(s.v, s.heading, s.a, s.yaw_rate)


def _pieces(tracks: Tracks) -> Iterator[Tracks]:
    """Tracks that can be fitted: no longer than a run, no hole longer than is bridged."""
    for start in np.arange(tracks.t[0], tracks.t[-1], LONGEST):
        yield tracks.window(start, start + LONGEST).split(GAP, keep="")


def _joined(parts: list[MotionPoints]) -> MotionPoints:
    if not parts:
        raise ResimError(f"0 points, at least {LEAST} are fitted")
    return MotionPoints.joined(parts)


def _entry(fit: Refit, sources: Mapping[str, str]) -> PredictionEntry:
    points = fit.points
    fitted = PredictionSources(
        sources=dict(sources), points=len(points), objects=fit.objects,
        v=_span(points.v), a=_span(points.a0), w=_span(points.w0),
        log_likelihood=_short(fit.after), log_likelihood_published=_short(fit.before),
        standard_errors={name: None if e is None else _short(e) for name, e in fit.errors.items()},
    )  # fmt: skip
    provenance = f"fitted to {len(points)} points of {fit.objects} objects of {len(sources)} recordings"
    motion = _rounded(fit.motion)
    if isinstance(motion, WalkerMotion):
        return PredictionEntry(provenance=provenance, walking=motion, fitted=fitted)
    return PredictionEntry(provenance=provenance, ctra=motion, fitted=fitted)


def _rounded(motion: ObjectMotion) -> ObjectMotion:
    short = {
        name: tuple(map(_short, value)) if isinstance(value, tuple) else _short(value)
        for name, value in asdict(motion).items()
    }
    return replace(motion, **short)  # type: ignore[arg-type]  # each of its own type


def _span(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[float, float]:
    return _short(float(values.min())), _short(float(values.max()))


def _short(value: float) -> float:
    """A number of six digits: what lies beyond depends on the machine."""
    return float(f"{value:.6g}")


def _provenance(recordings: int) -> str:
    return (
        f"`resim assess fit-prediction` of resim {resim.__version__}: maximum likelihood (Eq. 4.2, 4.3) over "
        f"{recordings} recordings, scenes {AHEAD:g} s apart, responses averaged over {AHEAD:g} s; other "
        "kinds use the published set."
    )
