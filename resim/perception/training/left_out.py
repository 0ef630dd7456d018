"""What training leaves out, counted by reason: a model stands for no more than what it was trained on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resim.perception.model import LeftOut
from resim.perception.training.drive import TrainingDrive
from resim.perception.training.errors import MEASURED, ObjectErrors
from resim.perception.training.matching import Matching
from resim.perception.training.samples import TrainingSamples
from resim.recordings.recording import Recording


def left_out(
    recordings: Sequence[Recording], drives: Sequence[TrainingDrive], matchings: Sequence[Matching],
    samples: TrainingSamples,
    objects: ObjectErrors,
) -> tuple[LeftOut, ...]:  # fmt: skip
    """Count lists, objects, samples and drives that no error was learned from; reasons of which there are none are
    left away. Samples of objects: each perceived one in each list."""
    lists = sum(len(r.sd.t) for r in recordings if r.sd is not None)
    used = sum(int((d.t >= 0).size) for d in drives)
    seen = sum(int(d.seen.sum()) for d in drives)
    strangers = sum(int(m.stranger.sum()) for m in matchings)
    matched = sum(int((m.row >= 0).sum()) for m in matchings)
    rows = int(samples.seen.sum())
    known = samples.seen & np.isfinite(objects.features).all(axis=-1)
    counts = [
        ("lists", "the EGO's ground truth is missing at that time", max(lists - used, 0), lists),
        ("samples", "they match no ground-truth object, and no gt_id is given: false objects, which have no errors",
         strangers, seen),
        ("samples", "they lie too far from their object, or its ground truth is missing at that time",
         seen - matched - strangers, seen),
        ("samples", "their object is perceived only once", matched - rows, seen),
        ("samples", "the ground truth is missing one latency earlier", rows - int(known.sum()), seen),
    ]  # fmt: skip
    for name in MEASURED:
        fitted = objects.fitted[name]
        outliers = np.isfinite(fitted.residual) & known & ~fitted.known
        counts.append(
            (f"samples of {name}", "outliers beyond 6 standard deviations", int(outliers.sum()), seen)
        )
    objects_seen = [int((m.row >= 0).any(axis=1).sum()) for m in matchings]
    there = sum(len(m.row) for m in matchings)
    without = sum(not np.any(known[samples.drive == d]) for d in range(len(drives)))
    counts += [
        ("objects", "no perceived object matches them", there - sum(objects_seen), there),
        ("drives", "none of their samples is left", without, len(drives)),
    ]
    return tuple(LeftOut(what=w, reason=why, count=n, of=of) for w, why, n, of in counts if n > 0)
