"""What pages ask of the catalog, over SQLite and PostgreSQL."""

from __future__ import annotations

from pathlib import Path

from resim.results.catalog import AT_ONCE, Catalog
from resim.results.entry import CatalogEntry, CatalogInput, CatalogOutcome
from resim.results.overview import CatalogOverview

DRIVE, PILOT = "ab" * 32, "cd" * 32


def entry(day: int, kind: str = "run", verdict: str = "PASS", build: str = "pilot-1.0") -> CatalogEntry:
    return CatalogEntry(
        kind=kind, name=f"cut_in {day}", folder=Path(f"/results/50%_{day}"), host="h", digest=f"{day:064x}",
        resim="0.1.0", written=f"2026-11-{day:02}T05:00:00.000+00:00", verdict=verdict, counts={verdict: 1},
        inputs=(CatalogInput("recording", "cut_in", f"/d/{day}", DRIVE), CatalogInput("build", build, "", PILOT)),
        outcomes=(CatalogOutcome("cut_in", build, "rGT", verdict), CatalogOutcome("other", build, "rGT", "FAIL")),
    )  # type: ignore[arg-type]  # fmt: skip


def test_inputs_and_outcomes_are_given_by_content(database: str) -> None:
    catalog = Catalog(database)
    overview = CatalogOverview(catalog)
    for one in (entry(1), entry(2, "verification", "FAIL", "idm-2.0"), entry(3)):
        catalog.add(one)
    (drive,) = overview.inputs("recording")
    assert (drive.name, drive.hash, drive.results) == ("cut_in", DRIVE, 3)
    assert [(b.name, b.results) for b in overview.inputs("build")] == [("idm-2.0", 1), ("pilot-1.0", 2)]
    hashes = [DRIVE, "", *(f"{k:064x}" for k in range(2 * AT_ONCE))]
    found = overview.newest_of(hashes)
    assert [(o.written[8:10], o.recording, o.verdict) for o in found] == [
        ("03", "cut_in", "PASS"), ("02", "cut_in", "FAIL"),
    ]  # fmt: skip
    assert overview.newest_of([]) == []
    catalog.add(entry(4, verdict=""))
    found = overview.newest_of([DRIVE])
    assert [(o.written[8:10], o.verdict) for o in found] == [("04", ""), ("03", "PASS"), ("02", "FAIL")]
    assert [o.result for o in overview.of_build("pilot-1.0", PILOT, ("run",))] == [
        entry(n).id for n in (4, 3, 1)
    ]
    assert overview.of_build("pilot-1.0", PILOT, ("sweep",)) == []
