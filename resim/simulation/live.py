"""States of a simulation while it runs, for whoever watches: written into the file that RESIM_LIVE names.

The file holds the latest state alone, whole at every moment, and is written at most 25 times a second. A simulation
never waits for a reader, and never fails where the file cannot be written.
"""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from pathlib import Path

from resim.core.geometry import wrap_angle
from resim.core.watched import LIVE_VARIABLE
from resim.simulation.case import Case
from resim.simulation.perception import Worlds

EVERY = 0.04
"""s between two states, at least."""
MOST = 500
"""Objects of a state at most: those nearest to the EGO."""


class LiveStates:
    """Tells of one drive. Of runs that are driven together the first one is shown."""

    def __init__(self, case: Case, file: str, end: float) -> None:
        self._file, self._new, self._next = file, Path(f"{file}.{os.getpid()}.new"), 0.0
        ego = case.scenario.ego
        self._ego = [ego.id, ego.kind, ego.length, ego.width]
        self._head = {
            "map": str(case.network.path), "build": case.build.label, "seed": case.seed, "end": round(end, 3)
        }  # fmt: skip

    def show(self, worlds: Worlds) -> None:
        """Write a state, unless the one before is younger than EVERY."""
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + EVERY
        x, y, heading, v = worlds.ego[0, :4].tolist()
        name, kind, length, width = self._ego
        away = abs(worlds.position - complex(x, y))
        nearest = away.argsort(kind="stable")[:MOST].tolist()
        boxes = [[name, kind, round(x, 3), round(y, 3), round(heading, 4), round(v, 3), length, width]]
        for n in nearest:
            if away[n] < float("inf"):  # also not NaN: it is there
                place = worlds.position[n]
                boxes.append([
                    str(worlds.ids[n]), str(worlds.kind[n]), round(place.real, 3), round(place.imag, 3),
                    round(float(wrap_angle(worlds.heading[n])), 4), round(float(worlds.v[n]), 3),
                    round(float(worlds.length[n]), 2), round(float(worlds.width[n]), 2),
                ])  # fmt: skip
        state = {**self._head, "t": round(worlds.t, 3), "boxes": boxes}
        with suppress(OSError, ValueError):  # of values that are no numbers
            told = json.dumps(state, separators=(",", ":"), allow_nan=False)
            self._new.write_text(told, encoding="utf-8")
            self._new.replace(self._file)


def live_states(case: Case, end: float) -> LiveStates | None:
    """Give what tells of a drive that ends at `end` [s]; None where nobody asked for it."""
    file = os.environ.get(LIVE_VARIABLE, "")
    return LiveStates(case, file, end) if file else None
