"""What a measure gives: numbers where there are numbers, and the reason where there is none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from resim.core.errors import ResimError
from resim.core.geometry import Bools, Floats
from resim.metrics.kinds import WorstEnd

StateArray = NDArray[np.uint8]


class State(IntEnum):
    """Why there is a number or none.

    NO_CONFLICT: looked for, and what the measure counts does not happen within the horizon. NOT_DEFINED: the
    measure has no meaning here (THW at standstill, a limit where there is none). NOT_COMPUTED: input is missing.
    """

    VALUE = 0
    NO_CONFLICT = 1
    NOT_DEFINED = 2
    NOT_COMPUTED = 3


@dataclass(frozen=True, eq=False)
class MeasureValues:
    """The values of one measure for many scenes or samples (`MeasureDefinition.values` makes them).

    value: any shape, in `unit`, NaN wherever `state` (same shape) is not VALUE. worst: which end is the worse one.
    beyond: how bad it can still be where there is NO_CONFLICT, as that is looked for so far ahead only; of a shape that
    fits to `value`, None where it is known to be none. note: what one has to know to believe them, "" for nothing.
    """

    name: str
    unit: str
    value: Floats
    state: StateArray
    worst: WorstEnd
    beyond: Floats | None = None
    note: str = ""

    def __post_init__(self) -> None:
        if self.value.shape != self.state.shape:
            raise ResimError(
                f"{self.name}: state has shape {self.state.shape}, expected {self.value.shape}, as value"
            )
        if not np.array_equal(np.isnan(self.value), self.state != State.VALUE):
            raise ResimError(f"{self.name}: expected NaN where there is no value, and nowhere else")

    def worst_value(self) -> tuple[float, tuple[int, ...]] | None:
        """Give the worst value and its index (the first of equal ones); None where there is no value at all."""
        if not (self.state == State.VALUE).any():
            return None
        flat = (
            np.nanargmin(self.value) if self.worst == "low"
            else np.nanargmax(self.value if self.worst == "high" else np.abs(self.value))
        )  # fmt: skip
        index = tuple(int(i) for i in np.unravel_index(int(flat), self.value.shape))
        return float(self.value[index]), index

    def track(self, row: int = 0) -> MeasureValues:
        """Give those of one track (T,), of many (N, T)."""
        return replace(self, value=self.value[row], state=self.state[row])

    def scenes(self, part: slice) -> MeasureValues:
        """Give those of some scenes, of many (S, ...)."""
        return replace(self, value=self.value[part], state=self.state[part])

    def count(self, state: State) -> int:
        """Give how many entries are in this state."""
        return int((self.state == state).sum())


def stated(value: Floats, *, conflict: Bools, defined: Bools | None = None) -> tuple[Floats, StateArray]:
    """Give value and state: NOT_DEFINED where not `defined`, else NO_CONFLICT where no `conflict`; all one shape."""
    state = np.where(conflict, State.VALUE, State.NO_CONFLICT).astype(np.uint8)
    if defined is not None:
        state[~defined] = State.NOT_DEFINED
    return np.where(state == State.VALUE, value, np.nan), state


def computed(value: Floats) -> tuple[Floats, StateArray]:
    """Give value and state: NOT_COMPUTED where there is no number."""
    known = np.isfinite(value)
    state = np.where(known, State.VALUE, State.NOT_COMPUTED).astype(np.uint8)
    return np.where(known, value, np.nan), state
