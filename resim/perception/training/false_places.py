"""Do false objects fit the model? It spreads them evenly in range and bearing, and they drive along with the EGO."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.stats import binomtest, kstest

from resim.core.geometry import Floats
from resim.perception.model import FailedAssumption
from resim.perception.parts.false_objects import FalseObjects
from resim.perception.training.drive import TrainingDrive
from resim.perception.training.matching import Matching

FEWEST_FALSE = 8
"""False objects below which nothing is tested."""
LEAST_APART = 0.15
"""Least distance between two distribution functions that is told."""
ASKEW = 0.5
"""rad against the EGO's heading, or its opposite, from which on a false object does not drive along it."""
LEAST_ASKEW = 0.05
"""Share of them that is told."""


def false_tracks(drives: Sequence[TrainingDrive], matchings: Sequence[Matching]) -> Floats:
    """Give of each false object (n, 7), as it was seen first: distance [m], bearing [rad], heading against the EGO's
    [rad], speed along the EGO's heading [m/s, mean], length, width [m], largest speed [m/s]."""
    rows = []
    for drive, matching in zip(drives, matchings, strict=True):
        for m in np.flatnonzero(matching.stranger.any(axis=1)):
            lists = np.flatnonzero(matching.stranger[m])
            x, y, heading = (column[m, lists[0]] for column in (drive.x, drive.y, drive.heading))
            v = drive.v[m, lists]
            along = float(np.mean(v * np.cos(drive.heading[m, lists])))
            rows.append(
                (
                    np.hypot(x, y),
                    np.arctan2(y, x),
                    heading,
                    along,
                    drive.length[m],
                    drive.width[m],
                    np.abs(v).max(),
                )
            )
    return np.array(rows, dtype=float).reshape(-1, 7)


class FalsePlaces:
    """Where false objects are, and where they drive, beside the model; each is one draw of it."""

    def __init__(self, tracks: Floats, model: FalseObjects) -> None:
        self.found: list[tuple[str, float, str, float, str]] = []
        if len(tracks) >= FEWEST_FALSE:
            distance, bearing, heading = tracks[:, :3].T
            self._ask_even("distances", distance / model.range, f"0 to {model.range:.3g} m")
            even = 0.5 + 0.5 * bearing / model.bearing
            self._ask_even("bearings", even, f"{-model.bearing:.3g} to {model.bearing:.3g} rad")
            self._ask_headings(heading[tracks[:, 6] > 1.0])
        self.count = len(self.found)

    def _ask_even(self, on: str, values: Floats, span: str) -> None:
        apart, p = kstest(np.clip(values, 0.0, 1.0), "uniform")
        text = f"{on} of false objects are not spread evenly over {span} as in the model: {apart:.0%} lie elsewhere"
        size = float(apart) if apart >= LEAST_APART else 0.0
        self.found.append((on, size, "", float(p), text))

    def _ask_headings(self, heading: Floats) -> None:
        if len(heading) < FEWEST_FALSE:
            return
        askew = int((np.abs(np.sin(heading)) > np.sin(ASKEW)).sum())
        share = askew / len(heading)
        p = float(binomtest(askew, len(heading), LEAST_ASKEW, alternative="greater").pvalue)
        text = f"{share:.0%} of the false objects that move drive across the EGO's heading, in the model all along it"
        self.found.append(("headings", share if share > LEAST_ASKEW else 0.0, "", p, text))

    def failures(self, level: float) -> Iterator[FailedAssumption]:
        """Give what is surely there, and large enough."""
        for on, size, unit, p, text in self.found:
            if p < level and size > 0.0:
                yield FailedAssumption(
                    quantity="false objects", assumption="places", on=on, size=size, unit=unit, p=p, text=text
                )
