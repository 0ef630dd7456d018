"""What tests of measures and verdicts share."""

from __future__ import annotations

import pandas as pd
import pytest
from conftest import ROOT

from resim.metrics.criteria import read_criteria
from resim.recordings.checks import CODES
from resim.resimulation import AssessmentOptions, assess_recording, load_checked

TRAFFIC = ROOT / "scenarios" / "criteria" / "traffic.toml"
GROUND = ROOT / "networks" / "proving_ground.xodr"


@pytest.fixture
def judge(tmp_path):
    """Judge a recording of these tables by traffic.toml; gives the verdicts on GT, or on SD where that is given."""

    def of(*gt, sd=None, criteria=TRAFFIC):
        (tmp_path / "recording.toml").write_text(f'name = "d"\nmap = "{GROUND}"\nego = "ego"\n')
        for name, tables in (("gt", gt), ("sd", sd)):
            if tables is not None:
                pd.concat(tables).sort_values("t", kind="stable").to_csv(
                    tmp_path / f"{name}.csv", index=False
                )
        recording = load_checked(tmp_path, accept=tuple(CODES))
        found = assess_recording(recording, AssessmentOptions(criteria=read_criteria(criteria), only=()))
        return found.blocks["GT" if sd is None else "SD"].verdicts

    return of
