"""Builds in the lake, and what came out for two of them side by side; what `resim lake builds` and `compare` do."""

from __future__ import annotations

from resim.core.errors import InputError
from resim.results.builds import BuildPair, KnownBuild, known_builds, pairs
from resim.results.catalog import Catalog
from resim.results.overview import CatalogOverview


def list_builds(catalog: Catalog) -> list[KnownBuild]:
    """Give the builds that results know, by label.

    Args:
        catalog: The catalog.

    Returns:
        The builds.

    Raises:
        InputError: The database cannot be used.
    """
    return known_builds(CatalogOverview(catalog))


def compare_builds(catalog: Catalog, one: str, other: str) -> list[BuildPair]:
    """Give what came out for each recording with two builds, what got worse first.

    Args:
        catalog: The catalog.
        one: Label of the older build, or the first digits of its id or hash.
        other: The same of the newer one.

    Returns:
        The pairs: outcomes of equal circumstances alone are compared.

    Raises:
        InputError: There is no such build, or several, or the database cannot be used.
    """
    every = list_builds(catalog)
    return pairs(catalog, _build(every, one), _build(every, other))


def _build(every: list[KnownBuild], wanted: str) -> KnownBuild:
    named = [b for b in every if b.label == wanted]
    found = named or [
        b for b in every if len(wanted) >= 4 and (b.id.startswith(wanted) or b.hash.startswith(wanted))
    ]
    if len(found) == 1:
        return found[0]
    problem = f"names {len(found)} builds" if found else "is no build that a result names"
    remedy = "Give the first digits of an id that `resim lake builds` shows."
    raise InputError(wanted, problem, remedy)
