"""OpenSCENARIO XML 1.0 to 1.3, as far as a file says where everybody is over time.

Source: ASAM OpenSCENARIO XML 1.3. What a player would decide is refused, with the element named.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from resim.core.clock import TICK
from resim.core.errors import InputError
from resim.core.files import joined
from resim.core.geometry import Floats
from resim.core.tracks import Tracks
from resim.recordings.formats.registry import FORMATS, RecordingFormat
from resim.recordings.present import existing_map
from resim.recordings.recording import Recording, sample_rate
from resim.recordings.source import LONGEST, MOST_PLACES
from resim.recordings.storyboard.actions import StoryboardReader
from resim.recordings.storyboard.catalogs import ScenarioCatalogs
from resim.recordings.storyboard.curves import ScenarioCurve
from resim.recordings.storyboard.document import ScenarioElement, open_scenario_file
from resim.recordings.storyboard.entities import ScenarioEntity, scenario_entities
from resim.recordings.storyboard.motion import EntityMotion, sampled, station_times
from resim.recordings.storyboard.places import ScenarioPlaces
from resim.recordings.tables import BIGGEST
from resim.recordings.window import asked_window, beyond_ego, times_of
from resim.road.opendrive import load

STEP, WIDEST = 0.02, 0.04
"""s between samples where the file says no times of its own, and between the EGO's vertices at most."""
FINE = 0.01
"""s; vertices that lie nearer to each other are not all taken."""
BY_OPTION = "Give the OpenDRIVE map by --map."
EGOS = ("ego", "hero")
"""What the EGO's entity is called, in small letters."""


def read_openscenario(
    xosc: Path,
    *,
    map: Path | None = None,
    ego: str | None = None,
    start: float | None = None,
    end: float | None = None,
) -> Recording:
    """Give the drive that a scenario says as ground truth.

    map: without it the file's LogicFile, relative to the file. ego: name of an entity; without it the one called Ego
    or hero. start, end [s] are times of the scenario; without them nothing is cut. Times are those of the
    EGO's vertices, or 0.02 s apart; between vertices everybody is interpolated. Raises InputError.
    """
    scenario = open_scenario_file(xosc)
    road = existing_map(xosc, _logic_file(scenario) if map is None else map)
    catalogs = ScenarioCatalogs(scenario)
    entities = scenario_entities(scenario, catalogs)
    ego = _ego(xosc, entities, ego)
    places = ScenarioPlaces(lambda: load(road))
    board = StoryboardReader(scenario, [*entities], catalogs, places, end)
    until = _until(scenario, board, end)
    motions = {name: EntityMotion(deeds, places, until) for name, deeds in board.deeds.items()}
    if not motions[ego].stretches:
        raise InputError(xosc, f"ego {ego!r} is put nowhere", "Give it a TeleportAction or a trajectory.")
    times = _times(xosc, motions[ego], until, len(motions))
    rows = [_rows(xosc, entities[name], motion, times) for name, motion in motions.items()]
    shown = [one for one in rows if one is not None]
    frame = pd.concat(shown)
    low, high = asked_window(frame, xosc, ego=ego, start=start, end=end)
    frame = frame[frame["t"].between(low, high)]
    origin = float(frame["t"].min())
    beyond = beyond_ego(times_of(frame, xosc, ego), frame)
    frame = frame.assign(t=np.round(frame["t"] - origin, 9))
    gt = Tracks.from_frame(frame.sort_values("t", kind="stable"))
    return Recording(
        name=f"{xosc.stem}_{ego}", map=road, ego=ego, gt=gt, gt_rate=sample_rate(xosc, gt),
        provenance=_provenance(scenario, entities, motions, origin, beyond),
    )  # fmt: skip


FORMATS.add(
    RecordingFormat(
        name="openscenario",
        source="an OpenSCENARIO file",
        file="scenario",
        file_help="OpenSCENARIO XML 1.0 to 1.3 (.xosc).",
        reader=read_openscenario,
        works_out=("map", "ego"),
        patterns=("*.xosc",),
    )
)


def _logic_file(scenario: ScenarioElement) -> Path:
    """The map that the file names. Raises InputError where it is not there."""
    network = scenario.needed("RoadNetwork")
    if (told := network.child("LogicFile")) is None:
        raise network.refused("names no LogicFile", BY_OPTION)
    road = joined(scenario.file, told.text("filepath"))
    try:
        return existing_map(scenario.file, road)
    except InputError:
        raise told.refused(f"names {road}, which is no file here", BY_OPTION) from None


def _ego(xosc: Path, entities: dict[str, ScenarioEntity], ego: str | None) -> str:
    if ego is not None and ego in entities:
        return ego
    some = ", ".join([*entities][:20])
    if ego is not None:
        raise InputError(xosc, f"ego {ego!r} was not found; the file has {some}", "Name one of them.")
    found = [name for name in entities if name.lower() in EGOS]
    if len(found) != 1:
        raise InputError(
            xosc,
            f"has {len(found)} entities called Ego or hero; its entities are {some}",
            "Name one by --ego.",
        )
    return found[0]


def _until(scenario: ScenarioElement, board: StoryboardReader, end: float | None) -> float:
    """The last time [s]: that of the stop trigger, or the one asked for, or the last that a trajectory says."""
    last = board.end
    if end is not None:
        last = end if last is None else min(last, end)
    if last is None:
        told = [deed.what for own in board.deeds.values() for deed in own]
        curves = [what.end for what in told if isinstance(what, ScenarioCurve) and what.timed]
        last = max(curves, default=None)
    if last is None:
        raise scenario.needed("Storyboard").refused(
            "has no StopTrigger, so when it ends is unknown", "Name the end by --end."
        )
    if not 0.0 < last <= LONGEST:
        raise scenario.needed("Storyboard").refused(
            f"ends at {last:g} s, expected up to {LONGEST:g}", "Name the end by --end."
        )
    return last


def _times(xosc: Path, motion: EntityMotion, until: float, entities: int) -> Floats:
    """Times (T,) [s]: those of the EGO's vertices, with others between them where they are far apart."""
    told = np.concatenate([[0.0, until], *station_times(motion)])
    told = np.unique(told[(told >= 0.0) & (told <= until)])
    told = told[np.r_[True, np.diff(told) > TICK]]
    gaps = np.diff(told)
    if len(gaps) and np.median(gaps) < FINE - TICK:
        told = np.r_[np.arange(0.0, until - TICK, FINE), until]
        gaps = np.diff(told)
    pieces = np.where(gaps > WIDEST + TICK, np.ceil(gaps / STEP - 1e-6), 1).astype(int)
    if (pieces.sum() + 1) * entities > MOST_PLACES:
        raise InputError(
            xosc,
            f"has {entities} entities at {pieces.sum() + 1} times: too many",
            "Name a shorter end by --end.",
        )
    inside = [a + gap * np.arange(n) / n for a, gap, n in zip(told[:-1], gaps, pieces, strict=True)]
    return np.concatenate([*inside, told[-1:]])


def _rows(xosc: Path, entity: ScenarioEntity, motion: EntityMotion, times: Floats) -> pd.DataFrame | None:
    """The track table of an entity, of its box's centre; None for one that is never there, or is furniture."""
    x, y, heading, v = sampled(motion, times)
    there = np.isfinite(x)
    if entity.is_furniture or not there.any():
        return None
    c, s = np.cos(heading), np.sin(heading)
    states = {
        "t": times, "x": x + entity.ahead * c - entity.left * s, "y": y + entity.ahead * s + entity.left * c,
        "heading": heading, "v": v,
    }  # fmt: skip
    frame = pd.DataFrame(states)[there]
    largest = frame.abs().max()
    if not (largest <= BIGGEST).all():
        raise InputError(
            xosc, f"entity {entity.name!r} reaches {largest.max():g}, expected up to {BIGGEST:g}"
        )
    fixed = {"id": entity.name, "kind": entity.kind, "length": entity.length, "width": entity.width}
    out: pd.DataFrame = frame.assign(**fixed)
    return out


def _provenance(
    scenario: ScenarioElement,
    entities: dict[str, ScenarioEntity],
    motions: dict[str, EntityMotion],
    origin: float,
    beyond: str,
) -> dict[str, Any]:
    header = scenario.needed("FileHeader")
    gone = [f"{name}: {why}" for name, motion in motions.items() for why in motion.left]
    nowhere = [f"{name} (put nowhere)" for name, motion in motions.items() if not motion.stretches]
    site = [f"{name} (a part of the site)" for name, one in entities.items() if one.is_furniture]
    known = {
        "source": scenario.file.name,
        "format": f"OpenSCENARIO {header.text('revMajor')}.{header.text('revMinor')}",
        "description": header.xml.get("description"), "author": header.xml.get("author"),
        "says_no_more_of": _listed(gone), "left_out": _listed(nowhere + site),
        "original_start": f"{origin:.9g} s", "without_ego": beyond,
    }  # fmt: skip
    return {key: value for key, value in known.items() if value}


def _listed(told: list[str]) -> str:
    more = f"; and {len(told) - 20} more" if len(told) > 20 else ""
    return "; ".join(told[:20]) + more
