"""What the newest spaces of scenarios say of how much was seen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from resim.core.errors import ResimError
from resim.core.sealed import read_sealed
from resim.results.catalog import Catalog
from resim.results.entry import CatalogEntry
from resim.results.lake import LakeItem, LakeQuery, find_page

REMEDY = "Build the space again by `resim space build`."


@dataclass(frozen=True)
class SpaceCoverage:
    """How much of a space was seen.

    Attributes:
        id: Of the result.
        name: Of its folder.
        written: When, ISO 8601 in UTC.
        scenarios: That were seen.
        hours: Driven.
        kinds: That were seen, and that there are at least (Chao's lower bound).
        unseen: Probability that the next scenario is of a kind not seen: value and both limits of its interval.
        converged: Whether discovery and expansion have stopped.
        fault: Why none of this can be told, "" where it can.
    """

    id: str
    name: str
    written: str
    scenarios: int = 0
    hours: float = 0.0
    kinds: tuple[int, float] = (0, 0.0)
    unseen: tuple[float, float, float] = (1.0, 0.0, 1.0)
    converged: bool = False
    fault: str = ""


def newest_coverage(catalog: Catalog, most: int) -> list[SpaceCoverage]:
    """Give the coverage of the newest spaces. Raises InputError where the catalog cannot be read."""
    return [coverage_of(item) for item in find_page(catalog, LakeQuery(kinds=("space",)), most=most).items]


def coverage_of(item: LakeItem | CatalogEntry) -> SpaceCoverage:
    """Give the coverage of a space, as its folder tells now."""
    try:
        told = read_sealed(Path(item.folder) / "space.json", REMEDY)
        coverage, unseen = told["coverage"], told["coverage"]["convergence"]["unseen"]
        return SpaceCoverage(
            item.id, item.name, item.written, int(told["scenarios"]), float(told["hours"]),
            (int(coverage["kinds"]["seen"]), float(coverage["kinds"]["at_least"])),
            (float(unseen["value"]), float(unseen["low"]), float(unseen["high"])),
            bool(coverage["convergence"]["converged"]),
        )  # fmt: skip
    except (ResimError, LookupError, TypeError, ValueError, OverflowError):
        fault = "its folder is not here, or holds something else"
        return SpaceCoverage(item.id, item.name, item.written, fault=fault)
