"""Two straight roads that cross at a right angle, one over the other or at grade, and drives on them.

Heights follow from the shapes written here; nothing of resim is asked for them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from resim.recordings import Recording, read_recording

HALF, DECK, RAMP, TOP = 300.0, 6.0, 100.0, 120.0
"""Half length of the roads, height of the bridge, length of a ramp, and half length of the level bridge [m]."""

ROAD = """<road id="{id}" length="{length}" junction="-1"><planView><geometry s="0" x="{x}" y="{y}" hdg="{heading}"
length="{length}"><line/></geometry></planView><elevationProfile>{elevation}</elevationProfile><lanes>
<laneSection s="0"><left><lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left>
<center><lane id="0" type="none"/></center><right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0"
d="0"/></lane></right></laneSection></lanes></road>"""


def bridge_height(y, top=TOP):
    """Give the height [m] of the road from south to north at y [m]."""
    u = np.clip((top + RAMP - np.abs(np.asarray(y, dtype=float))) / RAMP, 0.0, 1.0)
    return DECK * (3.0 * u**2 - 2.0 * u**3)


def elevation(*records: tuple[float, ...]) -> str:
    return "".join('<elevation s="{}" a="{}" b="{}" c="{}" d="{}"/>'.format(*record) for record in records)


FLAT = elevation((0.0, 5.0, 0.0, 0.0, 0.0))
UP, DOWN = 3.0 * DECK / RAMP**2, 2.0 * DECK / RAMP**3


def bridge(top: float) -> str:
    """Give the elevation of the road to the north, with a level bridge of this half length [m]."""
    return elevation(
        (0.0, 0.0, 0.0, 0.0, 0.0),
        (HALF - top - RAMP, 0.0, 0.0, UP, -DOWN),
        (HALF - top, DECK, 0.0, 0.0, 0.0),
        (HALF + top, DECK, 0.0, -UP, DOWN),
        (HALF + top + RAMP, 0.0, 0.0, 0.0, 0.0),
    )


BRIDGE, SHORT = bridge(TOP), bridge(20.0)


def write_map(path: Path, *, east: str = "", north: str = "", deck: str = "") -> Path:
    """Write the map: road 1 to the east, road 2 to the north, and if asked for, 3 above the middle of 1, with these
    elevations."""
    length = 2.0 * HALF
    roads = [
        ROAD.format(id=1, length=length, x=-HALF, y=0, heading=0, elevation=east),
        ROAD.format(id=2, length=length, x=0, y=-HALF, heading=0.5 * np.pi, elevation=north),
    ]
    if deck:
        roads.append(ROAD.format(id=3, length=120.0, x=-60.0, y=0, heading=0, elevation=deck))
    path.write_text(
        f'<OpenDRIVE><header revMajor="1" revMinor="6" name=""/>{"".join(roads)}</OpenDRIVE>',
        encoding="utf-8",
    )
    return path


def straight(name, t, x, y, heading, v, z=None) -> pd.DataFrame:
    """Give the rows of a car that drives straight on from x, y [m] at t = 0."""
    rows = {
        "t": np.round(t, 6),
        "id": name,
        "x": x + v * np.cos(heading) * t,
        "y": y + v * np.sin(heading) * t,
    }
    rows |= {"heading": heading, "v": v, "length": 4.7, "width": 1.9, "kind": "car"}
    return pd.DataFrame(rows if z is None else {**rows, "z": z})


def crossing_rows(z_ego=None, z_other=None, *, v: float = 14.0, lasts: float = 10.0) -> pd.DataFrame:
    """Give an EGO to the east and a car to the north that are at the crossing at the same time, 6 s after the start.

    z_ego, z_other: their heights as functions of t, x and y; None where there are none.
    """
    t = np.arange(0.0, lasts + 1e-9, 0.05)
    ego = straight("ego", t, -6.0 * v, -1.75, 0.0, v)
    other = straight("over", t, 1.75, -6.0 * v, 0.5 * np.pi, v)
    for rows, of in ((ego, z_ego), (other, z_other)):
        if of is not None:
            rows["z"] = of(rows["t"].to_numpy(), rows["x"].to_numpy(), rows["y"].to_numpy())
    return pd.concat([ego, other]).sort_values("t", kind="stable")


def write_recording(
    folder: Path,
    gt: pd.DataFrame,
    *,
    sd: pd.DataFrame | None = None,
    east: str = "",
    north: str = "",
    deck: str = "",
) -> Recording:
    """Write a recording with the map, and read it."""
    folder.mkdir(parents=True, exist_ok=True)
    write_map(folder / "map.xodr", east=east, north=north, deck=deck)
    (folder / "recording.toml").write_text(
        'name = "crossing"\nmap = "map.xodr"\nego = "ego"\n', encoding="utf-8"
    )
    gt.to_csv(folder / "gt.csv", index=False)
    if sd is not None:
        sd.to_csv(folder / "sd.csv", index=False)
    return read_recording(folder)
