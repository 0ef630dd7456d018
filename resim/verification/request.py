"""What a verification is asked for, and the tasks that it comes to."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from resim.core.errors import InputError, ResimError
from resim.core.files import relative
from resim.core.plugins.frozen import FrozenFile, freeze_file
from resim.metrics.criteria import freeze_criteria, read_criteria
from resim.perception.model import freeze_model, read_model
from resim.recordings.content import content_hash
from resim.recordings.settings import SETTINGS, read_settings
from resim.resimulation import check_codes
from resim.simulation.function.interface import freeze_build, load_build
from resim.simulation.vehicles.kinematic import Kinematic
from resim.simulation.vehicles.registry import vehicle_model
from resim.verification.entries import RecordingSource
from resim.verification.inputs import HashedFile, NamedBuild, VerificationRequest
from resim.verification.sequential import SequentialTest
from resim.verification.suite import Suite, check_call
from resim.verification.tasks import VerificationTask
from resim.verification.verify import UNKNOWN, may_verify


@dataclass(frozen=True)
class VerifyOptions:
    """What is asked for besides suite and builds; None and () leave it to the suite.

    Attributes:
        perception: File of a perception model in place of the suite's.
        settings: Parameters of the model, such as "latency.speed=0.4".
        seeds: Most runs with the model of a recording; of two builds, runs of each.
        vary: Names of what is varied of the most critical object until a KPI flips.
        driven_by: Labels of other builds whose recordings are taken, too.
        vehicle: Name of the EGO's vehicle model.
    """

    perception: Path | None = None
    settings: tuple[str, ...] = ()
    seeds: int | None = None
    vary: tuple[str, ...] = ()
    driven_by: tuple[str, ...] = ()
    vehicle: str = Kinematic.name


def make_request(
    suite: Suite, build: Path, against: Path | None, call: VerifyOptions, base: Path
) -> VerificationRequest:
    """Give what is asked for, with the hashes of all that goes in. base: folder of verification.json.

    Raises InputError for what cannot be read, but for recordings: each of those is an error of its own.
    """
    file = suite.file
    perception = call.perception or (None if file.perception is None else suite.beside(file.perception))
    check_call(perception is not None, settings=call.settings, seeds=call.seeds, vary=call.vary)
    if against is not None and (call.vary or call.driven_by):
        raise InputError(
            "--against", "compares two builds and takes neither", "Leave out --vary and --driven-by."
        )
    check_codes(file.accept)
    vehicle_model(call.vehicle)
    model = None if perception is None else freeze_model(perception)
    if model is not None:
        read_model(model, call.settings)
    criteria = freeze_criteria(suite.beside(file.criteria))
    read_criteria(criteria)
    count = call.seeds or (file.seeds if against is None else file.limits.seeds)
    if against is None and perception is not None:
        _enough(suite.path, SequentialTest(file.agreement, count))
    return VerificationRequest(
        name=file.name,
        suite=_file(freeze_file(suite.path), base),
        build=_build(build, base),
        against=None if against is None else _build(against, base),
        criteria=_file(criteria, base),
        perception=None if model is None else _file(model, base),
        settings=call.settings,
        seeds=() if model is None else tuple(range(file.seed, file.seed + count)),
        bases=file.bases,
        agreement=file.agreement,
        vary=call.vary or file.vary,
        accept=file.accept,
        driven_by=(*file.driven_by, *call.driven_by),
        vehicle=call.vehicle,
        traffic=file.reacts,
        tolerances=file.tolerances,
        limits=file.limits,
        reports=file.reports,
        recordings={
            name: HashedFile(path=relative(folder, base), hash=_content(folder))
            for name, folder in suite.folders.items()
        },
        wanted=dict(suite.hashes),
    )


def _enough(suite: Path, test: SequentialTest) -> None:
    """Raise InputError where no outcome of so few seeds would verify anything."""
    if test.most < test.fewest:
        problem = (
            f"agreement {test.demand:g} cannot be decided with {test.most} seeds, even if all of them agree"
        )
        raise InputError(suite, problem, f"Allow seeds = {test.fewest} or more; 200 if nothing is said.")


def refuse_changes(before: VerificationRequest, path: Path) -> None:
    """Raise InputError where anything that the verification.json at `path` was asked for has changed since."""
    base = path.parent
    files: list[tuple[HashedFile | None, Callable[[Path], FrozenFile]]] = [
        (before.build, freeze_build), (before.against, freeze_build), (before.perception, freeze_model),
        (before.criteria, freeze_criteria),
    ]  # fmt: skip
    now: list[tuple[str, str | None, str | None]] = [
        (one.path, one.hash, again(_there(base, one)).hash) for one, again in files if one is not None
    ]
    now += [(r.path, r.hash, _content(_there(base, r))) for r in before.recordings.values()]
    if changed := [name for name, old, new in now if old != new]:
        more = f" (and {len(changed) - 1} more)" if len(changed) > 1 else ""
        raise InputError(path, f"{changed[0]}{more} has changed", "Restore it, or verify again.")


def refuse_others(a: VerificationRequest, base: Path) -> None:
    """Raise InputError for recordings that another function drove: the method compares what one function did twice."""
    if a.against is not None:
        return
    build, other = load_build(_frozen(base, a.build)), []
    for name, file in a.recordings.items():
        try:
            settings = read_settings(_there(base, file) / SETTINGS)
        except ResimError:
            continue  # an error of its own, when its turn comes
        if not may_verify(settings, build, a.driven_by):
            other.append((name, settings.build or UNKNOWN))
    if other:
        name, label = other[0]
        more = f" (and {len(other) - 1} more recordings)" if len(other) > 1 else ""
        was = f"was driven by {label!r}" + (", with another hash" if label == build.label else "")
        raise InputError(
            name, f"{was}, not by this {build.label!r}{more}",
            "Use the build that drove, compare builds with --against, or accept it with --driven-by "
            f"{label}. Where nothing says which build drove, say so in recording.toml: build = \"{build.label}\".",
        )  # fmt: skip


def tasks(a: VerificationRequest, base: Path) -> dict[str, VerificationTask]:
    """Give a task for each recording, by name. base: what the paths are from."""
    against = None if a.against is None else _frozen(base, a.against)
    perception = None if a.perception is None else _frozen(base, a.perception)
    return {
        name: VerificationTask(
            RecordingSource(name, file.path, file.hash), _there(base, file), a.wanted.get(name) or file.hash,
            _frozen(base, a.build), against, _frozen(base, a.criteria), a.bases, perception, a.settings,
            a.seeds, a.agreement, a.tolerances, a.vary, a.accept, a.vehicle, a.traffic,
        )
        for name, file in a.recordings.items()
    }  # fmt: skip


def _there(base: Path, file: HashedFile) -> Path:
    return Path(os.path.normpath(base / file.path))


def _frozen(base: Path, file: HashedFile) -> FrozenFile:
    """What was hashed when this was asked for, and nothing that came after."""
    return FrozenFile(_there(base, file), str(file.hash))


def _file(frozen: FrozenFile, base: Path) -> HashedFile:
    return HashedFile(path=relative(frozen.path, base), hash=frozen.hash)


def _build(path: Path, base: Path) -> NamedBuild:
    build = load_build(path)
    return NamedBuild(path=relative(path, base), hash=build.hash, label=build.label)


def _content(folder: Path) -> str | None:
    try:
        return content_hash(folder)
    except (ResimError, OSError):
        return None
