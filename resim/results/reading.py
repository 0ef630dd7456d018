"""Folders of results, read for the catalog."""

from __future__ import annotations

import hashlib
import os
import platform
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import duckdb

from resim.core.errors import InputError
from resim.core.files import check_hashes, joined, parse_json, plain_names, read_file
from resim.core.sealed import read_sealed
from resim.core.spelling import counted
from resim.results.circumstances import of_run, of_sweep, of_verification
from resim.results.entry import (
    KINDS,
    REPORT,
    CatalogEntry,
    CatalogFact,
    CatalogInput,
    CatalogOutcome,
    ItemKind,
    digest,
    kind_of,
    stamps,
)
from resim.results.rows import check_table

JUDGED = ("PASS", "FAIL", "INVALID")
"""Verdicts by criteria."""
FAILED = "failed"
"""Verdict where a function failed or there is no result."""
VERIFIED = ("verified", "not verified", "undecided", "invalid", "error")
COMPARED = ("same", "better", "changed", "worse", "error")
VERDICTS = (*JUDGED, FAILED, *VERIFIED, *COMPARED[:-1], "within limits", "regresses")
"""All that a result, or an outcome of it, may have as its verdict."""
LARGEST = 2_000_000_000
"""Bytes of the largest file of results that is read."""
REMEDY = "Make it again; it may be of an older version."
_COUNTS = """
SELECT recording, build, count(*), count(*) FILTER (verdict = 'PASS'), count(*) FILTER (verdict = 'FAIL'),
  count(*) FILTER (verdict = 'INVALID'), count(*) FILTER (failure IS NOT NULL), count(*) FILTER (collision),
  CASE WHEN count(same_decision) > 0 THEN count(*) FILTER (same_decision) / count(*) END, [{bad}]::BIGINT[]
FROM (SELECT run, recording, build, {columns} FROM read_parquet(?, union_by_name = true, hive_partitioning = false))
GROUP BY recording, build ORDER BY min(run)
"""
_TYPES = {"verdict": "VARCHAR", "failure": "VARCHAR", "collision": "BOOLEAN", "same_decision": "BOOLEAN"}
MARKS: Mapping[ItemKind, tuple[str, ...]] = {
    **{kind: (file,) for kind, (file, _) in KINDS.items()}, "run": ("run.json", "assessment.json", "report.json")
}  # fmt: skip
"""Files by which a change of a folder of results is noticed."""
_MEMBERS = """
SELECT cluster, recording, count(*) FROM read_parquet(?, hive_partitioning = false) GROUP BY ALL ORDER BY ALL
"""
_KPI = "kpi "
"""What the columns with the verdicts by a criterion begin with."""

Json = Mapping[str, Any]


@dataclass(frozen=True)
class _FolderContents:
    """What a kind of results says about itself."""

    name: str
    versions: Json
    verdict: str
    counts: Mapping[str, int]
    inputs: tuple[CatalogInput, ...]
    outcomes: tuple[CatalogOutcome, ...]
    facts: tuple[CatalogFact, ...] = ()


def read_entry(folder: Path) -> CatalogEntry:
    """Read a folder of results for the catalog. Raises InputError where it is none, or not what resim writes."""
    folder = Path(os.path.normpath(folder.absolute()))
    kind = kind_of(folder)
    file = folder / KINDS[kind][0]
    try:
        found = _READERS[kind](folder)
        return CatalogEntry(
            kind=kind, name=found.name, folder=folder, host=platform.node(), written=written(file),
            digest=digest(folder, kind), resim=str(found.versions["resim"]), verdict=found.verdict,
            counts=found.counts, inputs=found.inputs, outcomes=found.outcomes, facts=found.facts,
            files=stamps(folder, MARKS[kind]),
        )  # fmt: skip
    except (KeyError, TypeError, ValueError, AttributeError, OSError, RecursionError) as e:
        raise InputError(file, "is not what resim writes, or what belongs to it is missing", REMEDY) from e


def written(file: Path) -> str:
    """Give when a file was written, as the catalog has it. Raises OSError."""
    return datetime.fromtimestamp(file.stat().st_mtime, UTC).isoformat(timespec="milliseconds")


def _run(folder: Path) -> _FolderContents:
    from resim.recordings.content import hash_of_hashes

    run, assessed = _sealed(folder / "run.json"), _sealed(folder / "assessment.json")
    check_hashes(folder, {"report.json": run["files"]["report.json"]}, REMEDY)
    if assessed["inputs"]["run"] != run["files"]["report.json"]:
        problem = "is of another run than run.json and report.json beside it"
        raise InputError(folder / "assessment.json", problem, "Run it again.")
    report = parse_json(read_file(folder / "report.json", REMEDY, largest=LARGEST), folder / "report.json")
    hashes, build = run["hashes"], report["build"]
    label = f"{build['name']}-{build['version']}"
    told = [
        CatalogInput("recording", report["recording"], hash=hash_of_hashes(hashes, hashes["map"])),
        CatalogInput("build", label, hash=hashes["build"]),
    ]
    if (seen := report["perception"]) is not None:
        told.append(CatalogInput("perception", seen["model"]["name"], hash=seen["model"]["hash"]))
    builds = dict.fromkeys(("rGT", "rSD", "rGT+M"), label)
    if build["drove"]:
        builds |= {"GT": label, "SD": label}
    found = list(_judged(_blocks(assessed), report["recording"], builds, report))
    road = next(name for name in run["files"] if name.endswith(".xodr"))
    told.append(CatalogInput("map", road.removesuffix(".xodr"), hash=hashes["map"]))
    seeds = (report.get("perception") or {}).get("seeds", ())
    failed = any(report["failure"].values()) or any(seed["failure"] for seed in seeds)
    verdict = FAILED if failed else _overall(o.verdict for o in found)
    inputs = (*told, *_criteria(assessed))
    named = CatalogFact(REPORT, "report.json", hash=run["files"]["report.json"])
    return _FolderContents(
        report["recording"], run["versions"], verdict, _counts(found, JUDGED), inputs, tuple(found),
        (*_risks(_blocks(assessed), told[0].hash), named, of_run(run, report, assessed)),
    )  # fmt: skip


def _assessment(folder: Path) -> _FolderContents:
    assessed = _sealed(folder / "assessment.json")
    of = assessed["inputs"]
    told = [CatalogInput("recording", of["recording"]["name"], hash=of["recording"]["hash"] or "")]
    builds: dict[str, str] = {}
    if (build := of["build"]) is not None:
        told.append(CatalogInput("build", build["label"], hash=build["hash"] or ""))
        simulated = "measures" not in assessed  # what drove the measured ones is not told
        sources = ("rGT", "rSD", "rGT+M", *assessed["failures"]) if simulated else ("GT", "SD")
        builds = dict.fromkeys(sources, build["label"])
    name = of["recording"]["name"]
    if of.get("run"):
        told.append(CatalogInput("run", name, hash=of["run"]))
    found = list(_judged(_blocks(assessed), name, builds, {"failure": assessed.get("failures", {})}))
    inputs = (*told, *_criteria(assessed))
    verdict = FAILED if assessed.get("failures") else _overall(o.verdict for o in found)
    facts = tuple(_risks(_blocks(assessed), told[0].hash))
    return _FolderContents(
        name, assessed["versions"], verdict, _counts(found, JUDGED), inputs, tuple(found), facts
    )


def _verification(folder: Path) -> _FolderContents:
    found = _sealed(folder / "verification.json")
    asked, told = found["inputs"], found["summary"]
    inputs = tuple(_verification_inputs(folder, asked))
    label, made = asked["build"]["label"], (of_verification(found),)
    outcomes = tuple(
        CatalogOutcome(r["name"], label, verdict=r["verdict"], cause=_cause(r)) for r in found["recordings"]
    )
    if asked["against"] is None:
        verdict = next(v for v in ("error", "not verified", "undecided", "invalid", "verified") if told[v])
        return _FolderContents(
            asked["name"], found["versions"], verdict, _counts(outcomes, VERIFIED), inputs, outcomes, made
        )
    verdict = "error" if told["error"] else "within limits" if told["good"] else "regresses"
    return _FolderContents(
        asked["name"], found["versions"], verdict, _counts(outcomes, COMPARED), inputs, outcomes, made
    )


def _sweep(folder: Path) -> _FolderContents:
    manifest = _sealed(folder / "manifest.json")
    told = manifest["inputs"]
    labels = {name: build["label"] for name, build in told["builds"].items()}
    inputs = [_input(folder, "recording", name, file) for name, file in told["recordings"].items()]
    inputs += [_input(folder, "build", file["label"], file) for file in told["builds"].values()]
    for role in ("criteria", "perception"):
        if (file := told[role]) is not None:
            inputs.append(_input(folder, role, Path(file["path"]).stem, file))
    outcomes = tuple(_swept(folder, manifest, labels))
    counts = {
        name: sum(getattr(o, of) or 0 for o in outcomes)
        for name, of in zip((*JUDGED, FAILED), ("passes", "fails", "invalids", "failures"), strict=True)
    }
    verdict = _overall(o.verdict for o in outcomes)
    return _FolderContents(
        told["sweep"]["name"], manifest["versions"], verdict, counts, tuple(inputs), outcomes,
        (of_sweep(manifest),),
    )  # fmt: skip


def _mining(folder: Path) -> _FolderContents:
    mined = _sealed(folder / "mined.json")
    check_hashes(folder, mined["files"], REMEDY)
    parts, failures = mined["parts"], mined["failures"]
    inputs = [
        CatalogInput(
            "recording", p["recording"], str(joined(folder / "mined.json", p["folder"])), p["content"]
        )
        for p in parts
    ]
    inputs += [
        CatalogInput("recording", f["recording"], str(joined(folder / "mined.json", f["folder"])))
        for f in failures
    ]
    outcomes = [CatalogOutcome(p["recording"], "", cause=_found(p)) for p in parts]
    outcomes += [CatalogOutcome(f["recording"], "", verdict="error", cause=f["why"]) for f in failures]
    verdict = "error" if failures else ""
    counts = {"mined": len(parts), "error": len(failures)} if failures else {}
    facts = [
        CatalogFact("maneuver", label, float(count), p["content"])
        for p in parts for label, count in p["labels"].items()
    ]  # fmt: skip
    facts += [CatalogFact("scenarios", "", float(p["scenarios"]), p["content"]) for p in parts]
    return _FolderContents(
        folder.name, mined["versions"], verdict, counts, tuple(inputs), tuple(outcomes), tuple(facts)
    )


def _space(folder: Path) -> _FolderContents:
    told = _sealed(folder / "space.json")
    inputs = [
        CatalogInput("mining", source["name"], os.path.normpath(folder / source["folder"]), source["mined"])
        for source in told["sources"]
    ]
    for source in told["sources"]:
        inputs += [
            CatalogInput("recording", name, hash=content) for name, content in source["contents"].items()
        ]
    counts = {"clusters": sum(len(bucket["clusters"]) for bucket in told["buckets"])}
    return _FolderContents(folder.name, told["versions"], "", counts, tuple(inputs), ())


def clusters_of(space: CatalogEntry) -> list[CatalogEntry]:
    """Give the clusters of a space. Raises InputError where its tables are not those of the space."""
    told = _sealed(space.folder / "space.json")
    check_hashes(space.folder, {"scenarios.parquet": told["files"]["scenarios.parquet"]}, REMEDY)
    with duckdb.connect() as db, plain_names([space.folder / "scenarios.parquet"]) as names:
        rows = db.execute(_MEMBERS, [names]).fetchall()
    members: dict[str, list[tuple[str, int]]] = {}
    for cluster, recording, count in rows:
        members.setdefault(cluster, []).append((recording, count))
    return [
        replace(
            space, kind="cluster", name=f"{bucket['bucket']} {cluster['cluster']}",
            digest=hashlib.sha256(f"{space.digest}\n{cluster['cluster']}".encode()).hexdigest(),
            counts={"scenarios": cluster["members"]},
            inputs=(CatalogInput("space", space.name, str(space.folder), space.digest),),
            facts=tuple(
                CatalogFact("member", name, float(count)) for name, count in members.get(cluster["cluster"], ())
            ),
        )
        for bucket in told["buckets"] for cluster in bucket["clusters"]
    ]  # fmt: skip


def _risks(blocks: Json, recording: str) -> Iterator[CatalogFact]:
    """The highest accident risk of each source: what was measured is true of the recording, the rest of the result."""
    for source, block in blocks.items():
        risks = [r for r in block.get("measures", {}).get("risk", {}).get("ego", ()) if r is not None]
        if risks:
            yield CatalogFact("risk", source, max(risks), recording if source in ("GT", "SD") else "")


def _found(part: Json) -> str:
    """What was found in a recording, in a few words."""
    return f"{counted(sum(part['labels'].values()), 'maneuver')}, {counted(part['scenarios'], 'scenario')}"


_READERS: dict[ItemKind, Callable[[Path], _FolderContents]] = {
    "run": _run,
    "assessment": _assessment,
    "verification": _verification,
    "sweep": _sweep,
    "mining": _mining,
    "space": _space,
}


def _swept(folder: Path, manifest: Json, labels: Mapping[str, str]) -> Iterator[CatalogOutcome]:
    """Outcomes of a sweep by recording and build, in its order; a table in which all runs failed has few columns."""
    columns: Sequence[str] = manifest["columns"]
    kpis = [c for c in columns if c.startswith(_KPI)]
    held = [f"{_quoted(c) if c in columns else 'NULL'}::{kind} AS {_quoted(c)}" for c, kind in _TYPES.items()]
    held += [f"{_quoted(c)}::VARCHAR AS {_quoted(c)}" for c in kpis]
    bad = ", ".join(f"count(*) FILTER ({_quoted(c)} <> 'PASS')" for c in kpis)
    parts = check_table(folder, manifest["files"])
    try:
        with duckdb.connect() as db, plain_names(parts) as names:
            rows = db.execute(_COUNTS.format(columns=", ".join(held), bad=bad), [names]).fetchall()
    except Exception as e:  # what DuckDB raises for damaged bytes is not always its own
        reason = " ".join(str(e).splitlines()[:1])
        raise InputError(folder / "runs", f"is not the table of a sweep ({reason})", REMEDY) from e
    for recording, build, runs, passes, fails, invalids, failures, collisions, same, lost in rows:
        several = {"PASS": passes, "FAIL": fails, "INVALID": invalids, FAILED: failures}
        worst = sorted(((count, c.removeprefix(_KPI)) for c, count in zip(kpis, lost, strict=True) if count),
                       key=lambda told: -told[0])  # fmt: skip
        yield CatalogOutcome(
            recording, labels[build], "", _overall(v for v, count in several.items() if count),
            ", ".join(f"{name} ({count})" for count, name in worst),
            runs, passes, fails, invalids, failures, collisions, same,
        )  # fmt: skip


def _quoted(column: str) -> str:
    return '"' + column.replace('"', '""') + '"'


def _judged(
    blocks: Json, recording: str, builds: Mapping[str, str], report: Json
) -> Iterator[CatalogOutcome]:
    """Outcomes by source; of one whose run failed there may be no block. report: of a run, else empty."""
    failures = {name: why for name, why in report.get("failure", {}).items() if why}
    decided, hit = report.get("decision", {}), report.get("collision", {})
    for source in (*blocks, *(name for name in failures if name not in blocks)):
        block = blocks.get(source, {})
        bad = [name for name, k in block.get("criteria", {}).items() if k["verdict"] != "PASS"]
        whole = report.get("end", {}).get(source, "duration") == "duration"
        told = source.startswith("r") and whole and decided.get(source) is not None
        yield CatalogOutcome(
            recording, builds.get(source, ""), source,
            verdict=FAILED if source in failures else block["verdict"] or "",
            cause=failures.get(source) or ", ".join(bad),
            collisions=int(hit[source]) if source in hit else None,
            same_decision=float(decided[source] == decided["GT"]) if told else None,
        )  # fmt: skip


def _blocks(assessed: Json) -> Json:
    """Assessments by source: a recording's GT is the file itself."""
    blocks = {name: assessed[name] for name in ("SD", "rGT", "rSD", "rGT+M") if name in assessed}
    return {"GT": assessed if "measures" in assessed else assessed["GT"], **blocks}


def _criteria(assessed: Json) -> Iterator[CatalogInput]:
    if (criteria := assessed.get("inputs", {}).get("criteria")) is not None:
        yield CatalogInput("criteria", criteria["name"], hash=criteria["hash"])


def _verification_inputs(folder: Path, asked: Json) -> Iterator[CatalogInput]:
    for name, file in asked["recordings"].items():
        yield _input(folder, "recording", name, file)
    for role in ("build", "against", "criteria", "perception", "suite"):
        if (file := asked[role]) is not None:
            yield _input(folder, role, file.get("label") or Path(file["path"]).stem, file)


def _input(folder: Path, role: str, name: str, file: Json) -> CatalogInput:
    return CatalogInput(role, name, os.path.normpath(folder / file["path"]), file["hash"] or "")


def _cause(recording: Json) -> str:
    """Why a recording's verdict is not good."""
    if recording["error"] is not None:
        return str(recording["error"])
    if (cause := recording.get("cause")) is not None:
        return f"{cause['step']}: {cause['text']}"
    return "; ".join(recording.get("differences", ()))


def _overall(verdicts: Iterable[str]) -> str:
    """The worst verdict by criteria, "" where there is none."""
    found = {*verdicts}
    return next((v for v in ("FAIL", FAILED, "INVALID", "PASS") if v in found), "")


def _counts(outcomes: Iterable[CatalogOutcome], order: tuple[str, ...]) -> dict[str, int]:
    """How many outcomes have which verdict, in this order; {} where nothing was judged."""
    counts = Counter(o.verdict for o in outcomes if o.verdict)
    return {v: counts[v] for v in (*order, *(c for c in counts if c not in order))} if counts else {}


def _sealed(path: Path) -> Any:
    return read_sealed(path, REMEDY, largest=LARGEST)
