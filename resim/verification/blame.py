"""Does the function answer as it did on the road, and does the vehicle model move as the vehicle did?

Both are asked along the measured drive, in open loop: the function is shown what was recorded as perceived where the
EGO really was, and the vehicle model moves from there on what it answers. So neither error grows into the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from resim.verification.tolerance import Excess

Function = Literal["plans as recorded", "plans otherwise", "is the build that drove", "unknown"]
"""What is known of the function beside the one that drove."""
Blamed = Literal["vehicle", "function", "function or vehicle"]


@dataclass(frozen=True)
class OpenLoopFinding:
    """What the function answers along the measured drive, and how far the vehicle model moves from it on the answers.

    error: of the EGO after one second of it, where it is largest: d [m], v [m/s], heading [rad]. beyond: where that is
    beyond tolerance, from t [s] on. function: what is known of it; planned [s]: for how long its plans are others, None
    where none can be compared. senses: whether it was shown sensor data; else the truth.
    """

    error: Mapping[str, float | None]
    beyond: tuple[Excess, ...]
    t: float | None
    function: Function
    planned: float | None
    senses: bool

    @property
    def blamed(self) -> Blamed | None:
        """Which of function and vehicle acts differently from the drive, as far as that can be told; None for neither.

        A vehicle that does not move as its model on the answers of a function is to blame only where these are known
        to be what moved it.
        """
        if self.function == "plans otherwise":
            return "function"
        if not self.beyond:
            return None
        return "function or vehicle" if self.function == "unknown" else "vehicle"

    def __str__(self) -> str:
        """Tell it in a sentence."""
        shown = "shown what was recorded as perceived" if self.senses else "shown the truth"
        if self.function == "plans otherwise":
            since = f"for {self.planned:.1f} s"
            return f"along the measured drive, {shown}, the function plans differently from the recording, {since}"
        if not self.beyond:
            return f"along the measured drive, {shown}, its answers move the vehicle model as the real vehicle moved"
        moved = (
            f"along the measured drive the function, {shown}, {_ANSWERS[self.function]}; within one second of its "
            f"answers the vehicle moved differently from its model: {', '.join(map(str, self.beyond))}"
        )
        return f"{moved}; {self._untold()}" if self.function == "unknown" else moved

    def _untold(self) -> str:
        if not self.senses:
            return "what it perceived was not recorded: function, vehicle, or perception"
        return "no recorded plans cover the drive, and whether this build drove is unknown; cause: function or vehicle"


_ANSWERS: Mapping[Function, str] = {
    "plans as recorded": "plans as it did",
    "is the build that drove": "which is the build that drove",
    "unknown": "which may answer differently from the one that drove",
}
