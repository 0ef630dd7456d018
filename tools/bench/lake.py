"""How soon pages of a large lake come: made rows of recordings and runs, in a database of its own; queries are timed.

    python tools/bench/lake.py [--recordings 100000] [--runs 1000000] [--database PATH|URL]

The first line says how long it took to fill the database; then a line a query: the median and the largest time [s] of
some repetitions, each in a new connection, and the median time of a core. The last line is all of it as JSON.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Table
from sqlalchemy.schema import CreateIndex, DropIndex

from resim.results.catalog import Catalog
from resim.results.entry import KINDS
from resim.results.lake import LakeQuery, find_page, with_content
from resim.results.overview import CatalogOverview
from resim.results.tables import FACT, INDEX, INPUT, ITEM, OUTCOME, WORD
from resim.results.words import words_of

LABELS = (
    "follow_lane",
    "cut_in_left",
    "cut_in_right",
    "strong_braking",
    "tailgating_severe",
    "overtaking_right",
)
BUILDS, MAPS, REPEATED, EACH = 40, 30, 5, 20_000
Row = tuple[Any, ...]


def digest(*told: object) -> str:
    return hashlib.sha256(repr(told).encode()).hexdigest()


def moment(k: int, count: int) -> str:
    second = int(k / count * 28 * 86400)
    day, rest = divmod(second, 86400)
    return f"2026-10-{day + 1:02}T{rest // 3600:02}:{rest // 60 % 60:02}:{rest % 60:02}.{k % 1000:03}+00:00"


def item(
    kind: str, name: str, folder: str, written: str, content: str, risk: float | None, **told: Any
) -> Row:
    names = {
        "id": digest(kind, folder)[:16], "kind": kind, "name": name, "folder": folder, "host": "bench",
        "written": written, "digest": content, "resim": "0.1.0",
        "verdict": "", "counts": "{}", "files": "{}", "fault": "", "risk": risk,
    } | told  # fmt: skip
    return tuple(names[column.name] for column in ITEM.columns)


def details(
    name: str, of: str, inputs: list[tuple[str, str, str]], folder: str
) -> Iterator[tuple[Table, Row]]:
    for row, (role, called, content) in enumerate(inputs):
        yield INPUT, (of, row, role, called, "", content)
    for word in words_of(name, folder, *(called for _, called, _ in inputs)):
        yield WORD, (word, of)


def recording(k: int, count: int) -> Iterator[tuple[Table, Row]]:
    name, town = f"drive_{k:06}", k % MAPS
    folder, content, risk = f"/data/week_{k % 52}/{name}", digest("drive", k), (k * 7919 % count) / count
    row = item("recording", name, folder, moment(k, count), content, risk)
    yield ITEM, row
    yield from details(name, row[0], [("map", f"town_{town}", digest("map", town))], folder)
    weather, label = ("rain", "dry", "fog")[k // MAPS % 3], LABELS[k % len(LABELS)]
    facts: list[tuple[str, str, float | None]] = [
        ("table", "gt", None), ("weather", f"precipitationdensity={weather}", None), ("tag", f"car=car {k % 9}", None),
        ("maneuver", "follow_lane", 9.0), ("maneuver", label, 2.0 + k % 5), ("finding", "gap", 1.0),
    ]  # fmt: skip
    facts += [("maneuver", "u_turn", 1.0)] if k % 5000 == 0 else []
    for number, (facet, called, value) in enumerate(facts):
        yield FACT, (row[0], number, content, facet, called, value)


def run(k: int, count: int, recordings: int) -> Iterator[tuple[Table, Row]]:
    drive, build, verdict = k % recordings, k * 31 % BUILDS, "FAIL" if k % 7 == 0 else "PASS"
    name, label, content = f"drive_{drive:06}", f"pilot-1.{build}", digest("drive", drive)
    folder = f"/out/{label}/{name}-{k // recordings}"
    risk = (k * 104729 % count) / count
    row = item("run", name, folder, moment(k, count), digest("run", k), risk, verdict=verdict)
    yield ITEM, row
    inputs = [
        ("recording", name, content), ("build", label, digest("build", build)), ("criteria", "highway", digest("c")),
        ("map", f"town_{drive % MAPS}", digest("map", drive % MAPS)),
    ]  # fmt: skip
    yield from details(name, row[0], inputs, folder)
    for number, source in enumerate(("GT", "rGT")):
        told = (label, source, verdict if source == "rGT" else "PASS", "", *(None,) * 6, None)
        yield OUTCOME, (row[0], number, name, content, *told)
    yield FACT, (row[0], 0, content, "risk", "GT", (drive * 7919 % recordings) / recordings)


def fill(connection: Connection, recordings: int, runs: int) -> None:
    """Rows first, indexes after them."""
    indexes = [index for table in INDEX for index in table.indexes]
    for index in indexes:
        connection.execute(DropIndex(index))
    sign = "?" if connection.dialect.name == "sqlite" else "%s"
    waiting: dict[Table, list[Row]] = {table: [] for table in INDEX}

    def write() -> None:
        for table, rows in waiting.items():
            if rows:
                values = ", ".join([sign] * len(table.columns))
                connection.exec_driver_sql(
                    f"INSERT INTO {table.name} VALUES ({values})", sorted(rows, key=lambda r: r[:2])
                )
                rows.clear()

    made = (recording(k, recordings) for k in range(recordings))
    for number, rows in enumerate(itertools.chain(made, (run(k, runs, recordings) for k in range(runs)))):
        for table, row in rows:
            waiting[table].append(row)
        if number % EACH == EACH - 1:
            write()
    write()
    for index in indexes:
        connection.execute(CreateIndex(index))
    connection.commit()
    if connection.dialect.name == "postgresql":  # as its autovacuum does after a while
        connection.execution_options(isolation_level="AUTOCOMMIT").exec_driver_sql("VACUUM ANALYZE")


def queries(catalog: Catalog, recordings: int, runs: int) -> dict[str, Callable[[], object]]:
    """What pages ask, by what it is."""
    drives, results = ("recording",), tuple(KINDS)
    overview, contents = CatalogOverview(catalog), [digest("drive", k) for k in range(50)]

    def page(sort: Any = "written", first: int = 0, **told: Any) -> Callable[[], object]:
        return lambda: find_page(catalog, LakeQuery(**told), sort=sort, first=first)

    return {
        "all, newest": page(),
        "all, by name": page("name"),
        "recordings by name": page("name", kinds=drives),
        "recordings by name, last page": page("name", recordings - 50, kinds=drives),
        "recordings by risk": page("risk", kinds=drives),
        "recordings with a rare maneuver": page(kinds=drives, maneuver="u_turn"),
        "recordings with a frequent maneuver by risk": page("risk", kinds=drives, maneuver="cut_in"),
        "recordings in rain on a map": page("name", kinds=drives, weather="precipitationDensity=rain", place="town_7"),
        "recordings by two filters that never meet": page(kinds=drives, tag="car=car 0", place="town_7"),
        "all on a map, newest": page(place="town_7"),
        "recordings above a risk, by name": page("name", kinds=drives, risk_above=0.9),
        "runs, newest": page(kinds=("run",)),
        "results, newest": page(kinds=results),
        "runs, last page": page("written", runs - 50, kinds=("run",)),
        "runs by risk": page("risk", kinds=("run",)),
        "runs that FAIL": page(kinds=("run",), verdict="FAIL"),
        "runs of a build": page(kinds=("run",), build="pilot-1.7"),
        "runs of a build that FAIL, by risk": page("risk", kinds=("run",), build="pilot-1.7", verdict="FAIL"),
        "a drive by name": page(text=f"{recordings // 2:06}"),
        "a frequent word": page(text="drive"),
        "two words, one rare": page(text=f"pilot {recordings // 3:06}"),
        "two frequent words": page("name", text="drive pilot"),
        "digits of a hash": page(text=digest("drive", 5)[:10]),
        "nothing": page(text="nothing like this"),
        "what followed from a recording": page(hashes=(contents[7],)),
        "what followed from a build": page(hashes=(digest("build", 3),)),
        "what has these contents": lambda: with_content(catalog, contents),
        "steps of 50 recordings": lambda: overview.newest_of(contents),
        "builds": lambda: overview.inputs("build"),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--recordings", type=int, default=100_000)
    parser.add_argument("--runs", type=int, default=1_000_000)
    parser.add_argument(
        "--database", default="", help="path or URL, filled if it is empty; default: a temporary file"
    )
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        catalog = Catalog(given.database or str(Path(folder) / "lake.sqlite"))
        begin = time.perf_counter()
        if find_page(catalog, LakeQuery(), most=1).count == 0:
            with catalog.connected() as connection:
                fill(connection, given.recordings, given.runs)
        told: dict[str, Any] = {"recordings": given.recordings, "runs": given.runs}
        told["filled"] = round(time.perf_counter() - begin, 1)
        print(
            f"{given.recordings} recordings and {given.runs} runs written in {told['filled']} s", flush=True
        )
        told["pages"] = {}
        for name, ask in queries(catalog, given.recordings, given.runs).items():
            times, work = [], []
            for _ in range(REPEATED):
                begin, worked = time.perf_counter(), time.process_time()
                ask()
                times.append(time.perf_counter() - begin)
                work.append(time.process_time() - worked)
            page = {"median": statistics.median(times), "max": max(times), "core": statistics.median(work)}
            told["pages"][name] = {key: round(value, 4) for key, value in page.items()}
            print(" ".join(f"{value:8.3f}" for value in page.values()), "", name, flush=True)
        told["slowest"] = max(page["median"] for page in told["pages"].values())
        print(json.dumps(told))


if __name__ == "__main__":
    main()
