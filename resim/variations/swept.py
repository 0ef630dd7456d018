"""What a sweep's file says of variations; it imports next to nothing, as files are looked at before anything else."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from resim.core.spec import Strict

BOX = 0.005
"""Δc of the source: 0.5 % of each component's range."""
WIDEST = 10.0
"""Δc at most."""


class SweepVariation(Strict):
    """How a sweep's recordings are varied, where it has parameters of variations.

    kernels: file of `resim vary train`. object: ids of the objects; none for the most critical one. maneuver: labels;
    none for all that there is a kernel of. box: share of each component's range, to either side, of
    `variation.number`. verified: verification.json of `resim verify --vary`, by which trust is judged.
    """

    kernels: Annotated[str, Field(min_length=1)]
    object: tuple[str, ...] = ()
    maneuver: tuple[str, ...] = ()
    box: Annotated[float, Field(strict=True, gt=0.0, le=WIDEST)] = BOX
    verified: str | None = None
