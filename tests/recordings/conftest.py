from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

DATA = Path(__file__).parents[2].parent / "shared" / "data"

TOML = """name = "cut-in"
map = "../road.xodr"
ego = "ego"
build = "highway_pilot-1.0"

[environment]
fogDensity = 0.5

[provenance]
source = "made by hand"
"""
HEADER = "t,id,x,y,heading,v,length,width,kind"
GT = f"""{HEADER}
0.0,ego,0.0,0.0,0.0,20.0,4.7,1.9,car
0.0,a,30.0,3.5,0.0,18.0,12.0,2.5,truck
0.1,ego,2.0,0.0,0.0,20.0,4.7,1.9,car
0.1,a,31.8,3.5,0.0,18.0,12.0,2.5,truck
0.2,ego,4.0,0.0,0.0,20.0,4.7,1.9,car
"""


@pytest.fixture
def data() -> Path:
    if not DATA.is_dir():
        pytest.skip("the shared data are not on this machine")
    return DATA


@pytest.fixture
def make(tmp_path: Path) -> Callable[..., Path]:
    """Write a recording folder; None leaves a file out."""

    def write(*, toml: str | None = TOML, **tables: str | None) -> Path:
        (tmp_path / "road.xodr").write_text("<OpenDRIVE/>")
        folder = tmp_path / "cut_in"
        folder.mkdir()
        if toml is not None:
            (folder / "recording.toml").write_text(toml)
        for name, text in ({"gt": GT} | tables).items():
            if text is not None:
                (folder / f"{name}.csv").write_text(text)
        return folder

    return write
