"""What the EGO did in a drive, measured or simulated, and when: its maneuvers, and leaving the measured route."""

from __future__ import annotations

from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork
from resim.scenario import maneuvers
from resim.simulation.case import SimulatedDrive

LEAVE_ROUTE = "leave_route"


def ego_events(
    tracks: Tracks, network: RoadNetwork, ego: str, drive: SimulatedDrive | None
) -> list[tuple[float, str]]:
    """Give when [s] the EGO did what, in order of time.

    Maneuvers as `maneuvers.events` finds them in tracks with accelerations, and "leave_route" where a simulated drive
    left the measured route; drive: None for a measured one, which is on its route.
    """
    found = maneuvers.events(tracks, network, ego=ego)
    if drive is not None and drive.left_route is not None:
        found.append((drive.left_route, LEAVE_ROUTE))
    return sorted(found)


def decision(tracks: Tracks, network: RoadNetwork, ego: str, drive: SimulatedDrive | None) -> list[str]:
    """Give what the EGO did, as `ego_events`, without when."""
    return [name for _, name in ego_events(tracks, network, ego, drive)]
