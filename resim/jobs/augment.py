"""Make variations of a recording by chance: what `resim augment` does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.files import file_hash, shipped
from resim.jobs.generate import TRUTH
from resim.jobs.given import path_of
from resim.recordings import Recording, RecordingTables, read_tables, write_recording
from resim.recordings.checked import load_checked
from resim.recordings.checks import examine
from resim.recordings.content import content_hash
from resim.results import whole_file
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.augmentation.augment import AugmentedDrive, augmentations
from resim.scenario.augmentation.settings import read_augmentation

REMEDY = "Lower the noise, or give the objects more room."


@dataclass(frozen=True)
class AugmentedRecording:
    """A variation of a recording.

    Attributes:
        folder: Of the variation.
        draws: How many draws it took until nobody overlaps and nothing is found.
        types: By id the type of vehicle that was drawn, where one was.
    """

    folder: Path
    draws: int
    types: dict[str, str]


def shipped_augmentation() -> Path:
    """Give the settings that ship, those of Kaefer 2022.

    Returns:
        Their file.
    """
    return shipped() / "scenarios" / "augment" / "kaefer.toml"


def augment(
    recording: str | Path, out: str | Path, *, count: int, settings: str | Path | None = None, seed: int = 1
) -> list[AugmentedRecording]:
    """Make variations of a recording: its ground truth with other paths, speeds, vehicles, colours and weather.

    Sensor data and plans are those of another drive then, and are left out. Where the recording has a table of truth
    (`truth.csv`), each variation has it too, its moments those at which the objects are at the same places.

    Args:
        recording: Its folder.
        out: New folder; a variation is a folder in it, 000 the first.
        count: How many.
        settings: TOML file; that of Kaefer 2022, if None.
        seed: Of all draws.

    Returns:
        The variations.

    Raises:
        InputError: The recording or the settings are wrong, the folder is there already, or there is no room for a
            variation without overlaps and findings.
    """
    folder, target = path_of(recording), path_of(out)
    if count < 1:
        raise InputError("--count", f"expected 1 or more, found {count}")
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise InputError(target, "exists already", "Name a new folder: a recording is never replaced.")
    file = path_of(settings) if settings is not None else shipped_augmentation()
    told, origin = read_augmentation(file), load_checked(folder)
    if len(lacking := origin.incomplete.get("gt", ())):
        problem = f"{len(lacking)} rows lack a value: where their objects are is unknown, and would be in a variation"
        raise InputError(folder, problem, "Repair it with `resim check --fix`.")
    network = load(origin.map)
    known = {(f.code, f.object) for f in examine(read_tables(folder), network)}
    truth = pd.read_csv(folder / TRUTH, keep_default_na=False) if (folder / TRUTH).is_file() else None
    provenance = {
        **{key: text for key, text in origin.provenance.items() if key in ("description", "kinds")},
        "source": f"resim augment, seed {seed}, of {origin.name}, hash {content_hash(folder)}",
        "settings": f"{file.name}, SHA-256 {file_hash(file)}",
    }
    made = []
    for number in range(count):
        name = f"{number:03d}"
        for draws, drive in enumerate(augmentations(origin.gt, origin.ego, told, seed, number), start=1):
            varied = _recording(origin, name, drive, provenance)
            if _is_sound(varied, network, known):
                _write(varied, target / name, drive, truth)
                made.append(AugmentedRecording(target / name, draws, dict(drive.types)))
                break
        else:
            raise InputError(folder, f"variation {number}: no draw is without overlaps and findings", REMEDY)
    return made


def _recording(origin: Recording, name: str, drive: AugmentedDrive, provenance: dict[str, str]) -> Recording:
    more = dict(provenance)
    if drive.colors:
        more["colors"] = ", ".join(f"{one} {color}" for one, color in drive.colors.items())
    if drive.types:
        more["types"] = ", ".join(f"{one} {kind}" for one, kind in drive.types.items())
    if drive.weather:
        more["weather"] = drive.weather
    return Recording(
        name=name, map=origin.map, ego=origin.ego, gt=drive.tracks, gt_rate=origin.gt_rate,
        environment={**origin.environment, **drive.environment}, provenance=more,
    )  # fmt: skip


def _is_sound(varied: Recording, network: RoadNetwork, known: set[tuple[str, str]]) -> bool:
    """Whether nothing is found in it that is not found in the origin."""
    found = examine(RecordingTables.of(varied), network)
    return all((one.code, one.object) in known for one in found)


def _write(varied: Recording, folder: Path, drive: AugmentedDrive, truth: pd.DataFrame | None) -> None:
    write_recording(varied, folder)
    if truth is None:
        return
    moved = truth.assign(recording=varied.name)
    for column in ("start", "end", "t"):
        moved[column] = [
            _moment(drive, str(one.object), float(getattr(one, column))) for one in truth.itertuples()
        ]
    last = float(drive.tracks.t[-1])
    kept = moved[np.isfinite(moved["t"]) & (moved["t"] <= last)]
    kept = kept.assign(end=kept["end"].clip(upper=last)).round({"start": 6, "end": 6, "t": 6})
    with whole_file(folder / TRUTH, None) as beside:
        kept.to_csv(beside, index=False, lineterminator="\n")


def _moment(drive: AugmentedDrive, name: str, t: float) -> float:
    """When the object is where it is at t [s] in the origin; inf where it never comes there."""
    if name not in drive.moments:
        return t
    base, here = drive.moments[name]
    return t if not base[0] <= t <= base[-1] else float(np.interp(t, base, here))
