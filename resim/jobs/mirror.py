"""Mirror results to MLflow: what `resim lake mirror` does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime

from resim.exports.mlflow_runs import MirroredRun, MlflowStore
from resim.jobs.lake import the_catalog
from resim.results.catalog import Catalog
from resim.results.entry import KINDS, CatalogEntry
from resim.results.kpis import kpi_values
from resim.results.lake import LakeQuery, find_page
from resim.results.origin import read_origin

EACH = 200
"""Results that are read at once."""


@dataclass(frozen=True)
class MirrorCounts:
    """What was mirrored.

    Attributes:
        new: Results that were written.
        known: That were there already.
    """

    new: int
    known: int


def mirror(
    address: str, *, experiment: str = "resim", catalog: str | None = None,
    noted: Callable[[str], None] = lambda name: None,
) -> MirrorCounts:  # fmt: skip
    """Write all results of the lake that are not there yet into a tracking store of MLflow.

    Args:
        address: Of the store, as MLflow takes it, such as sqlite:///mlflow.db.
        experiment: Its experiment; made where there is none.
        catalog: Path or URL of the lake's database, None for the user's.
        noted: Is told the name of each result that was written.

    Returns:
        How many were written, and how many were there.

    Raises:
        InputError: The store or the lake cannot be used, or MLflow is not installed.
    """
    lake = the_catalog(catalog)
    store = MlflowStore(address, experiment)
    known, new, old = store.known(), 0, 0
    for entry in _results(lake):
        if entry.id in known:
            old += 1
            continue
        store.add(mirrored(entry))
        new += 1
        noted(entry.name)
    return MirrorCounts(new, old)


def mirrored(entry: CatalogEntry) -> MirroredRun:
    """Give a result as MLflow shows it.

    Args:
        entry: The result.

    Returns:
        Parameters, metrics and tags; KPIs and settings where its folder is at hand.
    """
    there = entry.state() == "there"
    params = {"kind": entry.kind, "resim": entry.resim}
    for role in dict.fromkeys(i.role for i in entry.inputs):
        names = [name for name in dict.fromkeys(entry.names(role)) if name]
        params[role] = ", ".join(names)
    if there:
        params |= read_origin(entry.folder, entry.kind).settings
    hashes = {f"hash.{i.role}.{i.name}": i.hash for i in entry.inputs if i.hash}
    tags = {
        "resim.kind": entry.kind, "resim.verdict": entry.verdict, "resim.digest": entry.digest,
        "resim.folder": str(entry.folder), "resim.host": entry.host, **hashes,
        **{f"verdict.{_outcome(o.recording, o.build, o.source)}": o.verdict for o in entry.outcomes if o.verdict},
    }  # fmt: skip
    metrics = dict(_metrics(entry))
    if there and entry.kind in ("run", "assessment"):
        metrics |= kpi_values(entry.folder)
    at = datetime.fromisoformat(entry.written).timestamp()
    return MirroredRun(entry.id, entry.name, at, params, metrics, tags)


def _results(lake: Catalog) -> Iterator[CatalogEntry]:
    """All results, by name, some at once."""
    first = 0
    while True:
        page = find_page(lake, LakeQuery(kinds=tuple(KINDS)), sort="name", first=first, most=EACH)
        yield from lake.entries([item.id for item in page.items])
        first += EACH
        if len(page.items) < EACH:
            return


def _metrics(entry: CatalogEntry) -> Iterator[tuple[str, float]]:
    for verdict, count in entry.counts.items():
        yield f"count/{verdict}", float(count)
    for fact in entry.facts:
        if fact.value is not None:
            yield f"{fact.facet}/{fact.name}", fact.value
    for o in entry.outcomes:
        of = _outcome(o.recording, o.build, o.source)
        for name in ("runs", "passes", "fails", "invalids", "failures", "collisions", "same_decision"):
            if (value := getattr(o, name)) is not None:
                yield f"{name}/{of}", float(value)


def _outcome(recording: str, build: str, source: str) -> str:
    return "/".join(part for part in (recording, build, source) if part)
