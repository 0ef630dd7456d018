"""The fields of perception models: groups of parameters, and the numbers that they take."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(strict=True, ge=-1e4, le=1e4)]
NotNegative = Annotated[float, Field(strict=True, ge=0.0, le=1e4)]
Positive = Annotated[float, Field(strict=True, gt=0.0, le=1e4)]
Late = Annotated[float, Field(strict=True, ge=0.0, le=10.0)]
"""Time [s] that a perception remembers."""
Rate = Annotated[float, Field(strict=True, ge=0.0, le=1e3)]
Share = Annotated[float, Field(strict=True, ge=0.0, le=1.0)]


class ParameterGroup(BaseModel):
    """A group of parameters: fields that it does not know are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


Lasting = Annotated[float, Field(strict=True, gt=0.0, le=1e7)]
"""A time [s] that may be longer than any drive: what lasts so long never changes."""
