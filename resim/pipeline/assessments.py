"""Recordings and results of runs, assessed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from resim.assess.assessment import Assessment, assess
from resim.assess.criteria import Criteria
from resim.assess.drive import drive
from resim.assess.risk import Parameters
from resim.core.errors import InputError
from resim.pipeline.recordings import examined
from resim.pipeline.run import describe_recording, map_name
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.jscen import read_jscen
from resim.scenario.scenario import Scenario

RATE = 10.0
"""Scenes a second [Hz] that are assessed."""

BLOCKS = ("GT", "SD", "rGT", "rSD")


def assess_folder(
    folder: Path, parameters: Parameters, criteria: Criteria | None = None
) -> dict[str, Assessment]:
    """Assess a recording (GT, and SD where there is one) or what `resim run` wrote (GT, SD, rGT, rSD).

    Raises InputError for a folder that is neither.
    """
    if (folder / "run.json").is_file():
        scenarios, network = _results(folder)
    elif (folder / "recording.toml").is_file():
        recording = examined(folder)
        network = load(recording.map)
        scenarios = {
            str(basis): scenario for basis, scenario in describe_recording(recording, network).items()
        }
    else:
        problem = "holds neither recording.toml nor run.json"
        raise InputError(folder, problem, "Give a recording, or the folder that `resim run` wrote.")
    return {name: _assess(scenario, network, parameters, criteria) for name, scenario in scenarios.items()}


def _results(folder: Path) -> tuple[dict[str, Scenario], RoadNetwork]:
    """The scenarios that a run wrote, and its map."""
    report = folder / "report.json"
    try:
        road = folder / map_name(Path(str(json.loads(report.read_text(encoding="utf-8"))["map"])))
    except (OSError, ValueError, KeyError, TypeError) as e:
        raise InputError(report, "is not what `resim run` writes", "Run it again.") from e
    network = load(road)
    files = {name: folder / f"{name}.jscen.json" for name in BLOCKS}
    return {name: read_jscen(path) for name, path in files.items() if path.is_file()}, network


def _assess(
    scenario: Scenario, network: RoadNetwork, parameters: Parameters, criteria: Criteria | None
) -> Assessment:
    begin = scenario.ego.spawn_time
    t = np.round(begin + np.arange(0.0, scenario.duration + 1e-9, 1.0 / RATE), 9)
    made = drive(scenario.tracks(network, t), ego=scenario.ego.id, parameters=parameters)
    return assess(made, network, parameters, criteria)
