"""Predicted risk against drives that are held out, by what is known without them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from resim.space.calibration import ReliabilityReport, reliability
from resim.space.draws import recording_draws, scenario_draws
from resim.space.members import INSIDE, DrivenTraces, SimulatedRun, clusters_of
from resim.space.model import Space
from resim.space.repeated_drives import merged
from resim.space.risk import ClusterRisk, predicted_risks


def held_out_calibration(
    space: Space, members: pd.DataFrame, build: str, spared: Sequence[SimulatedRun], known: DrivenTraces
) -> ReliabilityReport:
    """Whether predicted risk is to be believed, by predictions that know nothing of the drives that are held out."""
    drives = {known.drive.get(run.recording, run.recording) for run in spared}
    alike = [key for key in known.scenario if known.drive.get(key, key) in drives]
    told = {known.scenario[key] for key in alike}
    draws = pd.Series(scenario_draws(space.rows), index=space.rows["scenario"].astype(str))
    scenarios = set(draws.index[draws.isin(draws[draws.index.isin(told)])])
    # other seeds, variations and scenarios of a drive that is held out would tell how it ends
    others = members[~members["origin"].isin([*alike, *scenarios])]
    risks = predicted_risks(space, others, build, scenarios)
    mined = _mined_of(space, known)
    clusters = {key: name for key, name in clusters_of(space, known).items() if key not in mined}
    return calibrated(risks, spared, clusters, _draws(space, known))


def _draws(space: Space, known: DrivenTraces) -> dict[str, str]:
    """What each recording is one draw with, by key: what was cut out of one drive, or is one by the space."""
    keys = list(known.scenario)
    of_space = recording_draws(space, known.scenario, known.drive)
    names = [*(known.drive.get(key, key) for key in keys), *(f"draw {of_space[key]}" for key in keys)]
    pairs = np.arange(2 * len(keys)).reshape(2, -1).T
    return dict(zip(keys, merged(names, pairs)[: len(keys)].tolist(), strict=True))


def _mined_of(space: Space, known: DrivenTraces) -> set[str]:
    """Recordings, by key, of whose drives the space was mined: which of its scenarios are of them is not known."""
    mined = {tracks for one in space.sources for tracks in one.recordings.values()}
    parts = {key for key, name in known.scenario.items() if not name and known.drive.get(key, key) in mined}
    return mined | parts


def mined_whole(space: Space, spared: Sequence[SimulatedRun], known: DrivenTraces) -> Iterator[str]:
    """A note where nothing is predicted of drives that are held out, since the space was mined of them."""
    mined = _mined_of(space, known)
    count = sum(run.recording in mined for run in spared)
    if count:
        yield (
            f"{count} held-out drives are of recordings that the space was mined of, and nothing is predicted of them: "
            "hold out their scenarios (`resim mine --scenarios recordings`), or other drives"
        )


def calibrated(
    risks: Sequence[ClusterRisk], held: Sequence[SimulatedRun], cluster: Mapping[str, str],
    draw: Mapping[str, str] | None = None,
) -> ReliabilityReport:  # fmt: skip
    """Compare the risk of clusters, by their members that count, with the collisions of drives that were held out.

    risks: without what is held out (`predicted_risks`). cluster: of recordings, by key. A held-out drive of no cluster,
    of one without a risk, or that is not what was verified has no prediction. Predicted is the least that a cluster's
    risk may be with all that is missing: else one that rises as harmless members are lost would be calibrated. draw:
    what several recordings are one draw of, by key.
    """
    known = [one for one in risks if one.drives]
    least = {
        one.cluster: min(float(one.means(largest=False)[0].min()), float(one.risk.value)) for one in known
    }
    value = {one.cluster: float(one.risk.value) for one in known}
    of = ["" if run.changed or run.trust != INSIDE else cluster.get(run.recording, "") for run in held]
    collided = np.array([np.nan if run.collided is None else float(run.collided) for run in held])
    draws = [(draw or {}).get(run.recording, run.recording) for run in held]

    def report(by_name: Mapping[str, float]) -> ReliabilityReport:
        return reliability(
            np.array([by_name.get(name, np.nan) for name in of], dtype=float), collided, draws, of
        )

    found = report(least)
    if found.verdict == "too low" and report(value).verdict != "too low":
        return replace(found, verdict="not shown")  # it may be what is missing
    return found
