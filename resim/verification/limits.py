"""What a new build may cost against an older one."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class RegressionLimits(BaseModel):
    """What a new build may cost: KPIs lost, decisions changed, and the rise of the largest risk in any scenario.

    None: as many as there are. seeds: of how many runs of each build, with a perception model.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)

    lost: int | None = Field(strict=True, default=0, ge=0)
    changed: int | None = Field(strict=True, default=None, ge=0)
    risk: float | None = Field(strict=True, default=0.05, ge=0.0)
    seeds: int = Field(strict=True, default=20, ge=1, le=5000)
