"""How large the errors of each step may be for a re-simulation to be trusted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict, Field

if TYPE_CHECKING:
    from resim.resimulation.drive_outcome import Rms


class _ToleranceModel(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


class ErrorLimits(_ToleranceModel):
    """Largest root mean square of distance [m], speed [m/s] and heading error [rad]; None for any."""

    d: float | None = Field(strict=True, default=None, ge=0.0)
    v: float | None = Field(strict=True, default=None, ge=0.0)
    heading: float | None = Field(strict=True, default=None, ge=0.0)


class StepLimits(_ToleranceModel):
    """Limits of one step, of the EGO and of the traffic objects."""

    ego: ErrorLimits = ErrorLimits()
    to: ErrorLimits = ErrorLimits()


class Tolerances(_ToleranceModel):
    """Limits by step, and of the difference of first braking [s].

    The EGO is free in the simulation: how far it is off there is judged at the end of the pipeline, once. vehicle: the
    largest error after one second in which the vehicle model moves the EGO from where it was measured, on what the
    function answers there (`resim.verification.blame`); it names a cause, and makes no verdict.
    """

    reaction: float | None = Field(strict=True, default=0.2, ge=0.0)
    sensor: StepLimits = StepLimits(
        ego=ErrorLimits(d=0.5, v=0.2, heading=0.01), to=ErrorLimits(d=1.0, v=0.5, heading=0.03)
    )
    fit: StepLimits = StepLimits(
        ego=ErrorLimits(d=0.2, v=0.2, heading=0.02), to=ErrorLimits(d=0.2, v=0.2, heading=0.02)
    )
    simulation: StepLimits = StepLimits(to=ErrorLimits(d=0.1, v=0.1, heading=0.01))
    vehicle: StepLimits = StepLimits(ego=ErrorLimits(d=0.5, v=0.5, heading=0.03))
    pipeline: StepLimits = StepLimits(ego=ErrorLimits(d=1.5, v=1.0, heading=0.03))

    def beyond(self, step: str, errors: Mapping[str, Mapping[str, float | None]]) -> Iterator[Excess]:
        """Give where the errors of a step, by "ego" or "to" and quantity, are larger than they may be."""
        limits: StepLimits = getattr(self, step)
        for who in ("ego", "to"):
            for quantity, limit in getattr(limits, who):
                value = errors.get(who, {}).get(quantity)
                if limit is not None and value is not None and value > limit:
                    yield Excess(step=step, who=who, quantity=quantity, value=value, limit=limit)


class Excess(_ToleranceModel):
    """An error beyond its tolerance, both in the unit of the quantity."""

    step: str
    who: str
    quantity: str
    value: float
    limit: float

    def __str__(self) -> str:
        """Tell it: `TO d 1.57 m (tolerance 1 m)`."""
        unit = {"d": "m", "v": "m/s", "heading": "rad"}[self.quantity]
        name = {"d": "position", "v": "speed", "heading": "heading"}[self.quantity]
        return f"{self.who.upper()} {name} {self.value:.3g} {unit} (tolerance {self.limit:g} {unit})"


CHAIN: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "rGT": {"fit": ("FIT_GT",), "simulation": ("SIM_GT",), "pipeline": ("PIPE_GT",)},
    "rSD": {"sensor": ("S",), "fit": ("FIT_SD",), "simulation": ("SIM_SD",), "pipeline": ("PIPE_SD",)},
    "rGT+M": {"fit": ("FIT_GT",), "simulation": ("SIM_GT",)},
}
"""The errors that stand behind each step of each way through the chain (Eq. 5.6)."""


def excesses(way: str, errors: Rms, tolerances: Tolerances) -> list[Excess]:
    """Give what is beyond tolerance on the way to rGT, rSD or rGT+M, in the order of the chain."""
    return [
        excess
        for step, names in CHAIN[way].items()
        for name in names
        for excess in tolerances.beyond(step, errors.get(name, {}))
    ]
