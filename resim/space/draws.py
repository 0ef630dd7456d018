"""What is one draw of what traffic does: members of one drive are no evidence of each other.

Variations of a measured scenario, its seeds, the drive itself and all scenarios that were cut out of it share its
traffic, its weather and its road. They tell what happens in and near that drive, and nothing of how much drives differ:
an interval over them as if each were drawn anew is too narrow (a cluster sample; Kish, Survey Sampling, 1965). So a
recording is one draw of each kind of scenario in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from resim.core.geometry import Floats
from resim.space.model import Space
from resim.space.statistics.rates import IntervalEstimate, for_drives, rate, spread_by
from resim.space.traces import Ints


@dataclass(frozen=True, eq=False)
class Driven:
    """What was driven to see scenarios.

    Attributes:
        whole: h and km in all; NaN where nobody says.
        drives: How many drives have a scenario (`for_drives`).
        lengths: (D, 2) h and km of each drive (`drive_lengths`).
    """

    whole: tuple[float, float]
    drives: int
    lengths: Floats

    def rates(
        self, drive: Ints, counts: tuple[float, float] | None = None, part: float = 1.0
    ) -> tuple[IntervalEstimate, IntervalEstimate]:
        """Give how often something comes, by hour and kilometre.

        drive (K,): of each, which is one draw of its traffic; counts: how many of them came in that part of what was
        driven, by hours and by kilometres; all where not given.
        """
        hours, kilometres = (
            for_drives(rate(count, part * whole, spread_by(drive, length)), self.drives, length)
            for count, whole, length in zip(
                counts or (len(drive),) * 2, self.whole, self.lengths.T, strict=True
            )
        )
        return hours, kilometres


def driven_in(space: Space) -> Driven:
    """Give what was driven to see the scenarios of a space."""
    return Driven(space.driven, space.rows["drive"].nunique(), drive_lengths(space))


def drive_numbers(rows: pd.DataFrame) -> Ints:
    """Give the number (N,) of the drive of each scenario: its recording, and those that are it again. rows: of a
    space."""
    return np.asarray(rows.groupby("drive", sort=False).ngroup(), dtype=np.intp)


def drive_lengths(space: Space) -> Floats:
    """Give the hours and kilometres (D, 2) of each drive by its number, and after these of those without a scenario.

    Of recordings that are one drive they are those of the longest; NaN where nobody says.
    """
    every = [(one.drives[name], *length) for one in space.sources for name, length in one.lengths.items()]
    found = pd.DataFrame(every, columns=["drive", "hours", "kilometres"]).groupby("drive").max()
    order = dict.fromkeys([*space.rows["drive"].astype(str), *found.index])
    return found.reindex(list(order)).to_numpy(float)


def scenario_draws(rows: pd.DataFrame) -> np.ndarray:
    """Give the draw (N,) of each scenario, by the name of the first one of its recording. rows: of the space."""
    _, first, inverse = np.unique(drive_numbers(rows), return_index=True, return_inverse=True)
    return np.asarray(rows["scenario"].astype(str).to_numpy()[first[inverse]])


def tracks_of(space: Space) -> list[str]:
    """Give the hash (`tracks_hash`) of the recording of each scenario (N,), "" where nobody says."""
    told = {(one.name, name): tracks for one in space.sources for name, tracks in one.recordings.items()}
    recordings = zip(space.rows["source"].astype(str), space.rows["recording"].astype(str), strict=True)
    return [told.get(one, "") for one in recordings]


def recording_draws(space: Space, scenario: Mapping[str, str], drive: Mapping[str, str]) -> dict[str, str]:
    """Give the draw of each recording that is simulated, by key.

    scenario: of the space that each is, "" for none, by key; drive: that it was cut out of (`DrivenTraces`). One that
    is no scenario, of a drive that the space was mined of, is one draw with what was cut out of that drive.
    """
    rows = space.rows
    draws = scenario_draws(rows).tolist()
    of_scenario = dict(zip(rows["scenario"].astype(str), draws, strict=True))
    of_drive = {told: draw for told, draw in zip(tracks_of(space), draws, strict=True) if told}
    out = {key: of_scenario[name] for key, name in scenario.items() if name in of_scenario}
    for key, draw in out.items():
        of_drive.setdefault(drive.get(key, key), draw)
    return {key: out.get(key) or of_drive.get(own, own) for key in scenario for own in [drive.get(key, key)]}
