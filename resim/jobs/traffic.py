"""Make naturalistic recordings of SUMO's traffic: what `resim traffic` does."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from resim.core.errors import InputError
from resim.core.files import file_hash, shipped
from resim.core.tracks import Tracks
from resim.jobs.driven_traffic import EgoWindow, TrafficEgo, read_ego, with_ego
from resim.jobs.generate import TRUTH
from resim.jobs.given import path_of
from resim.recordings import Recording, write_recording
from resim.recordings.checked import check_codes
from resim.recordings.formats.highd_writer import write_highd
from resim.results import whole_file
from resim.road.checked import refuse_flaws
from resim.road.flaws import flaws
from resim.road.opendrive import load
from resim.road.sumo.netconvert import sumo_version
from resim.scenario.generation.truth import truth_table
from resim.simulation.naturalistic.settings import read_naturalistic
from resim.simulation.naturalistic.windows import TrafficWindow, traffic_windows

RATE = 25.0
"""Samples a second [Hz], as of highD."""
LONGEST = 48.0
"""Most hours of one call."""
DIGITS = 6


@dataclass(frozen=True)
class TrafficRecording:
    """One recording of the traffic.

    Attributes:
        folder: Of the recording.
        vehicles: How many it has.
        kilometres: How far they drive together [km].
        labels: How often each maneuver is in the truth.
        left_out: Ids of vehicles that are left out, with the reason.
        driver: The build that drives its EGO, "" where SUMO does.
        note: How the drive ended early, or that nobody could be the EGO; "" for nothing.
        failed: Whether the function failed.
    """

    folder: Path
    vehicles: int
    kilometres: float
    labels: dict[str, int]
    left_out: tuple[tuple[str, str], ...]
    driver: str = ""
    note: str = ""
    failed: bool = False


def shipped_traffic() -> Path:
    """Give the traffic settings that ship, those of a motorway.

    Returns:
        Their file.
    """
    return shipped() / "scenarios" / "traffic" / "motorway.toml"


def make_traffic(
    road: str | Path,
    out: str | Path,
    *,
    hours: float,
    settings: str | Path | None = None,
    seed: int = 1,
    highd: bool = False,
    build: str | Path | None = None,
    perception: str | Path | None = None,
    accept: Collection[str] = (),
) -> Iterator[TrafficRecording]:
    """Make recordings of SUMO's traffic on a map, each with its table of truth beside it (`truth.csv`).

    Args:
        road: OpenDRIVE file.
        out: New folder; a recording is a folder in it, 000 the first.
        hours: How long, without the warm-up [h].
        settings: TOML file; those of a motorway that ship, if None.
        seed: Of all draws.
        highd: Whether CSV of the highD family is written as well, into the folder `highd`.
        build: Build file of an AD function that drives one vehicle of each recording, in closed loop; that of the
            settings, if None.
        perception: Perception model (JSON) by which that vehicle senses the others; that of the settings, if None.
        accept: Codes of errors in the map to continue despite.

    Returns:
        The recordings, each as soon as it is written. With a build or a model each lasts as long as its EGO is there.

    Raises:
        InputError: The settings, the build or the model are wrong, the map has errors that are not accepted or cannot
            be entered, or the folder is there already.
        ConversionError: The map cannot be converted.
        ResimError: SUMO fails.
    """
    check_codes(accept)
    path, folder = path_of(road), _new_folder(path_of(out), hours)
    file = path_of(settings) if settings is not None else shipped_traffic()
    told, network = read_naturalistic(file), load(path)
    refuse_flaws(network, flaws(network), accept)
    ego = read_ego(file, told.ego, *(None if one is None else path_of(one) for one in (build, perception)))
    provenance = _provenance(seed, file, path) | ({} if ego is None else ego.provenance())
    made, left_out = 0, dict[str, str]()
    for number, window in enumerate(
        traffic_windows(network, told, duration=3600.0 * hours, rate=RATE, seed=seed)
    ):
        left_out |= dict(window.left_out)
        if not len(window.tracks):
            continue
        drawn = int(np.random.default_rng([seed, 3, number]).integers(2**31))
        found = None if ego is None else with_ego(window, ego, network, RATE, drawn)
        one = _write(found or _plain(window, path, ego), path, folder / f"{number:03d}", provenance)
        if highd:
            write_highd(found.window.tracks if found else window.tracks, folder / "highd", number, RATE)
        made += 1
        yield one
    if not made:
        raise _nothing_made(file, path, left_out)


def _provenance(seed: int, settings: Path, road: Path) -> dict[str, str]:
    return {
        "source": f"resim traffic, seed {seed}, SUMO {sumo_version()}",
        "settings": f"{settings.name}, SHA-256 {file_hash(settings)}",
        "map": f"{road.name}, SHA-256 {file_hash(road)}",
    }


def _nothing_made(settings: Path, road: Path, left_out: Mapping[str, str]) -> InputError:
    """Why there is no recording. left_out: the reason of each vehicle."""
    for why in left_out.values():
        told = f"all {len(left_out)} vehicles were left out, the first because {why}"
        return InputError(road, told, "See `resim map check`.")
    return InputError(settings, "no vehicle came in this time", "Raise per_lane, or ask for more hours.")


def _new_folder(folder: Path, hours: float) -> Path:
    """Give the folder back. Raises InputError where it is there already, or hours are none."""
    if not 0.0 < hours <= LONGEST:
        raise InputError("--hours", f"expected more than 0 up to {LONGEST:g}, found {hours:g}")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(folder, "exists already", "Name a new folder: a recording is never replaced.")
    return folder


def _plain(window: TrafficWindow, road: Path, ego: TrafficEgo | None) -> EgoWindow:
    """A window without an EGO that is driven or senses."""
    note = "" if ego is None else f"no {ego.settings.kind} is there for long enough to be the EGO"
    recording = Recording(
        name="", map=road, ego=_longest_first(window.tracks), gt=window.tracks, gt_rate=RATE
    )
    return EgoWindow(recording, window, note)


def _write(one: EgoWindow, road: Path, folder: Path, provenance: dict[str, str]) -> TrafficRecording:
    window, recording = one.window, one.recording
    tracks = _rounded(recording.gt)
    more = {"begin": f"{window.begin:g} s of the traffic", **recording.provenance}
    if window.left_out:
        more["left_out"] = "; ".join(f"{name}: {why}" for name, why in window.left_out)
    whole = replace(
        recording, name=folder.name, map=road.absolute(), gt=tracks, provenance={**provenance, **more},
        sd=None if recording.sd is None else _rounded(recording.sd),
    )  # fmt: skip
    write_recording(whole, folder, parquet=True)
    truth = truth_table(folder.name, window.maneuvers)
    with whole_file(folder / TRUTH, None) as beside:
        truth.to_csv(beside, index=False, lineterminator="\n")
    km = float(np.nansum(np.abs(tracks.v))) / RATE / 1000.0
    labels = {str(label): int(count) for label, count in truth["label"].value_counts().sort_index().items()}
    return TrafficRecording(
        folder, len(tracks), km, labels, window.left_out, recording.build or "", one.note, one.failed
    )


def _rounded(tracks: Tracks) -> Tracks:
    """Micrometres and the like: what is beyond only takes space."""
    told = ((name, getattr(tracks, name)) for name in ("x", "y", "heading", "v", "a", "yaw_rate"))
    return replace(tracks, **{name: np.round(values, DIGITS) for name, values in told if values is not None})


def _longest_first(tracks: Tracks) -> str:
    """The vehicle that is there from the first time on, and longest; the lowest id of several."""
    lasts = tracks.valid.sum(axis=1) + len(tracks.t) * tracks.valid[:, 0]
    return str(tracks.ids[int(np.argmax(lasts))])
