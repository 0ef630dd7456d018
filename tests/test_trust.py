"""A run says what is wrong with the lanes that were driven on: in the map, and in its SUMO net."""

from __future__ import annotations

import json
import math

import pytest
from conftest import ROOT

from resim.core.errors import InputError
from resim.recordings.checks.codes import found
from resim.resimulation import load_checked, refuse_findings, resimulate
from resim.simulation.function.interface import load_build

LANE = (
    '<lane id="-1" type="driving"><link>{links}</link><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
)
"""A way splits into two that meet again: both link the same two lanes, so SUMO can have but one."""


def road(name, x, y, length, *, junction="-1", before="", after="", links=""):
    return (
        f'<road id="{name}" length="{length}" junction="{junction}"><link>{before}{after}</link><planView>'
        f'<geometry s="0" x="{x}" y="{y}" hdg="0" length="{length}"><line/></geometry></planView><lanes>'
        f'<laneSection s="0"><center><lane id="0" type="none"/></center><right>{LANE.format(links=links)}</right>'
        "</laneSection></lanes></road>"
    )


def link(tag, kind, name, contact=""):
    return f'<{tag} elementType="{kind}" elementId="{name}"{contact and f" contactPoint={contact!r}"}/>'


def twice(aside):
    both = '<predecessor id="-1"/><successor id="-1"/>'
    inner = {
        "junction": "j", "before": link("predecessor", "road", "a", "end"),
        "after": link("successor", "road", "b", "start"), "links": both,
    }  # fmt: skip
    connections = "".join(
        f'<connection id="{name}" incomingRoad="a" connectingRoad="{name}" contactPoint="start">'
        '<laneLink from="-1" to="-1"/></connection>'
        for name in ("w", "v")
    )
    return (
        '<OpenDRIVE><header revMajor="1" revMinor="6"/>'
        + road("a", 0, 0, 100, after=link("successor", "junction", "j"))
        + road("w", 100, 0, 40, **inner) + road("v", 100, aside, 40, **inner)
        + road("b", 140, 0, 160, before=link("predecessor", "junction", "j"))
        + f'<junction id="j" name="">{connections}</junction></OpenDRIVE>'
    )  # fmt: skip


def test_a_run_over_a_lane_that_the_net_has_not_says_so(tmp_path):
    (tmp_path / "road.xodr").write_text(twice(-0.08))
    (tmp_path / "recording.toml").write_text('name = "d"\nmap = "road.xodr"\nego = "a"\n')
    rows = (f"{k / 10},a,{50 + 2 * k},-1.83,0.0,20.0,4.7,1.9,car\n" for k in range(50))
    (tmp_path / "gt.csv").write_text("t,id,x,y,heading,v,length,width,kind\n" + "".join(rows))
    recording = load_checked(tmp_path)
    result = resimulate(recording, load_build(ROOT / "adfunc" / "builds" / "replay-1.0.toml"))
    (said,) = [w for w in result.warnings if "SUMO net" in w]
    assert said == (
        "road.xodr: road v section 0 lane -1, which is driven on, is not in the SUMO net "
        "(another path through the junction links the same lanes)"
    )
    assert json.dumps(result.report.warnings).count("SUMO net") == 1
    assert result.drives["rGT"].control_error < 1e-9


@pytest.mark.parametrize(
    ("code", "remedy"),
    [
        ("SPEED_UNIT", "repair it with --fix, or continue with --accept SPEED_UNIT"),
        ("REFERENCE_POINT", "correct it, or continue with --accept REFERENCE_POINT"),
    ],
)
def test_a_refusal_offers_only_a_repair_that_there_is(tmp_path, code, remedy):
    fault = found(code, "gt", "a", (math.nan, math.nan), 2.0, "", "is wrong", limit=1.0).finding
    with pytest.raises(InputError, match=f"gt a: {code}: is wrong. See `resim check`; {remedy}"):
        refuse_findings(tmp_path, (fault,), [])
    refuse_findings(tmp_path, (fault,), [code])
