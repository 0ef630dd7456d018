"""What pages ask of the catalog, over SQLite and PostgreSQL."""

from __future__ import annotations

from pathlib import Path

from resim.results.catalog import Catalog
from resim.results.entry import CatalogEntry, CatalogInput, CatalogOutcome
from resim.results.overview import MOST_HASHES, CatalogOverview, ResultQuery

DRIVE, PILOT = "ab" * 32, "cd" * 32


def entry(day: int, kind: str = "run", verdict: str = "PASS", build: str = "pilot-1.0") -> CatalogEntry:
    return CatalogEntry(
        kind=kind, name=f"cut_in {day}", folder=Path(f"/results/50%_{day}"), host="h", digest=f"{day:064x}",
        resim="0.1.0", written=f"2026-11-{day:02}T05:00:00.000+00:00", verdict=verdict, counts={verdict: 1},
        inputs=(CatalogInput("recording", "cut_in", f"/d/{day}", DRIVE), CatalogInput("build", build, "", PILOT)),
        outcomes=(CatalogOutcome("cut_in", build, "rGT", verdict), CatalogOutcome("other", build, "rGT", "FAIL")),
    )  # type: ignore[arg-type]  # fmt: skip


def test_results_are_given_by_the_page(database: str) -> None:
    catalog = Catalog(database)
    overview = CatalogOverview(catalog)
    assert (overview.version(), overview.page(ResultQuery(), 0, 9)) == ((0, ""), ([], 0))
    entries = [entry(1), entry(2, "sweep", "FAIL", "idm-2.0"), entry(3)]
    for one in entries:
        catalog.add(one)
    assert overview.version()[0] == 3
    found, count = overview.page(ResultQuery(), 1, 1)
    assert (count, [(r.id, r.name, r.builds, r.against) for r in found]) == (
        3, [(entries[1].id, "cut_in 2", ("idm-2.0",), ())],
    )  # fmt: skip
    assert found[0].counts == {"FAIL": 1}
    for query, days in (
        (ResultQuery("pilot"), [3, 1]), (ResultQuery("IDM cut"), [2]), (ResultQuery(PILOT[:9]), [3, 2, 1]),
        (ResultQuery("50%_"), [3, 2, 1]), (ResultQuery("0%5"), []), (ResultQuery("", "sweep"), [2]),
        (ResultQuery("", None, "PASS"), [3, 1]), (ResultQuery(entries[0].id[:10]), [1]), (ResultQuery("' OR 1=1"), []),
    ):  # fmt: skip
        found, count = overview.page(query, 0, 9)
        assert [int(r.written[8:10]) for r in found] == days, query
        assert count == len(days)
    assert overview.verdicts() == ["FAIL", "PASS"]


def test_inputs_and_outcomes_are_given_by_content(database: str) -> None:
    catalog = Catalog(database)
    overview = CatalogOverview(catalog)
    for one in (entry(1), entry(2, "verification", "FAIL", "idm-2.0"), entry(3)):
        catalog.add(one)
    (drive,) = overview.inputs("recording")
    assert (drive.name, drive.path, drive.hash, drive.results) == ("cut_in", "/d/3", DRIVE, 3)
    assert [(b.name, b.results) for b in overview.inputs("build")] == [("idm-2.0", 1), ("pilot-1.0", 2)]
    hashes = [DRIVE, "", *(f"{k:064x}" for k in range(2 * MOST_HASHES))]
    found = overview.of_recordings(hashes)
    assert [(o.written[8:10], o.recording, o.verdict) for o in found] == [
        ("03", "cut_in", "PASS"), ("02", "cut_in", "FAIL"), ("01", "cut_in", "PASS"),
    ]  # fmt: skip
    assert overview.of_recordings([]) == []
    assert [o.result for o in overview.of_build("pilot-1.0", PILOT, ("run",))] == [entry(3).id, entry(1).id]
    assert overview.of_build("pilot-1.0", PILOT, ("sweep",)) == []
    assert [r.id for r in overview.results_of_build("pilot-1.0", PILOT, 1)] == [entry(3).id]
