"""A map before it is believed: what is wrong in it, and how exact its SUMO net is."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from resim.core.errors import InputError
from resim.core.provenance import versions
from resim.core.spec import EXACT
from resim.road.flaws import Flaw, flaws
from resim.road.opendrive import VEHICLE_LANES, RoadNetwork, load
from resim.road.sumo import LaneError, SumoNet, sumo_net
from resim.road.sumo.conversion import Jump
from resim.road.sumo.taken import TakenRules


@dataclass(frozen=True)
class ConversionReport:
    """What conversion.json says of a map and of the SUMO net made of it.

    hash: of all that decides the net. worst, mean: errors [m] of the lanes that are in the net; simulated:
    the worst in the net that is simulated in. not_exact: how many
    lanes are missing or beyond their limit. lanes: worst first, missing ones before. connections: linked pairs of SUMO
    lanes. jumps: gaps between linked lanes. lost: links that are not in the net. rules: what became of the
    map's traffic lights, signs and priorities. flaws: what is wrong in the map.
    files: hashes of what was written.
    """

    __pydantic_config__ = EXACT

    versions: Mapping[str, str]
    map: str
    hash: str
    worst: float
    mean: float
    simulated: float
    not_exact: int
    lanes: tuple[LaneError, ...]
    connections: int
    jumps: tuple[Jump, ...]
    lost: tuple[str, ...]
    rules: TakenRules
    flaws: tuple[Flaw, ...]
    files: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class MapCheck:
    """A map, what is wrong in it, and its net.

    Attributes:
        network: The roads.
        flaws: What is wrong in the map, worst first.
        net: The SUMO net, with the errors of its lanes.
    """

    network: RoadNetwork
    flaws: tuple[Flaw, ...]
    net: SumoNet

    @property
    def inexact(self) -> tuple[LaneError, ...]:
        """The lanes for vehicles that are not in the net, or not exact there, worst first."""
        return tuple(lane for lane in self.net.conversion.bad if lane.type in VEHICLE_LANES)

    @property
    def problems(self) -> list[str]:
        """What speaks against the map, in words; none where it is good."""
        errors = sum(flaw.severity == "error" for flaw in self.flaws)
        out = [f"{errors} error(s) in the map"] if errors else []
        out += [f"{len(self.inexact)} driving lane(s) not accurate in the SUMO net"] if self.inexact else []
        lost = self.net.conversion.lost
        return out + ([f"{len(lost)} link(s) of lanes not in the net"] if lost else [])

    def report(self, files: Mapping[str, str]) -> ConversionReport:
        """Give what conversion.json says.

        Args:
            files: Hashes of what was written, by name.
        """
        conversion = self.net.conversion
        return ConversionReport(
            versions=versions(),
            map=self.network.path.name,
            hash=self.net.hash,
            worst=conversion.worst,
            mean=conversion.mean,
            simulated=conversion.simulated,
            not_exact=len(conversion.bad),
            lanes=conversion.lanes,
            connections=conversion.connections,
            jumps=conversion.jumps,
            lost=conversion.lost,
            rules=conversion.rules,
            flaws=self.flaws,
            files=files,
        )


def check_map(path: Path, *, cache: Path | None = None) -> MapCheck:
    """Read, examine and convert a map. cache: of nets, see `sumo_net`.

    Raises InputError or ConversionError where it cannot be used at all.
    """
    network = load(path)
    return MapCheck(network, flaws(network), sumo_net(network, cache=cache))


def refuse_flaws(network: RoadNetwork, found: Sequence[Flaw], accept: Collection[str]) -> None:
    """Raise InputError for a map with errors, but those whose codes are accepted."""
    errors = [flaw for flaw in found if flaw.severity == "error" and flaw.code not in accept]
    if errors:
        more = f" (and {len(errors) - 1} more errors)" if len(errors) > 1 else ""
        codes = " ".join(f"--accept {code}" for code in dict.fromkeys(flaw.code for flaw in errors))
        remedy = f"See `resim map check`; correct the map, or continue with {codes}"
        raise InputError(network.path, f"{errors[0].code}: {errors[0].text}{more}", remedy)
