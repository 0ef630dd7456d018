"""A map before it is believed: what is wrong in it, and how exact its SUMO net is."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from resim.core.errors import InputError
from resim.road.flaws import Flaw, flaws
from resim.road.opendrive import VEHICLE_LANES, RoadNetwork, load
from resim.road.sumo import LaneError, SumoNet, sumo_net


@dataclass(frozen=True, eq=False)
class MapCheck:
    """A map, what is wrong in it (worst first), and its net."""

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

    def report(self) -> dict[str, Any]:
        """Give what conversion.json holds besides versions."""
        conversion = self.net.conversion
        return {
            "map": self.network.path.name,
            "hash": self.net.hash,
            "worst": conversion.worst,
            "mean": conversion.mean,
            "not_exact": len(conversion.bad),
            **conversion.to_json(),
            "flaws": [flaw.to_json() for flaw in self.flaws],
        }


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
