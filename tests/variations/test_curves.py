"""Variations on curves follow the curve; and no command line waits for scikit-learn."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from traced import kernel_file

from resim.road.opendrive import load
from resim.road.path import lane_path
from resim.scenario.fit import fit_trace
from resim.scenario.scenario import RoadPosition, Scenario, ScenarioObject
from resim.variations.candidate import varied_drive
from resim.variations.features import POINTS
from resim.variations.origin import NamedManeuver, the_origin

ARC = """<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="arc"/>
<road id="1" length="600" junction="-1"><planView><geometry s="0" x="0" y="0" hdg="0" length="600">
<arc curvature="0.005"/></geometry></planView><lanes><laneSection s="0"><center><lane id="0" type="none"/></center>
<right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>
<lane id="-2" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection></lanes></road>
</OpenDRIVE>"""


def test_faster_on_a_curve_stays_in_its_lane(tmp_path: Path) -> None:
    """200 m of radius: 3 m further along a straight would be 0.02 m off, and 30 m 2 m."""
    road = tmp_path / "arc.xodr"
    road.write_text(ARC)
    network = load(road)
    path = lane_path(network, "1", -1, 20.0, 400.0, behind=20.0)
    t = np.arange(0.0, 10.01, 0.04)
    x, y = path.xy(20.0 * t, np.zeros(len(t)))
    heading = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))
    trace = fit_trace(t, x, y, heading, np.full(len(t), 20.0)).trace
    at = network.to_road(x[:1], y[:1])
    start = RoadPosition(str(at.road[0]), int(at.lane[0]), float(at.s[0]), float(at.t[0]))
    one = ScenarioObject("1", "car", 4.5, 1.8, start, trace.v, trace.heading)
    scenario = Scenario("arc.xodr", 10.0, replace(one, id="ego"), (one,))
    kernels = kernel_file("follow_lane")
    origin = the_origin(scenario, network, kernels, [NamedManeuver("1", "follow_lane", 0.0, 10.0)])
    further = np.concatenate([np.zeros(POINTS), np.linspace(0.0, 30.0, POINTS), np.zeros(POINTS)])
    axes = kernels.kernels["follow_lane"].axes
    offset = axes @ further  # the nearest that the kernel has
    moved = offset @ axes
    found = varied_drive(origin, offset)
    own = found.scenario.tracks(network, t).select(["1"])
    places = network.to_road(own.x[0], own.y[0])
    assert set(places.lane.tolist()) == {-1}
    wanted = np.interp(np.linspace(0.0, 1.0, len(t)), np.linspace(0.0, 1.0, POINTS), moved[2 * POINTS :])
    np.testing.assert_allclose(places.t, wanted, atol=0.03)
    assert places.s[-1] - places.s[0] > 220.0


def test_the_command_line_does_not_load_scikit_learn() -> None:
    loads = "import resim.cli; import resim.jobs.vary; import resim.jobs.kernels"
    told = f"import sys; {loads}; print('sklearn' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == "False"
