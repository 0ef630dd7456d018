"""First sight, loss and regain of objects: counted by range, bearing and occlusion, and the field of view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, chi2

from resim.core.geometry import Bools, Floats
from resim.core.tracks import Strings
from resim.perception.model import Detection, FieldOfView, TrainedParameter
from resim.perception.runtime.chain import rates
from resim.perception.runtime.world import occlusion
from resim.perception.training.drive import TrainingDrive
from resim.perception.training.matching import Matching

CHANCE = 1e-4
"""Probability of a split by chance, above which it is not made."""
SPLITS = (5, 3, 2)
"""Most edges within range, |bearing| and occlusion."""
BEYOND = 3.0
"""Time [s] that objects have to be unseen beyond who was seen farthest, for that to be the field of view's end."""
MOST_CHANGES = 0.998
"""Probability of loss and that of regain within a step, together, at which a step hardly knows of the one before."""
LIKELY = 0.3
"""Share of detected samples just within it, that makes it an edge rather than the fading of detection."""


Chosen = list[list[int]]
Table = tuple[tuple[tuple[float, ...], ...], ...]


@dataclass(frozen=True, eq=False)
class DetectionSamples:
    """Whether true objects were seen, list by list: S samples of range [m], |bearing| [rad], occlusion and seen, and
    the indices (P, 2) of samples of one object in lists that follow each other; steps (P,) s; track and drive (S,).

    motion (S, 4): bearing [rad], left positive; speed, relative speed [m/s], acceleration [m/s²]. kind: (S,). list:
    (S,) number of the list, counted over all drives.
    """

    place: Floats
    seen: Bools
    pairs: NDArray[np.intp]
    steps: Floats
    track: NDArray[np.intp]
    drive: NDArray[np.intp]
    motion: Floats
    kind: Strings
    list: NDArray[np.intp]

    def inside(self, view: FieldOfView) -> Bools:
        """Which samples (S,) lie in the field of view."""
        out = np.ones(len(self.seen), dtype=bool)
        for column, end in enumerate((view.range, view.bearing)):
            if end is not None:
                out &= self.place[:, column] <= end
        return out

    def first(self, inside: Bools) -> Bools:
        """Which samples (S,) are the first ones of an object that are inside."""
        goes_on = np.zeros(len(self.seen), dtype=bool)
        goes_on[self.pairs[inside[self.pairs].all(axis=1), 1]] = True
        return inside & ~goes_on


def sightings_of(
    drives: Sequence[TrainingDrive], matchings: Sequence[Matching], late: float
) -> DetectionSamples:
    """Gather them; places are those of `late` seconds ago in the EGO's frame of now."""
    places, seen, pairs, steps, tracks, of_drive, motions, kinds, lists = ([], [], [], [], [], [], [], [], [])
    total, before = 0, 0
    some_lost = any(
        (m.row[np.isfinite(d.states[:, 0])] < 0).any() for d, m in zip(drives, matchings, strict=True)
    )
    number = 0
    for k, (drive, matching) in enumerate(zip(drives, matchings, strict=True)):
        then = np.array([truth.states(drive.t - late) for truth in drive.truth]).reshape(
            len(drive.truth), 5, len(drive.t)
        )
        x, y, heading = drive.in_frame(then)
        hidden = _occlusions(drive, x, y, heading) if some_lost else np.zeros(x.shape)
        place = np.stack([np.hypot(x, y), np.abs(np.arctan2(y, x)), hidden], axis=-1)
        known = np.isfinite(x)
        index = total + np.cumsum(known.ravel()).reshape(known.shape) - 1
        both = known[:, 1:] & known[:, :-1]
        places.append(place[known])
        seen.append((matching.row >= 0)[known])
        tracks.append(np.repeat(number + np.arange(len(x)), known.sum(axis=1)))
        of_drive.append(np.full(int(known.sum()), k))
        own = drive.ego[3][None, :]
        motion = [np.arctan2(y, x), then[:, 3], then[:, 3] * np.cos(heading) - own, then[:, 4]]
        motions.append(np.stack(motion, axis=-1)[known])
        kinds.append(np.repeat(drive.gt_kind, known.sum(axis=1)))
        lists.append(np.broadcast_to(before + np.arange(len(drive.t)), known.shape)[known])
        before += len(drive.t)
        pairs.append(np.stack([index[:, :-1][both], index[:, 1:][both]], axis=1))
        steps.append(np.broadcast_to(np.diff(drive.t), both.shape)[both])
        total, number = total + int(known.sum()), number + len(x)
    gathered = [
        np.concatenate(part) for part in (places, seen, pairs, steps, tracks, of_drive, motions, kinds, lists)
    ]
    return DetectionSamples(*gathered)


def _occlusions(drive: TrainingDrive, x: Floats, y: Floats, heading: Floats) -> Floats:
    out = np.zeros(x.shape)
    if len(x) < 2:
        return out
    for k in range(x.shape[1]):
        here = np.isfinite(x[:, k])
        out[here, k] = occlusion(
            x[here, k], y[here, k], heading[here, k], drive.gt_length[here], drive.gt_width[here]
        )
    return out


def field_of_view(s: DetectionSamples, step: float) -> tuple[FieldOfView, dict[str, TrainedParameter]]:
    """Give where the field of view ends: at who was seen farthest, if others were beyond for long and never seen.

    The interval reaches from there to the nearest who was not seen.
    """
    found: dict[str, float] = {}
    estimates = {}
    inside = np.ones(len(s.seen), dtype=bool)
    for column, name in ((0, "range"), (1, "bearing")):
        value = s.place[:, column]
        if not s.seen.any():
            break
        edge = float(value[s.seen].max())
        beyond = inside & (value > edge)
        rim = inside & (value > 0.9 * edge) & (value <= edge)
        enough = beyond.sum() * step >= BEYOND and len(np.unique(s.track[beyond])) >= 3
        if enough and s.seen[rim].mean() >= LIKELY:
            found[name] = edge
            estimates[f"field_of_view.{name}"] = TrainedParameter(
                value=edge, low=edge, high=float(value[beyond].min()), samples=int(rim.sum() + beyond.sum())
            )
            inside &= value <= edge
    return FieldOfView(**found), estimates


def fit_detection(s: DetectionSamples, view: FieldOfView) -> tuple[Detection, dict[str, TrainedParameter]]:
    """Give rates and first sight by bins. Edges are put where losses or gains change, one after the other, as long as
    the likelihood gains more than chance would; where nothing was ever lost everything is always detected."""
    inside = s.inside(view)
    kept = inside[s.pairs].all(axis=1)
    before, after = s.pairs[kept].T
    if not len(before) or s.seen[inside].all():
        return Detection(), {}
    place = s.place[after]
    fine = [_candidates(place[:, c], most) for c, most in ((0, 60), (1, 20), (2, 10))]
    counts = np.stack([
        np.histogramdd(place[(s.seen[before] == was) & (s.seen[after] == now)], bins=fine)[0]
        for was, now in ((True, True), (True, False), (False, False), (False, True))
    ])  # fmt: skip
    chosen = _edges(counts)
    edges = [f[np.array(c)] for f, c in zip(fine, chosen, strict=True)]
    detection, estimates = _rates(_merged(counts, chosen), edges, float(s.steps[kept].mean()))
    first, found = _first(s, inside, edges)
    return detection.model_copy(update={"first": first}), estimates | found


def _first(
    s: DetectionSamples, inside: Bools, edges: list[Floats]
) -> tuple[Table, dict[str, TrainedParameter]]:
    """Give the probability to be seen at first by bins, smoothed by one object of the share of all that is seen there.

    That share alone stands in bins in which nobody appears.
    """

    def counted(which: Bools) -> Floats:
        place = np.clip(s.place[which], [e[0] for e in edges], [e[-1] for e in edges])
        return np.histogramdd(place, bins=edges)[0]

    seen, every = counted(inside & s.seen), counted(inside)
    overall = s.seen[inside].mean()
    share = (seen + overall) / (every + 1.0)
    starts = s.first(inside)
    found, new = counted(starts & s.seen), counted(starts)
    first = (found + share) / (new + 1.0)
    estimates = {}
    for at in np.ndindex(first.shape):
        a, b = found[at] + share[at], new[at] - found[at] + 1.0 - share[at]
        low, high = (float(beta.ppf(q, max(a, 1e-9), max(b, 1e-9))) for q in (0.025, 0.975))
        value = float(first[at])
        estimates["detection.first." + ".".join(map(str, at))] = TrainedParameter(
            value=value, low=min(low, value), high=max(high, value), samples=int(new[at])
        )
    return _nested(first), estimates


def _candidates(values: Floats, most: int) -> Floats:
    """Give edges at quantiles of what is not 0, the outer ones at what there is."""
    zero = values == 0.0
    told = values[~zero] if zero.any() and not zero.all() else values  # whom nothing hides: they are one bin
    edges = np.unique(np.round(np.quantile(told, np.linspace(0.0, 1.0, most + 1)), 3))
    if len(told) < len(values):
        edges = np.concatenate([[0.0], edges])
    edges[0], edges[-1] = np.floor(values.min() * 1e3) / 1e3, np.ceil(values.max() * 1e3) / 1e3
    return edges if len(edges) > 1 and edges[-1] > edges[0] else np.array([edges[0], edges[0] + 1.0])


def _merged(counts: Floats, chosen: Chosen) -> Floats:
    out = counts
    for axis, edges in enumerate(chosen, start=1):
        out = np.add.reduceat(out, edges[:-1], axis=axis)
    return out


def _loglik(counts: Floats) -> float:
    total = 0.0
    for stays, goes in (counts[:2], counts[2:]):
        both = np.maximum(stays + goes, 1.0)
        for n in (stays, goes):
            total += float((n * np.log(np.maximum(n, 1e-300) / both)).sum())
    return total


def _edges(counts: Floats) -> Chosen:
    """Give, for each of the three, indices of the chosen edges among the candidates, the outer ones included.

    The one that tells most comes next; then each moves to its best place, and who tells nothing any more goes.
    """
    chosen = [[0, n] for n in counts.shape[1:]]
    while True:
        trials = [
            (axis, sorted([*chosen[axis], edge]))
            for axis, most in enumerate(SPLITS)
            if len(chosen[axis]) - 2 < most
            for edge in range(1, counts.shape[axis + 1])
            if edge not in chosen[axis]
        ]
        made = [_with(chosen, axis, edges) for axis, edges in trials]
        best = min(made, key=lambda trial: _chance(counts, chosen, trial), default=chosen)
        if best is chosen or _chance(counts, chosen, best) > np.log(CHANCE):
            return chosen
        chosen = _pruned(counts, _moved(counts, best))


def _with(chosen: Chosen, axis: int, edges: list[int]) -> Chosen:
    return [edges if a == axis else c for a, c in enumerate(chosen)]


def _chance(counts: Floats, less: Chosen, more: Chosen) -> float:
    """Give the logarithm of the probability that so much likelihood is gained by chance."""
    bins = [int(np.prod([len(c) - 1 for c in chosen])) for chosen in (less, more)]
    gained = _loglik(_merged(counts, more)) - _loglik(_merged(counts, less))
    return float(chi2.logsf(2.0 * gained, 2 * (bins[1] - bins[0])))


def _moved(counts: Floats, chosen: Chosen) -> Chosen:
    """Give the edges, each moved to its best place between its neighbours."""
    for axis in range(3):
        for k in range(1, len(chosen[axis]) - 1):
            edges = chosen[axis]
            places = [[*edges[:k], e, *edges[k + 1 :]] for e in range(edges[k - 1] + 1, edges[k + 1])]
            trials = [_with(chosen, axis, place) for place in places]
            chosen = max(trials, key=lambda trial: _loglik(_merged(counts, trial)))
    return chosen


def _pruned(counts: Floats, chosen: Chosen) -> Chosen:
    """Give the edges without those that tell nothing."""
    for axis in range(3):
        for edge in chosen[axis][1:-1]:
            less = _with(chosen, axis, [e for e in chosen[axis] if e != edge])
            if _chance(counts, less, chosen) > np.log(CHANCE):
                chosen = less
    return chosen


def _rates(counts: Floats, edges: list[Floats], step: float) -> tuple[Detection, dict[str, TrainedParameter]]:
    """Probabilities of a step, smoothed by half an event at the rate of all bins; then rates.

    What is lost and regained independently of the step before, or alternates, is the quickest that rates can tell.
    """
    stays, lost, away, gained = counts
    probabilities, limits = [], []
    for n, rest in ((lost, stays), (gained, away)):
        overall = (n.sum() + 0.5) / (n.sum() + rest.sum() + 1.0)
        a, b = n + 0.5, rest + 0.5 / overall - 0.5
        probabilities.append(a / (a + b))
        limits.append([beta.ppf(q, a, b) for q in (0.025, 0.975)])
    changes = probabilities[0] + probabilities[1]
    fewer = np.minimum(1.0, MOST_CHANGES / changes)  # which leaves the share that is detected as it is
    loss, gain = rates(probabilities[0] * fewer, probabilities[1] * fewer, step)
    estimates = {}
    for name, value, p, (low, high), exposed in (
        ("loss", loss, probabilities[0], limits[0], stays + lost),
        ("gain", gain, probabilities[1], limits[1], away + gained),
    ):  # fmt: skip
        for at in np.ndindex(value.shape):
            factor = value[at] / p[at]
            estimates[f"detection.{name}." + ".".join(map(str, at))] = TrainedParameter(
                value=float(value[at]),
                low=float(low[at] * factor),
                high=float(high[at] * factor),
                samples=int(exposed[at]),
            )
    table = {"range_edges": edges[0], "bearing_edges": edges[1], "occlusion_edges": edges[2]}
    fitted = Detection(
        **{k: tuple(v.tolist()) for k, v in table.items()}, loss=_nested(loss), gain=_nested(gain)
    )
    return fitted, estimates


def _nested(values: Floats) -> Table:
    return tuple(tuple(tuple(cell) for cell in row) for row in values.tolist())
