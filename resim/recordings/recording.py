"""The recording: one measured drive, its ground truth and what the sensors made of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.finding import Finding
from resim.core.geometry import Floats
from resim.core.tracks import Strings, Tracks
from resim.recordings.identity import DetectionSpread, name_by_ground_truth

FINEST, COARSEST = 1e-4, 1e3
"""Least and largest usual time [s] between samples."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One measured drive.

    Attributes:
        name: Of its folder.
        map: OpenDRIVE file, resolved.
        ego: The EGO's id in `gt`.
        gt: Ground-truth tracks (map frame).
        gt_rate: Samples a second [Hz].
        sd: Sensor tracks (map frame), with times of their own.
        sd_rate: Samples a second [Hz].
        sd_gt_id: (N_sd,) GT id of each SD object, "" where it has none.
        existence_probability: (N_sd, T_sd), NaN where not given.
        build: Label of the build that drove.
        build_hash: What pins it.
        plan: The EGO's recorded plans, one row per time `t` a plan was made and planned time `t_plan` [s], both on the
            recording's clock, with x, y [m] and v [m/s].
        environment: In JSCEN's terms.
        provenance: Free text by topic.
        folder: Where it was read.
        repair_marks: For "gt" and "sd", where anything was repaired: (N, T) "" or the codes of the findings, spaces
            between.
        findings: What is known to be wrong with it, worst first.
        incomplete: For "gt" and "sd" the rows that lack a value and are in no track, by the names of `sd_by_gt`.
        sizes: For "gt" and "sd" the largest length and width [m] that rows give an object, or gave it before a repair.
        repeated: For "gt" and "sd", by the names of `sd_by_gt`, by what rows of one object and time differ.
        repairs: For "gt" and "sd" the rows that were repaired, and whether the sample was filled (column `filled`:
            nobody saw it so).
    """

    name: str
    map: Path
    ego: str
    gt: Tracks
    gt_rate: float
    sd: Tracks | None = None
    sd_rate: float | None = None
    sd_gt_id: Strings | None = None
    existence_probability: Floats | None = None
    build: str | None = None
    build_hash: str | None = None
    plan: pd.DataFrame | None = None
    environment: Mapping[str, str] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)
    folder: Path | None = None
    repair_marks: Mapping[str, Strings] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    incomplete: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    sizes: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    repeated: Mapping[str, Mapping[str, DetectionSpread]] = field(default_factory=dict)
    repairs: Mapping[str, pd.DataFrame] = field(default_factory=dict)

    @property
    def repaired(self) -> dict[str, dict[str, int]]:
        """How many samples were repaired: by "gt" or "sd", then by code of the finding; empty where none."""
        counts = {
            name: Counter(code for text in marks.ravel().tolist() if text for code in text.split())
            for name, marks in self.repair_marks.items()
        }
        return {name: dict(sorted(count.items())) for name, count in counts.items() if count}

    @property
    def senses_ego(self) -> bool:
        """Whether the SD has a track of the EGO."""
        return self.sd_gt_id is not None and self.ego in self.sd_gt_id

    def sd_by_gt(self) -> Tracks | None:
        """Give the SD tracks under the GT ids, or None where nothing was measured.

        Fragments of one GT object are merged (see `name_by_ground_truth`), objects without one are called
        `sd:<id>`. Where the SD has no track of the EGO, the GT's, interpolated at the SD times, stands in.
        """
        if self.sd is None or self.sd_gt_id is None:
            return None
        sd = name_by_ground_truth(self.sd, self.sd_gt_id, self.existence_probability)
        if self.ego in sd.ids:
            return sd
        return Tracks.concatenate([sd, self.ego_at(sd.t)])

    def ego_at(self, t: Floats) -> Tracks:
        """Give the GT's EGO at t (T,) [s], between samples that are at most two of its usual steps apart.

        Args:
            t: (T,) s.
        """
        own = self.gt.select([self.ego])
        step = float(np.median(np.diff(own.t[own.valid[0]]))) if own.valid[0].sum() > 1 else 0.0
        return own.at(t, max_gap=2.0 * step)


def sample_rate(source: Path, tracks: Tracks) -> float:
    """Give the samples a second [Hz], by the median step of all objects; InputError where none has two."""
    steps = np.concatenate([np.diff(tracks.t[known]) for known in tracks.valid])
    if not len(steps):
        raise InputError(source, "no object has two samples", "A recording needs motion: give every sample.")
    step = float(np.median(steps))
    if not FINEST <= step <= COARSEST:
        problem = f"samples are {step:g} s apart, expected {FINEST:g} to {COARSEST:g} s"
        raise InputError(source, problem, "Give t in seconds.")
    return round(1.0 / step, 6)
