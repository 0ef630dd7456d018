"""A sweep: every run in a supervised child, each result committed as it comes, one table at the end."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from itertools import chain
from pathlib import Path
from typing import Any

import pandas as pd
from pydantic import MISSING

from resim.core.errors import FunctionError, InputError, ResimError
from resim.core.files import file_hash, relative
from resim.core.plugins.frozen import FrozenFile
from resim.core.plugins.unlisted_files import UNPINNED
from resim.core.provenance import versions
from resim.core.schema import DRAWN_COLUMNS, RUN, Row
from resim.core.sealed import read_sealed, sealed
from resim.core.spec import read_sealed_json, to_json
from resim.execution import journal
from resim.execution.child import Failure
from resim.execution.journal import JournalEntry
from resim.metrics.criteria import read_criteria
from resim.perception.model import fault_of
from resim.resimulation import ResimulationOptions
from resim.results import whole_file, write_json, write_parquet
from resim.simulation.function.driver import cycle_steps, try_to_make
from resim.simulation.function.interface import Build, load_build, misfit_of
from resim.sweeps.file import Sweep, boundaries, runs
from resim.sweeps.manifest import SCHEMA, SweepBegun, SweepInputs, SweepManifest
from resim.sweeps.outcomes.registry import OUTCOMES, type_of
from resim.sweeps.proof import kept_if_proved, proved
from resim.sweeps.sweep_file import EXAMPLE
from resim.sweeps.tasks import (
    RunResult,
    RunTask,
    Values,
    swept_model,
    with_values,
)
from resim.verification.inputs import HashedFile, NamedBuild

PART = 100_000
"""Rows of one file of the table."""
FAILED = "failed"
"""End of a run that has no result: its process crashed every time, or it could not be begun."""

Tell = Callable[[bool], None]
"""Hears of each run that was done: whether it failed."""


def inputs(sweep: Sweep, out: Path) -> SweepInputs:
    """Give everything that the results follow from: what the file says, and hashes, paths from `out`.

    Raises InputError for what cannot be read.
    """
    file = sweep.file

    def kept(path: Path, digest: str) -> HashedFile:
        return HashedFile(path=relative(path, out), hash=digest)

    def build(frozen: FrozenFile) -> NamedBuild:
        label = load_build(frozen).label
        return NamedBuild(path=relative(frozen.path, out), hash=frozen.hash, label=label)

    read_criteria(sweep.criteria)
    seen = sweep.perception
    return SweepInputs(
        sweep=file,
        vehicle=sweep.vehicle,
        criteria=kept(sweep.criteria.path, sweep.criteria.hash),
        perception=None if seen is None else kept(seen.path, seen.hash),
        builds={name: build(sweep.frozen[name]) for name in file.build},
        recordings={name: kept(folder, sweep.hashes[name]) for name, folder in sweep.folders.items()},
        kernels=MISSING
        if sweep.varied is None
        else kept(sweep.varied.kernels.path, sweep.varied.kernels.hash),
        verified=_verified(sweep, kept),
    )


def _verified(sweep: Sweep, kept: Callable[[Path, str], HashedFile]) -> HashedFile | MISSING:
    """The verification that trust in variations is judged by."""
    if sweep.varied is None or sweep.varied.verified is None:
        return MISSING
    return kept(sweep.varied.verified.path, sweep.varied.verified.hash)


def begin(out: Path, told: SweepInputs, *, resume: bool) -> None:
    """Make the folder of the results, or go on in it. Raises InputError where it holds another sweep."""
    path = out / "sweep.json"
    if not path.is_file():
        _make(out)
        with whole_file(path, None) as beside:
            write_json(sealed(to_json(SweepBegun(versions(), told))), beside)
    elif not resume:
        raise InputError(
            out, "already has a sweep", "Resume it with --resume, or name another folder with --out."
        )
    remedy = "Restore it, or start again with another --out."
    try:
        held, now = read_sealed(path, remedy), sealed(to_json(SweepBegun(versions(), told)))
        differ = chain(*(_differ(held[name], now[name]) for name in ("inputs", "versions")))
    except (ValueError, KeyError, TypeError) as e:
        raise InputError(path, "is not what `resim sweep` writes", remedy) from e
    if (name := next(differ, None)) is not None:
        raise InputError(out, f"{name} has changed when the sweep began", remedy)


def _make(out: Path) -> None:
    """Make the folder, unless another shard does so at this moment. Raises InputError where it is of something else."""
    remedy = "Name another folder with --out."
    try:
        out.mkdir(parents=True, exist_ok=True)
        held = [path for path in out.iterdir() if not path.name.endswith(".new")]
        strange = [p for p in held if p.name not in ("sweep.json", "journal")]
        strange += [
            p for p in (out / "journal").glob("*") if not (out / "sweep.json").is_file() and p.stat().st_size
        ]
    except OSError as e:
        raise InputError(out, f"cannot be made or read: {e.strerror}", remedy) from e
    if strange:
        raise InputError(out, "exists and has no sweep", remedy)


def _differ(old: Any, new: Any, name: str = "") -> Iterator[str]:
    """Names of what differs."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in sorted({*old, *new}):
            yield from _differ(old.get(key), new.get(key), f"{name}.{key}".lstrip("."))
    elif old != new:
        yield name


def table(sweep: Sweep, shard: tuple[int, int] = (1, 1)) -> pd.DataFrame:
    """Give the runs of the sweep, or of the i-th of N shards: every N-th run.

    Raises InputError for parameters that the model or a build does not take.
    """
    _has_outcome(sweep)
    every = runs(sweep)  # of an adaptive plan the first round, which has the extremes
    names = [p.name for p in sweep.file.parameter]
    values = every[names].to_numpy(dtype=float)
    for row in sorted({*values.argmin(axis=0).tolist(), *values.argmax(axis=0).tolist()}):
        _fits(sweep, tuple(zip(names, values[row].tolist(), strict=True)))
    for name in {"build.cycle_time"} & set(names):
        _cycles(sweep, name, every[name].unique().tolist())
    return every[every[RUN] % shard[1] == shard[0] - 1]


def _cycles(sweep: Sweep, name: str, values: list[float]) -> None:
    """Raise ResimError where a cycle time is no multiple of the simulation's step."""
    if sweep.file.planned.grows:
        remedy = "Choose another plan, with values = [...]."
        raise InputError(
            sweep.path, f"an adaptive plan cannot halve {name}: it is a multiple of the step", remedy
        )
    for build in (load_build(sweep.frozen[name]) for name in sweep.file.build):
        for value in values:
            try:
                cycle_steps(with_values(build, ((name, value),)), ResimulationOptions().step)
            except InputError as e:
                raise InputError(sweep.path, e.problem, e.remedy) from e
            except ResimError as e:
                raise InputError(sweep.path, f"parameter {name!r}: {str(e).partition(': ')[2]}") from e


def _has_outcome(sweep: Sweep) -> None:
    """Raise InputError where an adaptive plan asks for an outcome that runs do not have."""
    if not sweep.file.planned.grows:
        return
    shares = (outcome.name for outcome in OUTCOMES if outcome.good is not None)
    own = [c.name for c in read_criteria(sweep.criteria).criteria]
    builtin = [*shares]
    if sweep.file.adaptive.outcome in builtin and sweep.file.adaptive.outcome in own:
        problem = (
            f"adaptive.outcome {sweep.file.adaptive.outcome!r} is the name of an outcome and of a criterion"
        )
        raise InputError(sweep.path, problem, "Give the criterion another name.")
    known = list(dict.fromkeys([*builtin, *own]))
    if sweep.file.adaptive.outcome not in known:
        problem = f"adaptive.outcome {sweep.file.adaptive.outcome!r} is not in this sweep"
        raise InputError(sweep.path, problem, f"There are: {', '.join(known)}.")


def _fits(sweep: Sweep, values: Values) -> None:
    """Raise InputError, of the sweep's file, where the model or a build does not take these values."""
    _model_fits(sweep, values)
    for name in sweep.file.build:
        build = load_build(sweep.frozen[name])
        try:
            build = with_values(build, values)
        except InputError as e:
            raise InputError(sweep.path, f"{build.path.name}: {e.problem}", e.remedy) from e
        with build.factory.afresh():
            _function_fits(sweep, build, values)
        if build.opened.found:
            raise InputError(build.path, build.opened.note())


def _model_fits(sweep: Sweep, values: Values) -> None:
    swept_model(sweep.perception, ())
    try:
        swept_model(sweep.perception, values)
    except InputError as together:
        for name, value in values:
            try:
                swept_model(sweep.perception, ((name, value),))
            except InputError as e:
                why = fault_of(e, name.removeprefix("perception."))
                raise InputError(sweep.path, f"parameter {name!r}: {why}", EXAMPLE) from e
        raise InputError(sweep.path, together.problem, EXAMPLE) from together


def _function_fits(sweep: Sweep, build: Build, values: Values) -> None:
    own = {name: value for name, value in values if name.startswith("function.")}
    for name in own if build.program is None else ():  # a process says what it takes when it is reset
        if misfit := misfit_of(build.factory.load(), {**build.parameters, name.partition(".")[2]: 0.0}):
            raise InputError(sweep.path, f"parameter {name!r}: in {build.path.name} {misfit}", EXAMPLE)
    try:
        try_to_make(build)
    except FunctionError as e:
        if not str(e).startswith("raised "):  # it ends its process, or does not return
            raise FunctionError(f"{build.label} on being made {e}") from e
        given = ", ".join(f"{name} = {value:g}" for name, value in own.items())
        problem = f"{build.path.name} does not take {given or 'its own [parameters]'}: {e}"
        raise InputError(sweep.path, problem, "Correct the ranges.") from e


def execute(
    sweep: Sweep,
    out: Path,
    *,
    workers: int,
    shard: tuple[int, int] = (1, 1),
    pool: Executor | None = None,
    expect: Callable[[int], None] = lambda total: None,
    tell: Tell = lambda failed: None,
    found: Callable[[str, tuple[str, ...]], None] = lambda recording, findings: None,
) -> None:
    """Do what is missing of the sweep, or of a shard; each result is committed whole as soon as it is there.

    expect: hears how many runs it is, which grow with an adaptive plan. found: hears the findings in each recording as
    soon as one of its runs is there.
    """
    checked, noted = set[str](), set[str]()
    with journal.Journal(out / "journal" / f"{shard[0]}-of-{shard[1]}.jsonl") as file:
        todo: list[RunTask] | None = None
        while todo is None or (todo and sweep.file.planned.grows):
            rows = _rows(sweep, out)
            wanted = runs(sweep, rows)
            plans = _plans(sweep, wanted)
            for _ in journal.entries(out / "journal", type_of, plans, whole=not sweep.file.planned.grows):
                pass  # none is of something else
            expect(len(wanted))
            mine = wanted[wanted[RUN] % shard[1] == shard[0] - 1]
            first = todo is None
            todo = [task for task in tasks(sweep, mine) if task.run not in rows]
            if first and todo:
                _refuse_unpinned(out, set(mine[RUN].tolist()))
            of = dict(zip(mine[RUN].tolist(), mine["recording"].tolist(), strict=True))
            for number, result in kept_if_proved(file, proved(todo, sweep.file.time_limit, workers, pool)):
                if not isinstance(result, Failure):
                    name = of[number]
                    if name not in checked:
                        checked.add(name)
                        found(name, result.findings)
                    if (told := result.row.get("unpinned")) is not None and told not in noted:
                        noted.add(str(told))
                        found(name, (str(told),))
                entry = _entry(result, number, plans[number], sweep)
                file.append(entry)
                tell(entry.row["failure"] is not None)


def _refuse_unpinned(out: Path, mine: set[int]) -> None:
    """Raise InputError where results are of code that asks what its hash does not know: that may be otherwise now."""
    for entry in journal.read(out / "journal", type_of):
        told = entry.row.get("unpinned")
        if entry.run in mine and told is not None and any(end in str(told) for end in UNPINNED):
            problem = f"cannot be resumed: {told}, so runs that are left may be of other code"
            raise InputError(out, problem, "Run the sweep anew with another --out.")


def _plans(sweep: Sweep, wanted: pd.DataFrame) -> dict[int, str]:
    """Give what each run is of, by its number: a checksum over recording, build, seed, parameters, and all inputs.

    A journal of a sweep that has the same names, but other content or another resim, is told by it.
    """
    seen = sweep.perception
    files = [{name: frozen.hash for name, frozen in sweep.frozen.items()}, sweep.hashes, sweep.criteria.hash]
    content = [*files, None if seen is None else seen.hash, sweep.vehicle, to_json(sweep.file), versions()]
    if sweep.varied is not None:
        content += [sweep.varied.kernels.hash, sweep.varied.verified and sweep.varied.verified.hash]
    begun = zlib.crc32(json.dumps(content, sort_keys=True, default=str).encode())
    columns = [*DRAWN_COLUMNS, *(p.name for p in sweep.file.parameter)]
    rows = zip(wanted[RUN].tolist(), *(wanted[name].tolist() for name in columns), strict=True)
    return {number: f"{zlib.crc32(repr(of).encode(), begun):08x}" for number, *of in rows}


def _rows(sweep: Sweep, out: Path) -> dict[int, Row]:
    """Give what the results are by run, where the plan follows from them; else empty, to spare the memory."""
    needed = sweep.file.planned.grows
    return {entry.run: entry.row if needed else {} for entry in journal.read(out / "journal", type_of)}


def _entry(result: RunResult | Failure, number: int, plan: str, sweep: Sweep) -> JournalEntry:
    """What the journal holds of the result of a run; files as the sweep names them, wherever it lies."""
    if not isinstance(result, Failure):
        return JournalEntry(number, plan, result.row, result.time)
    reason, files = result.reason, {name: frozen.path for name, frozen in sweep.frozen.items()}
    for name, path in (files | sweep.folders).items():
        reason = reason.replace(str(path.resolve()), name).replace(str(path), name)
    return JournalEntry(number, plan, {"end": FAILED, "failure": reason}, None)


def tasks(sweep: Sweep, wanted: pd.DataFrame) -> Iterator[RunTask]:
    """Give the tasks of runs."""
    file, names = sweep.file, [p.name for p in sweep.file.parameter]
    columns = zip(
        wanted[RUN].tolist(), wanted["recording"].tolist(), wanted["build"].tolist(), wanted["seed"].tolist(),
        wanted[names].to_numpy(dtype=float).tolist(), strict=True,
    )  # fmt: skip
    for number, recording, build, seed, values in columns:
        yield RunTask(
            number, sweep.folders[recording], sweep.hashes[recording], sweep.frozen[build], sweep.perception,
            sweep.criteria, file.accept, tuple(zip(names, values, strict=True)), seed, sweep.vehicle,
            file.engine, file.repeated_in_sumo if file.engine == "direct" else 0.0, file.reacts, sweep.varied,
        )  # fmt: skip


def compact(sweep: Sweep, out: Path) -> tuple[int, int]:
    """Write the table once every run is there; give how many runs are missing, and how many failed.

    runs/part-*.parquet: a row a run, in order; times.parquet: wall-clock times [s]; manifest.json.
    """
    grows = sweep.file.planned.grows
    rows = _rows(sweep, out) if grows else {}
    every = runs(sweep, rows)
    told = journal.entries(out / "journal", type_of, _plans(sweep, every))
    lines = {entry.run: line for line, entry in told}
    if missing := len(every) - len(lines):
        return missing, 0
    found = _found([lines[k] for k in every[RUN]])
    failed = int(found["failure"].notna().sum())
    whole = pd.concat([every, found.drop(columns="time")], axis=1)
    (out / "runs").mkdir(exist_ok=True)
    parts = {f"runs/part-{first // PART:05d}.parquet": first for first in range(0, len(whole), PART)}
    for name, first in parts.items():
        with whole_file(out / name, None) as path:
            write_parquet(whole.iloc[first : first + PART], path)
    with whole_file(out / "times.parquet", None) as path:
        write_parquet(pd.DataFrame({RUN: every[RUN], "time": found["time"]}), path)
    remedy = "Restore it, or start again with another --out."
    held = read_sealed_json(out / "sweep.json", SweepBegun, "resim sweep", remedy)
    manifest = SweepManifest(
        schema=SCHEMA,
        versions=held.versions,
        inputs=held.inputs,
        runs=len(whole),
        failed=failed,
        files={name: file_hash(out / name) for name in parts},
        boundaries=boundaries(sweep, rows) if grows else MISSING,
        columns=tuple(map(str, whole.columns)),
    )
    with whole_file(out / "manifest.json", None) as path:
        write_json(sealed(to_json(manifest)), path)
    return 0, failed


def _found(lines: list[bytes]) -> pd.DataFrame:
    """Results and times as a table, from lines of the journal; by parts, as entries take much more memory than rows."""
    parts = []
    for first in range(0, len(lines), PART // 10):
        entries = map(journal.parse, lines[first : first + PART // 10])
        parts.append(pd.DataFrame([{**entry.row, "time": entry.time} for entry in entries]))
    found = pd.concat(parts, ignore_index=True)
    return found.astype({c: float for c in found if _is_number(found[c])})


def _is_number(column: pd.Series[Any]) -> bool:
    known = column.dropna()
    return bool(len(known)) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in known)
