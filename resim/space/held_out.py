"""Predicted risk against drives that are held out, by what is known without them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pandas as pd

from resim.space.calibration import ReliabilityReport
from resim.space.draws import scenario_draws
from resim.space.members import DrivenTraces, SimulatedRun, clusters_of, overlapping
from resim.space.model import Space
from resim.space.risk import calibrated, predicted_risks


def held_out_calibration(
    space: Space, members: pd.DataFrame, build: str, spared: Sequence[SimulatedRun], known: DrivenTraces
) -> ReliabilityReport:
    """Whether predicted risk is to be believed, by predictions that know nothing of the drives that are held out."""
    held = {known.draw.get(run.recording, run.recording) for run in spared}
    alike = [key for key in known.scenario if known.draw.get(key, key) in held]
    told = {known.scenario[key] for key in alike} - {""}
    draws = dict(zip(space.rows["scenario"].astype(str), scenario_draws(space.rows).tolist(), strict=True))
    seen = {draws.get(one) for one in told}
    same = {name for name, draw in draws.items() if draw in seen}
    scenarios = same.union(overlapping(space.rows, told))
    # other seeds, variations, windows and views of what is held out would tell how it ends
    others = members[~members["origin"].isin([*alike, *scenarios])]
    risks = predicted_risks(space, others, build, scenarios)
    mined = _mined_of(space, known)
    clusters = {key: name for key, name in clusters_of(space, known).items() if key not in mined}
    return calibrated(risks, spared, clusters, known.draw)


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
