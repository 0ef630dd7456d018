"""resim: re-simulation of measured test drives with the automated-driving function at the wheel.

What this package exports is the public interface. It is loaded at its first use: `import resim` alone loads nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from resim.core.errors import ResimError as ResimError
    from resim.core.tracks import Tracks as Tracks
    from resim.jobs.assess import AssessmentResult as AssessmentResult
    from resim.jobs.assess import assess as assess
    from resim.jobs.augment import AugmentedRecording as AugmentedRecording
    from resim.jobs.augment import augment as augment
    from resim.jobs.check import CheckResult as CheckResult
    from resim.jobs.check import check as check
    from resim.jobs.check import repair as repair
    from resim.jobs.convert import check_map as check_map
    from resim.jobs.convert import convert as convert
    from resim.jobs.generate import GeneratedRecording as GeneratedRecording
    from resim.jobs.generate import generate_recording as generate_recording
    from resim.jobs.play import play as play
    from resim.jobs.resimulate import ResimulationResult as ResimulationResult
    from resim.jobs.resimulate import resimulate as resimulate
    from resim.jobs.sweep import SweepListener as SweepListener
    from resim.jobs.sweep import SweepOptions as SweepOptions
    from resim.jobs.sweep import SweepRuns as SweepRuns
    from resim.jobs.sweep import sweep as sweep
    from resim.jobs.traffic import TrafficRecording as TrafficRecording
    from resim.jobs.traffic import make_traffic as make_traffic
    from resim.jobs.train import train as train
    from resim.jobs.verify import Verification as Verification
    from resim.jobs.verify import VerificationListener as VerificationListener
    from resim.jobs.verify import compare as compare
    from resim.jobs.verify import verify as verify
    from resim.metrics.criteria import Criteria as Criteria
    from resim.metrics.criteria import read_criteria as read_criteria
    from resim.perception.model import PerceptionModel as PerceptionModel
    from resim.perception.model import read_model as read_model
    from resim.recordings.checked import load_checked as load_checked
    from resim.recordings.recording import Recording as Recording
    from resim.report.player.drive import PlayedDrive as PlayedDrive
    from resim.resimulation.assessed import AssessmentOptions as AssessmentOptions
    from resim.resimulation.assessed import ResimulationAssessment as ResimulationAssessment
    from resim.resimulation.perceived import PerceptionSetup as PerceptionSetup
    from resim.resimulation.report import RunReport as RunReport
    from resim.resimulation.result import Resimulation as Resimulation
    from resim.resimulation.result import ResimulationOptions as ResimulationOptions
    from resim.road.checked import MapCheck as MapCheck
    from resim.simulation.case import Case as Case
    from resim.simulation.case import SimulatedDrive as SimulatedDrive
    from resim.simulation.function.interface import Build as Build
    from resim.simulation.function.interface import load_build as load_build
    from resim.verification.request import VerifyOptions as VerifyOptions

_WHERE = {
    "ResimError": "core.errors",
    "Tracks": "core.tracks",
    "AssessmentResult": "jobs.assess",
    "assess": "jobs.assess",
    "AugmentedRecording": "jobs.augment",
    "augment": "jobs.augment",
    "CheckResult": "jobs.check",
    "check": "jobs.check",
    "repair": "jobs.check",
    "check_map": "jobs.convert",
    "convert": "jobs.convert",
    "GeneratedRecording": "jobs.generate",
    "generate_recording": "jobs.generate",
    "play": "jobs.play",
    "ResimulationResult": "jobs.resimulate",
    "resimulate": "jobs.resimulate",
    "SweepListener": "jobs.sweep",
    "SweepOptions": "jobs.sweep",
    "SweepRuns": "jobs.sweep",
    "sweep": "jobs.sweep",
    "TrafficRecording": "jobs.traffic",
    "make_traffic": "jobs.traffic",
    "train": "jobs.train",
    "Verification": "jobs.verify",
    "VerificationListener": "jobs.verify",
    "compare": "jobs.verify",
    "verify": "jobs.verify",
    "Criteria": "metrics.criteria",
    "read_criteria": "metrics.criteria",
    "PerceptionModel": "perception.model",
    "read_model": "perception.model",
    "load_checked": "recordings.checked",
    "Recording": "recordings.recording",
    "PlayedDrive": "report.player.drive",
    "AssessmentOptions": "resimulation.assessed",
    "ResimulationAssessment": "resimulation.assessed",
    "PerceptionSetup": "resimulation.perceived",
    "RunReport": "resimulation.report",
    "Resimulation": "resimulation.result",
    "ResimulationOptions": "resimulation.result",
    "MapCheck": "road.checked",
    "Case": "simulation.case",
    "SimulatedDrive": "simulation.case",
    "Build": "simulation.function.interface",
    "load_build": "simulation.function.interface",
    "VerifyOptions": "verification.request",
}
"""What is exported, and the module below `resim` that has it."""

__all__ = list(_WHERE)


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'resim' has no attribute {name!r}")
    # not kept here: whatever is set in a module of resim between two runs counts as changed by code under test
    return getattr(importlib.import_module(f"resim.{_WHERE[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_WHERE])
