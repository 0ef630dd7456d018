"""What a re-simulation starts from, how it is done, and what it gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal

from resim.core.errors import ResimError
from resim.core.tracks import Tracks
from resim.metrics.doubts.unseen import Doubts
from resim.recordings import Recording
from resim.recordings.settings import Settings
from resim.resimulation.fidelity import StepErrors
from resim.resimulation.perceived import PerceptionSetup
from resim.resimulation.reaction import ego_tracks, reaction_spread
from resim.road.checked import MapCheck
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario, ScenarioObject
from resim.simulation.case import LEAD_IN, STEP, Case, SimulatedDrive
from resim.simulation.engine import Engine
from resim.simulation.function.interface import Build
from resim.simulation.perception import IdealPerception, Perception
from resim.simulation.reactive.settings import ReactiveSettings
from resim.simulation.sumo.engine import Sumo
from resim.simulation.vehicles.kinematic import Kinematic
from resim.simulation.vehicles.registry import vehicle_model

if TYPE_CHECKING:
    from resim.resimulation.report import RunReport

Basis = Literal["GT", "SD"]


@dataclass(frozen=True)
class ResimulationOptions:
    """How to re-simulate: basis of the scenarios, vehicle model, step and lead-in [s], seed, and when to end.

    Attributes:
        bases: Which measurements are re-simulated: GT, SD.
        vehicle: Name of the EGO's vehicle model.
        step: Simulation step [s].
        lead_in: Time [s] before the scenario's start.
        seed: Of every random draw.
        stop_at_collision: Whether a collision of the EGO ends a run.
        gui: Whether the simulation is shown in sumo-gui.
        record: Whether conversations with a process are kept.
        traffic: When traffic objects leave their traces for the EGO's sake; None for never.
        engine: The simulator.

    Raises:
        ResimError: Nothing is simulated with such values.
    """

    bases: tuple[Basis, ...] = ("GT", "SD")
    vehicle: str = Kinematic.name
    step: float = STEP
    lead_in: float = LEAD_IN
    seed: int = 0
    stop_at_collision: bool = True
    gui: bool = False
    record: bool = False
    traffic: ReactiveSettings | None = None
    engine: Engine = field(default_factory=Sumo)

    def __post_init__(self) -> None:
        vehicle_model(self.vehicle)
        if not 0.0 < self.step <= 1.0:
            raise ResimError(f"step {self.step:g} s: expected more than 0 and at most 1 s")
        if not 0.0 <= self.lead_in <= 60.0:
            raise ResimError(f"lead_in {self.lead_in:g} s: expected 0 to 60 s")

    def case(
        self,
        scenario: Scenario,
        network: RoadNetwork,
        build: Build,
        *,
        perception: Perception | None = None,
        seed: int | None = None,
        open_loop: bool = False,
    ) -> Case:
        """Give the case of a scenario and a build.

        Args:
            scenario: What is driven.
            network: Its roads.
            build: The AD function.
            perception: What the function sees; by default `IdealPerception`.
            seed: Of every random draw; by default the options'.
            open_loop: Whether the function's answers move nothing.
        """
        return Case(
            scenario=scenario,
            network=network,
            build=build,
            engine=self.engine,
            perception=perception or IdealPerception(),
            vehicle=vehicle_model(self.vehicle),
            step=self.step,
            lead_in=self.lead_in,
            seed=self.seed if seed is None else seed,
            stop_at_collision=self.stop_at_collision and not open_loop,
            open_loop=open_loop,
            record=self.record,
            traffic=None if open_loop else self.traffic,
        )


@dataclass(frozen=True, eq=False)
class PreparedRecording:
    """A recording, measured and described: what every simulation of it starts from.

    whole: GT, and SD where there is one, as long as the EGO is there; measured: the same, with objects split where
    they are not seen for long; described: by basis, GT always; doubts: what each measurement leaves open.
    """

    recording: Recording
    checked: MapCheck
    whole: Mapping[Basis, Tracks]
    measured: Mapping[Basis, Tracks]
    described: Mapping[Basis, Scenario]
    doubts: Mapping[Basis, Doubts]

    @property
    def network(self) -> RoadNetwork:
        """The roads of the recording's map."""
        return self.checked.network


@dataclass(frozen=True, eq=False)
class Resimulation:
    """A re-simulated recording: what was measured and described, the drives that were simulated, and the errors.

    Attributes:
        prepared: The recording, measured and described.
        build: The AD function that drove.
        options: How it was simulated.
        drives: By source: rGT, rSD, and rGT+M with its seed (`of_seed`).
        refits: What describes the drives by splines, of rGT+M the EGO alone; nothing for a drive that ended before
            there was anything to describe.
        errors: By step, and as `PIPE_GT+M` with its seed.
        warnings: Notes, a line each.
        times: Wall clock [s] by stage.
        hashes: SHA-256 of what went in.
        perceiving: The perception model and its seeds, if any.
        misfits: By source a line that names the objects whose traces are not where they were.
    """

    prepared: PreparedRecording
    build: Build
    options: ResimulationOptions
    drives: Mapping[str, SimulatedDrive] = field(default_factory=dict)
    refits: Mapping[str, Scenario] = field(default_factory=dict)
    errors: Mapping[str, StepErrors] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    times: Mapping[str, float] = field(default_factory=dict)
    hashes: Mapping[str, str] = field(default_factory=dict)
    perceiving: PerceptionSetup | None = None
    misfits: Mapping[str, str] = field(default_factory=dict)

    @property
    def recording(self) -> Recording:
        """The recording."""
        return self.prepared.recording

    @property
    def network(self) -> RoadNetwork:
        """The roads of its map."""
        return self.prepared.network

    @property
    def measured(self) -> Mapping[Basis, Tracks]:
        """GT, and SD where there is one."""
        return self.prepared.measured

    @property
    def described(self) -> Mapping[Basis, Scenario]:
        """What describes them."""
        return self.prepared.described

    @property
    def ego(self) -> str:
        """The EGO's id."""
        return self.recording.ego

    @property
    def failure(self) -> str:
        """Why the function failed, and in which run, or ""."""
        whys = {name: drive.failure for name, drive in self.drives.items() if drive.failure}
        return "; ".join(f"{source_words(name)}: {why}" for name, why in whys.items())

    @property
    def seeds(self) -> tuple[int, ...]:
        """Of the drives with a perception model."""
        return tuple(drive.case.seed for drive in self.perceived().values())

    def of(self, seed: int) -> tuple[SimulatedDrive, Scenario | None, StepErrors | None]:
        """Give the drive with a perception model and this seed, what describes it, and its pipeline error, if any.

        Args:
            seed: One of the seeds that were run.
        """
        source = of_seed(seed)
        return self.drives[source], self.refits.get(source), self.errors.get(pipeline_step(source))

    def simulated(self) -> dict[str, SimulatedDrive]:
        """Give the drives without a perception model: rGT, rSD."""
        return {name: drive for name, drive in self.drives.items() if not name.startswith(MODEL)}

    def perceived(self) -> dict[str, SimulatedDrive]:
        """Give the drives with a perception model: rGT+M, by seed."""
        return {name: drive for name, drive in self.drives.items() if name.startswith(MODEL)}

    def scenarios(self) -> dict[str, Scenario]:
        """Give the scenarios by what they describe: GT, SD, rGT, rSD."""
        out = {str(basis): scenario for basis, scenario in self.described.items()}
        return out | {name: self.refits[name] for name in self.simulated() if name in self.refits}

    def tracks(self) -> dict[str, Tracks]:
        """Give the tracks by source: GT, SD, rGT, rSD."""
        out = {str(basis): tracks for basis, tracks in self.measured.items()}
        return out | {name: drive.truth for name, drive in self.simulated().items()}

    def driven(self) -> dict[str, Tracks | None]:
        """Give how the EGO drove in GT, rGT and rSD, with accelerations: as splines have it, of all alike."""
        made = self.scenarios()
        return {
            name: ego_tracks(made[name], self.network) if name in made else None
            for name in ("GT", "rGT", "rSD")
        }

    @cached_property
    def report(self) -> RunReport:
        """What report.json says (`resim.resimulation.report`), worked out once."""
        from resim.resimulation.report import report

        return report(self)

    @cached_property
    def reaction_spread(self) -> float | None:
        """Give how far [s] first braking in GT is off in two of three cases, and with it each difference from it."""
        return reaction_spread(self.measured["GT"], self.described["GT"], self.network)


MODEL = "rGT+M"
"""Source of the drives on GT with a perception model, before the seed."""


def of_seed(seed: int) -> str:
    """Give the source of the drive on GT with a perception model and this seed."""
    return f"{MODEL}{seed}"


def own_tracks(drive: SimulatedDrive) -> list[str]:
    """Give who is not where GT's scenario has it in a drive on GT: the EGO, and who was handed over."""
    return list(dict.fromkeys([drive.case.scenario.ego.id, *(one.id for one in drive.handed_over)]))


def with_own(scenario: Scenario, driven: Scenario) -> tuple[ScenarioObject, ...]:
    """Give the traffic of a drive on GT: of GT's scenario, but for those that the drive has its own of."""
    own = {one.id: one for one in driven.objects}
    return tuple(own.get(one.id, one) for one in scenario.objects)


def source_words(source: str) -> str:
    """Give what a source is called in a message: "rGT+M, seed 3" of rGT+M3."""
    return source.replace(MODEL, f"{MODEL}, seed ")


def pipeline_step(source: str) -> str:
    """Give the step whose error is that of a simulated drive less GT: PIPE_GT of rGT, PIPE_GT+M3 of rGT+M3."""
    return f"PIPE_{source.removeprefix('r')}"


def is_recorded_build(recording: Recording | Settings, build: Build) -> bool | None:
    """Say whether this build drove the recording, None where the recording does not say what did."""
    if not recording.build:
        return None
    return recording.build == build.label and recording.build_hash in (None, build.hash)
