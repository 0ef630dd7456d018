"""What a release asks for: release.toml."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from resim.core.files import file_hash
from resim.core.spec import Strict, read_strict

EXAMPLE = "See scenarios/criteria/release.toml."
Per = Literal["hour", "kilometre"]


class AccidentLimit(Strict):
    """Most accidents by hour or kilometre.

    Attributes:
        per: Hour or kilometre of driving.
        accidents: Most of them.
        source: Where the number is from.
    """

    per: Per
    accidents: Annotated[float, Field(strict=True, gt=0.0)]
    source: Annotated[str, Field(min_length=1)]


class ReleaseLimits(Strict):
    """What a release asks for.

    Attributes:
        name: Of the limits.
        confidence: Of the whole statement, one-sided.
        least_seen: Probability, at least, that the next scenario is of a kind that was seen.
        least_seen_source: Where that is from.
        least_scenarios: Measured scenarios in a cluster, at least, of which a member counts: variations and seeds of
            one, and windows that overlap, are one. Scenarios of other clusters count as accidents.
        least_scenarios_source: Where that is from.
        limit: Most accidents, by hour, by kilometre, or both.
    """

    name: Annotated[str, Field(min_length=1)]
    confidence: Annotated[float, Field(strict=True, ge=0.5, lt=1.0)] = 0.95
    least_seen: Annotated[float, Field(strict=True, gt=0.0, lt=1.0)]
    least_seen_source: Annotated[str, Field(min_length=1)]
    least_scenarios: Annotated[int, Field(strict=True, ge=1)] = 30
    least_scenarios_source: str = ""
    limit: Annotated[tuple[AccidentLimit, ...], Field(min_length=1)]


def read_limits(path: Path) -> tuple[ReleaseLimits, str]:
    """Read release.toml, and give its hash. Raises InputError."""
    return read_strict(path, ReleaseLimits, EXAMPLE), file_hash(path)
