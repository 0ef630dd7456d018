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

import numpy as np

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
        self._file, self._new = Path(file), Path(f"{file}.{os.getpid()}.new")
        age = EVERY  # of the last state of the drive before
        with suppress(OSError):
            age = time.time() - self._file.stat().st_mtime
        self._next = time.monotonic() + EVERY - min(max(age, 0.0), EVERY)
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
        motion = worlds.ego[0, :4]
        away = abs(worlds.position - complex(*motion[:2]))
        near = away.argsort(kind="stable")[: min(MOST, np.count_nonzero(np.isfinite(away)))]
        place = worlds.position[near]
        columns = [place.real, place.imag, wrap_angle(worlds.heading[near]), worlds.v[near],
                   worlds.length[near], worlds.width[near]]  # fmt: skip
        numbers = np.round(columns, 3).T.tolist()
        names, kinds = worlds.ids[near].tolist(), worlds.kind[near].tolist()
        name, kind, length, width = self._ego
        state = {
            **self._head, "t": round(worlds.t, 3),
            "boxes": [[name, kind, *np.round(motion, 3).tolist(), length, width],
                      *([n, k, *own] for n, k, own in zip(names, kinds, numbers, strict=True))],
        }  # fmt: skip
        with suppress(OSError, ValueError):  # of values that are no numbers
            self._new.write_text(json.dumps(state, separators=(",", ":"), allow_nan=False), encoding="utf-8")
            self._new.replace(self._file)


def live_states(case: Case, end: float) -> LiveStates | None:
    """Give what tells of a drive that ends at `end` [s]; None where nobody asked for it."""
    file = os.environ.get(LIVE_VARIABLE, "")
    return LiveStates(case, file, end) if file else None
